// The thesis's own method, clamped areas of backprojected texels, summed (section 5.3.5 and its listing): area.rs.
#include "region.glsl"
#include "texel.glsl"

// Rise half way in depth between two surfaces; that of the first where nothing is behind it.
float midpoint(float rise, float next)
{
  if (next == EMPTY) {
    return rise;
  }
#ifdef ORTHOGRAPHIC
  return 0.5 * (rise + next);
#else
  return 2.0 * rise * next / (rise + next);
#endif
}

float rise_at(int layer, int level, ivec2 texel)
{
  return uintBitsToFloat(texel_at(layer, level, texel).x);
}

// Share of the light that what lies between `low` and `high`, in texels from the point, covers.
float covered(vec2 low, vec2 high, float above, vec2 share, vec2 start)
{
  vec2 from = clamp(low / above * share - start, 0.0, 1.0);
  vec2 to = clamp(high / above * share - start, 0.0, 1.0);
  return (to.x - from.x) * (to.y - from.y);
}

// One region, on a level coarse enough for params.most_texels texels: region.rs `whole`. -1: there is none.
int whole_region(Search search, out Region region)
{
  int levels = int(params.levels);
  for (int level = 0; level < levels; level++) {
    if (!around(search, search.above, level, region)) {
      return -1;
    }
    ivec2 size = region.high - region.low;
    if (float(size.x) * float(size.y) <= params.most_texels) {
      return level;
    }
  }
  return levels - 1;
}

// The sum over texels of the share of the light that the farthest occluding layer covers; overlaps count twice. The
// last stored depth only serves as the next one of the layer before it. What of a texel lies in the window of a smaller
// map is left to that one.
float area_hidden(Seen seen, Search search)
{
  Region region;
  int level = whole_region(search, region);
  if (level < 0) {
    return 0.0;
  }
  vec2 texel_size = params.texel_size * float(1 << level);
  vec2 at = (seen.window - params.window_low) / texel_size;
  vec2 size = seen.bounds.yw - seen.bounds.xz;
  vec2 share = texel_size / size, start = seen.bounds.xz / size;
  vec2 inner_low = (params.inner.xz - seen.window) / texel_size;
  vec2 inner_high = (params.inner.yw - seen.window) / texel_size;
  float hidden = 0.0;
  for (int row = region.low.y; row < region.high.y; row++) {
    for (int column = region.low.x; column < region.high.x; column++) {
      ivec2 texel = ivec2(column, row);
      float next = rise_at(map_layers() - 1, level, texel);
      for (int layer = map_layers() - 2; layer >= 0; layer--) {
        uvec2 found = texel_at(layer, level, texel);
        float rise = uintBitsToFloat(found.x);
        float above = rise - seen.rise;
        float gradient = gradient_bias(rise, unpack_tilt(found.y));
        // Written so that an empty texel, whose difference to its midpoint is NaN, casts no shadow.
        vec2 low = vec2(texel) - at, high = low + 1.0;
        bool casts = above > max(gradient, seen.rounding) && above > rise - midpoint(rise, next) &&
                     clears_own_surface(seen, (low + 0.5) * texel_size, above);
        next = rise;
        float area = casts ? covered(low, high, above, share, start) : 0.0;
        low = max(low, inner_low);
        high = min(high, inner_high);
        if (casts && all(lessThan(low, high))) {
          area -= covered(low, high, above, share, start);
        }
        if (area > 0.0) {
          hidden += area;
          break;
        }
      }
    }
  }
  return hidden;
}
