// Visible share of a light's irradiance at shading points, and where to doubt it: evaluate.rs `visibility`.
//
// Dispatched once a map, for the points that chose it; with NESTED, one of a nest of windows, for those that chose any
// of the nest, since they read all of it, and what is hidden goes from one to the next; with UNMAPPED once for each axis
// that a light without a map is seen along, for the points that chose none. AREA takes the thesis's sum instead of the bitmask. With a spacing, once for the points of
// a grid, and with INTERPOLATES once more for those that its points do not tell.
#include "light.glsl"
#include "map.glsl"
#ifdef UNMAPPED
#  include "bits.glsl"
#elif defined(AREA)
#  include "area.glsl"
#else
#  include "bands.glsl"
#endif
#ifdef INTERPOLATES
#  include "interpolate.glsl"
#endif

#ifdef AREA
void evaluate(Seen seen, ivec2 pixel, uint doubt)
{
  Search search;
  if (start_search(seen, search)) {
    float left = imageLoad(visibility, pixel).r - area_hidden(seen, search);
    imageStore(visibility, pixel, vec4(max(left, 0.0)));
  }
}
#else
void answer(ivec2 pixel, float share, uint doubt)
{
  imageStore(visibility, pixel, vec4(share));
  imageStore(uncertain, pixel, uvec4(doubt));
}

// What is hidden before this map is read.
Bits hidden_before(Seen seen, ivec2 pixel, bool at_horizon)
{
#  ifdef NESTED
  if (params.index > params.nest_first) {
    ivec2 at = ivec2(2, 1) * pixel;
    return Bits(imageLoad(hidden_bits, at), imageLoad(hidden_bits, at + ivec2(1, 0)));
  }
#  endif
  if (at_horizon) {
    return horizon(seen);
  }
  return Bits(uvec4(0u), uvec4(0u));
}

// `doubt`: what choose.glsl says of the map.
void evaluate(Seen seen, ivec2 pixel, uint doubt)
{
  if (!reaches(seen)) {
    return;
  }
  vec2 heights = height_range(seen, seen.geometric_normal);
  bool at_horizon = heights.x <= 0.0;
  bool unsure = seen.too_close;
#  ifndef UNMAPPED
  bool readable = heights.y > 0.0;
  doubt = readable ? doubt : 0u;
  unsure = unsure || (readable && at_horizon);
#  endif
  bool leave_uncertain = params.leaves_uncertain > 0.0; // rays will replace it
  if (doubt >= 1u || (unsure && leave_uncertain)) {
    answer(pixel, 1.0, doubt >= 2u ? 2u : 1u);
    return;
  }
#  ifdef INTERPOLATES
  float share;
  if (readable && is_interpolated(pixel, share)) {
    answer(pixel, share, 0u);
    return;
  }
#  endif
  Bits hidden = hidden_before(seen, pixel, at_horizon);
#  ifndef UNMAPPED
  Search search;
  if (readable && start_search(seen, search)) {
    backproject_bands(seen, search, hidden);
  }
#  endif
#  ifdef NESTED
  if (params.index + 1.0 < params.nest_end) {
    ivec2 at = ivec2(2, 1) * pixel;
    imageStore(hidden_bits, at, hidden.low);
    imageStore(hidden_bits, at + ivec2(1, 0), hidden.high);
    return;
  }
#  endif
  answer(pixel, none_hidden(hidden) ? 1.0 : resolve(seen, hidden), 0u);
}
#endif

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

// Eight invocations in a row take 4 x 2 pixels, which are more alike than 8 x 1.
ivec2 own_pixel()
{
  uvec2 within = gl_LocalInvocationID.xy;
  within = uvec2((within.x & 3u) | (within.y & 1u) << 2, within.x >> 2 | (within.y & 6u));
  return ivec2(8u * gl_WorkGroupID.xy + within);
}

void main()
{
  ivec2 pixel = own_pixel() * int(params.stride);
  if (any(greaterThanEqual(pixel, ivec2(params.size)))) {
    return;
  }
#ifdef INTERPOLATES
  if (all(equal(pixel % int(params.spacing), ivec2(0)))) {
    return; // of the grid
  }
#endif
  uint chosen = texelFetch(choice, pixel, 0).r;
#ifdef NESTED
  bool reads = chosen / 4u > uint(params.nest_first) && chosen / 4u <= uint(params.nest_end);
#else
  bool reads = chosen / 4u == uint(params.index + 1.0);
#endif
  if (!reads) {
    return;
  }
  vec3 place = texelFetch(position, pixel, 0).xyz;
  vec3 facing = texelFetch(geometric_normal, pixel, 0).xyz;
  vec3 shaded = texelFetch(shading_normal, pixel, 0).xyz;
  Seen seen;
  if (!see(place, facing, shaded, seen) || !is_my_point(place, seen)) {
    return;
  }
  evaluate(seen, pixel, chosen & 3u);
}
