// Which map a point uses, and whether to doubt that map: choose.rs `choose`. Dispatched once a map, smallest window first.
//
// `choice` holds 8 * (map + 1) + 4 * doubt + rank. The first map that holds all texels that can hide the light (rank 3,
// also of an only map; NESTED, of windows that share one eye and direction, the first that holds the point) is taken;
// else the last that holds the point (2); else the last that the point can be seen in (1). Doubts only with DOUBT, where rays will answer instead.
#include "region.glsl"
#ifdef DOUBT
#  include "doubt.glsl"
#endif

// Whether rays know better than this map what there is around the point, or beside the window.
bool is_doubtful(Seen seen, bool whole)
{
#ifndef DOUBT
  return false;
#else
  bool cut_off = params.settings.z > 0.0 && !whole;
#  ifdef BESIDE
  ivec2 cells = textureSize(beside, 0);
  vec2 place = (seen.window - params.window.xy) / (params.window_high.xy - params.window.xy);
  ivec2 cell = clamp(ivec2(place * vec2(cells)), ivec2(0), cells - 1);
  cut_off = cut_off || texelFetch(beside, cell, 0).r != 0u;
#  endif
  return cut_off || near_contact(seen);
#endif
}

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  uint best = imageLoad(choice, pixel).r % 4u;
  vec3 facing = vec3(0.0);
#ifdef DOUBT
  facing = texelFetch(geometric_normal, pixel, 0).xyz;
#endif
  Seen seen;
  if (best == 3u || !see(texelFetch(position, pixel, 0).xyz, facing, vec3(0.0), seen)) {
    return;
  }
  vec2 low = params.window.xy, high = params.window_high.xy;
  bool holds_point = all(lessThanEqual(low, seen.window)) && all(lessThanEqual(seen.window, high));
#ifdef NESTED
  bool whole = holds_point;
#else
  Search search;
  bool whole = holds_point && (!start_search(seen, search) || is_inside(search));
#endif
  uint rank = params.window_high.z == 1.0 ? 3u : 1u + uint(holds_point) + uint(whole);
  if (rank >= best) {
    uint doubt = uint(is_doubtful(seen, rank == 3u));
    imageStore(choice, pixel, uvec4(8u * uint(params.settings.w + 1.0) + 4u * doubt + rank));
  }
}
