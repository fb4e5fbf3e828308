// Visible share of a light's irradiance at shading points, and where to doubt it: evaluate.rs `visibility`.
//
// Dispatched once a map, for the points that chose it; with UNMAPPED once for each axis that a light without a map
// is seen along, for the points that chose none. AREA takes the thesis's sum instead of the bitmask.
#include "light.glsl"
#include "map.glsl"
#ifdef UNMAPPED
#  include "bits.glsl"
#elif defined(AREA)
#  include "area.glsl"
#else
#  include "bands.glsl"
#  include "doubt.glsl"
#endif

// Visibility, and 1 where it is uncertain. `whole`: the map holds all that can hide the light.
vec2 visibility_of(Seen seen, bool whole)
{
#ifdef AREA
  Search search;
  return vec2(start_search(seen, search) ? area_visibility(seen, search) : 1.0, 0.0);
#else
  // Written so that a NaN in a normal reads as no light.
  bool receives_light = height_range(seen, seen.shading_normal).y > 0.0;
  if (!receives_light) {
    return vec2(1.0, 0.0);
  }
  vec2 heights = height_range(seen, seen.geometric_normal);
  bool at_horizon = heights.x <= 0.0;
  bool doubt = seen.too_close;
#  ifndef UNMAPPED
  bool readable = heights.y > 0.0;
  bool cut_off = params.settings.z > 0.0 && !whole;
  doubt = doubt || (readable && (at_horizon || cut_off || near_contact(seen)));
#  endif
  bool leave_uncertain = params.window_high.w > 0.0; // rays will replace it
  if (doubt && leave_uncertain) {
    return vec2(1.0);
  }
  Bits hidden = Bits(uvec4(0u), uvec4(0u));
  if (at_horizon) {
    hidden = horizon(seen);
  }
#  ifndef UNMAPPED
  Search search;
  if (readable && start_search(seen, search)) {
    backproject_bands(seen, search, hidden);
  }
#  endif
  return vec2(none_hidden(hidden) ? 1.0 : resolve(seen, hidden), float(doubt));
#endif
}

// Of the six axes the one nearest to the point's direction: the largest depth.
bool is_my_point(vec3 place, Seen seen)
{
#if defined(UNMAPPED) && defined(ROUND)
  vec3 from_light = abs(place + params.from_light.xyz);
  return seen.base.z >= max(from_light.x, max(from_light.y, from_light.z));
#else
  return true;
#endif
}

void main()
{
#if !defined(UNMAPPED) && !defined(AREA)
  share_rows();
#endif
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  uint chosen = texelFetch(choice, pixel, 0).r;
  if (chosen / 8u != uint(params.settings.w + 1.0)) {
    return;
  }
  vec3 place = texelFetch(position, pixel, 0).xyz;
  vec3 facing = texelFetch(geometric_normal, pixel, 0).xyz;
  vec3 shaded = texelFetch(shading_normal, pixel, 0).xyz;
  Seen seen;
  if (!see(place, facing, shaded, seen) || !is_my_point(place, seen)) {
    return;
  }
  vec2 result = visibility_of(seen, chosen % 8u == 3u);
  imageStore(visibility, pixel, vec4(result.x));
  imageStore(uncertain, pixel, uvec4(uint(result.y)));
}
