// A coarser level, from level 0: prepare.rs `coarser`.
//
// It picks texels rather than averaging them: an average of two surfaces is neither. Of each 2^n x 2^n it picks
// one whose column shifts with the row and whose row shifts with the column (in bit-reversed order), so that an
// edge along an axis is met at 2^n places and not at one; along its slope the surface is carried to the middle.
#include "map.glsl"

void main()
{
  int level = int(params.level.x);
  ivec2 size = level_size(level);
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  int layer = texel.y / size.y;
  texel.y %= size.y;
  if (texel.x >= size.x || layer >= map_layers()) {
    return;
  }
  ivec2 shift = ivec2(bitfieldReverse(uvec2(texel.yx)) >> uint(32 - level));
  float scale = float(1 << level);
  uvec2 from = imageLoad(texels, level_place(layer, 0) + (texel << level) + shift).xy;
  vec2 tilt = unpack_tilt(from.y);
  vec2 to_middle = 0.5 * (scale - 1.0) - vec2(shift);
  float rise = uintBitsToFloat(from.x) + tilt.x * to_middle.x + tilt.y * to_middle.y;
  imageStore(texels,
             level_place(layer, level) + texel,
             uvec4(floatBitsToUint(rise), pack_tilt(tilt * scale), 0u, 0u));
}
