// Which map a point uses, and whether to doubt it: choose.rs `choose`. Dispatched once a map: of each nest of windows that
// share one eye and direction the widest first, which decides whether the nest is chosen, then the next smaller ones.
//
// `choice` holds 4 * (map + 1) + doubt, 0 for none. Of faces of a cube a point takes its own. Doubts only where rays will answer
// instead: UNSURE with DOUBT or, at hard edges, EDGES, CLOSE with CLOSE_CASTERS.
#include "region.glsl"
#if defined(DOUBT) || defined(EDGES)
#  include "doubt.glsl"
#endif

// Slope up to which points belong to a cube's face, and that up to which a widest map knows what may hide the light: choose.rs.
const float FACE = 1.02;
const float WIDEST = 15.0;

bool holds(vec4 window, vec2 place)
{
  return all(lessThanEqual(window.xz, place)) && all(lessThanEqual(place, window.yw));
}

const uint UNSURE = 1u;
const uint CLOSE = 2u; // of what is so close to the light that no map knows it

// What rays know better than this map: what there is around the point, or close to the light. Of nested maps the smallest
// that holds the point is asked.
uint doubt_of(Seen seen)
{
  if (holds(params.inner, seen.window)) {
    return 0u;
  }
#ifdef CLOSE_CASTERS
  ivec2 cells = textureSize(close_casters, 0);
  vec2 place = (seen.window - params.window_low) / (params.window_high - params.window_low);
  ivec2 cell = clamp(ivec2(place * vec2(cells)), ivec2(0), cells - 1);
  if (texelFetch(close_casters, cell, 0).r != 0u) {
    return CLOSE;
  }
#endif
#if defined(DOUBT) || defined(EDGES)
  if (is_doubtful(seen)) {
    return UNSURE;
  }
#endif
  return 0u;
}

// Whether all that can hide the light lies within the slopes that the nest's widest map looks at; a table says it better.
bool knows_all(Seen seen)
{
#if defined(ROUND) && defined(DOUBT) && !defined(CLOSE_CASTERS)
  Search search;
  return !start_search(seen, search) || is_within_slope(seen, search, WIDEST);
#else
  return true;
#endif
}

void store(ivec2 pixel, uint doubt)
{
  imageStore(choice, pixel, uvec4(4u * uint(params.index + 1.0) + doubt));
}

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size)))) {
    return;
  }
  uint before = imageLoad(choice, pixel).r;
  uint map = before / 4u, own = uint(params.index + 1.0);
  bool is_widest = own == uint(params.nest_end);
  bool may_choose = is_widest ? map == 0u : own < map && map <= uint(params.nest_end);
  vec3 facing = vec3(0.0);
#if defined(DOUBT) || defined(EDGES)
  facing = texelFetch(geometric_normal, pixel, 0).xyz;
#endif
  Seen seen;
  if (!may_choose || !see(texelFetch(position, pixel, 0).xyz, facing, vec3(0.0), seen)) {
    return;
  }
  if (!is_widest) {
    vec4 window = vec4(params.window_low.x, params.window_high.x, params.window_low.y, params.window_high.y);
    if (holds(window, seen.window)) {
      store(pixel, (before & 3u) | doubt_of(seen));
    }
    return;
  }
  bool is_alone = params.is_alone > 0.0;
  if (is_alone || max(abs(seen.window.x), abs(seen.window.y)) <= FACE) {
    store(pixel, (knows_all(seen) ? 0u : UNSURE) | doubt_of(seen));
  }
}
