// All coarser levels, from level 0: prepare.rs `coarser`. An invocation makes a pair of texels.
//
// It picks texels rather than averaging them: an average of two surfaces is neither. Of each 2^n x 2^n it picks
// one whose column shifts with the row and whose row shifts with the column (in bit-reversed order), so that an
// edge along an axis is met at 2^n places and not at one; along its slope the surface is carried to the middle.
#include "map.glsl"

uvec2 picked(int layer, int level, ivec2 texel)
{
  if (texel.x >= level_size(level).x) {
    return uvec2(floatBitsToUint(EMPTY), 0u);
  }
  ivec2 shift = ivec2(bitfieldReverse(uvec2(texel.yx)) >> uint(32 - level));
  float scale = float(1 << level);
  ivec2 source = (texel << level) + shift;
  uvec2 from = one_of(imageLoad(texels, pair_place(layer, 0) + ivec2(source.x >> 1, source.y)), source.x);
  vec2 tilt = unpack_tilt(from.y);
  vec2 to_middle = 0.5 * (scale - 1.0) - vec2(shift);
  float rise = uintBitsToFloat(from.x) + tilt.x * to_middle.x + tilt.y * to_middle.y;
  return uvec2(floatBitsToUint(rise), pack_tilt(tilt * scale));
}

void main()
{
  ivec2 finest = pair_count(0);
  int height = finest.y >> 1;
  ivec2 place = ivec2(gl_GlobalInvocationID.xy);
  int layer = cell_of(place.y, float(height)).y;
  place.y += finest.y - layer * height;
  int level = level_at(finest, place);
  ivec2 pair = place - level_place(finest, level);
  if (layer >= map_layers() || any(greaterThanEqual(pair, pair_count(level)))) {
    return;
  }
  ivec2 texel = ivec2(2 * pair.x, pair.y);
  uvec4 both = uvec4(picked(layer, level, texel), picked(layer, level, texel + ivec2(1, 0)));
  imageStore(texels, pair_place(layer, level) + pair, both);
}
