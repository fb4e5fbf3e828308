// Which texels can hide the light from a point, thesis section 5.3.2 for any rectangle and window: region.rs.
#include "light.glsl"
#include "map.glsl"

// A point's place in texels of level 0, the light's reach in texels per rise (left, right, bottom, top), and how
// far above the point the nearest occluder may be.
struct Search {
  vec2 place;
  vec4 reach;
  float above;
};

// Columns low.x to high.x and rows low.y to high.y of a level.
struct Region {
  ivec2 low;
  ivec2 high;
};

// Texels crossed by the pyramid from the point to the light, up to `above` the point: eq. 5.1. False: none.
bool around(Search search, float above, int level, out Region region)
{
  float scale = 1.0 / float(1 << level);
  vec2 from = floor((search.place + search.reach.xz * above) * scale);
  vec2 to = floor((search.place + search.reach.yw * above) * scale) + 1.0;
  vec2 limit = vec2(level_size(level));
  region.low = ivec2(clamp(from, vec2(0.0), limit));
  region.high = ivec2(clamp(to, vec2(0.0), limit));
  return all(lessThan(region.low, region.high));
}

vec2 nearest_node(int level, ivec2 node)
{
  return texelFetch(pyramid, node_place(level) + node, 0).xy;
}

// Largest rise and biased rise in a region of level 0, from at most 2 x 2 nodes of the pyramid.
vec2 nearest_in(Region region)
{
  ivec2 size = region.high - region.low;
  int width = max(size.x, size.y);
  int level = min(width > 1 ? findMSB(width - 1) + 1 : 0, int(params.nodes) - 1);
  ivec2 first = region.low >> level, last = (region.high - 1) >> level;
  return max(max(nearest_node(level, first), nearest_node(level, last)),
             max(nearest_node(level, ivec2(first.x, last.y)), nearest_node(level, ivec2(last.x, first.y))));
}

// False: nothing can hide the light from the point. Starts with the map's own nearest depth, not with the near
// plane, which may be much closer; then takes the nearest depth inside, params.refinements times.
bool start_search(Seen seen, out Search search)
{
  vec2 texel = params.texel_size;
  search.place = (seen.window - params.window_low) / texel;
  search.reach = seen.bounds / texel.xxyy;
  search.above = INFINITE;
  vec2 nearest = nearest_node(int(params.nodes) - 1, ivec2(0));
  int refinements = int(params.refinements);
  for (int turn = 0; turn <= refinements; turn++) {
    if (nearest.y <= seen.rise) {
      return false;
    }
    search.above = min(search.above, nearest.x - seen.rise);
    Region region;
    if (!around(search, search.above, 0, region)) {
      return false;
    }
    if (turn < refinements) {
      nearest = nearest_in(region);
    }
  }
  return true;
}

// Whether the whole region lies within a slope.
bool is_within_slope(Seen seen, Search search, float slope)
{
  vec4 sides = seen.window.xxyy + seen.bounds * search.above;
  return all(lessThanEqual(abs(sides), vec4(slope)));
}
