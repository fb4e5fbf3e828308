// Which map a point uses: evaluate.rs `choose`. Dispatched once a map, smallest window first.
//
// `choice` holds 8 * (map + 1) + rank. The first map that holds all texels that can hide the light (rank 3, also of
// an only map) is taken; else the last that holds the point (2); else the last that the point can be seen in (1).
#include "region.glsl"

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
  Search search;
  bool whole = holds_point && (!start_search(seen, search) || is_inside(search));
  uint rank = params.window_high.z == 1.0 ? 3u : 1u + uint(holds_point) + uint(whole);
  if (rank >= best % 8u) {
    imageStore(choice, pixel, uvec4(8u * uint(params.settings.w + 1.0) + rank));
  }
}
