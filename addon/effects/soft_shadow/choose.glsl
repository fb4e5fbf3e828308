// Which map a point uses: evaluate.rs `choose`. Dispatched once a map, smallest window first, and before that once
// as WIDEST for the last map.
//
// `choice` holds 8 * (map + 1) + rank. The first map that holds all texels that can hide the light (rank 3, also of
// an only map) is taken; else the last that holds the point (2); else the last that the point can be seen in (1).
// Of nested maps only the widest knows how far `above` the point the nearest occluder is (negative: there is none);
// cube faces share nothing and each answers for itself.
#include "region.glsl"

#ifdef WIDEST
void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  Seen seen;
  Search search;
  bool hidden = see(texelFetch(position, pixel, 0).xyz, vec3(0.0), vec3(0.0), seen) && start_search(seen, search);
  imageStore(above, pixel, vec4(hidden ? search.above : -1.0));
}
#else
// Whether the map's window holds all that can hide the light from the point, up to a rise `reach` above it.
bool holds(Seen seen, float reach)
{
  vec2 from = seen.window + seen.bounds.xz * reach, to = seen.window + seen.bounds.yw * reach;
  return all(lessThanEqual(params.window.xy, from)) && all(lessThanEqual(to, params.window_high.xy));
}

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  uint best = imageLoad(choice, pixel).r;
  Seen seen;
  if (best % 8u == 3u || !see(texelFetch(position, pixel, 0).xyz, vec3(0.0), vec3(0.0), seen)) {
    return;
  }
  vec2 low = params.window.xy, high = params.window_high.xy;
  bool holds_point = all(lessThanEqual(low, seen.window)) && all(lessThanEqual(seen.window, high));
  float nearest = texelFetch(above, pixel, 0).r;
  Search search;
  if (params.settings.z == 1.0) {
    nearest = start_search(seen, search) ? search.above : -1.0;
  }
  bool whole = holds_point && (nearest < 0.0 || holds(seen, nearest));
  uint rank = params.window_high.z == 1.0 ? 3u : 1u + uint(holds_point) + uint(whole);
  if (rank >= best % 8u) {
    imageStore(choice, pixel, uvec4(8u * uint(params.settings.w + 1.0) + rank));
  }
}
#endif
