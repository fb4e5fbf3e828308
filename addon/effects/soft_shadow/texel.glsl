// One texel of a map: the bits of its rise, and its tilt.
#include "map.glsl"

uvec2 texel_at(int layer, int level, ivec2 texel)
{
  ivec2 pair = pair_place(layer, level) + ivec2(texel.x >> 1, texel.y);
  return one_of(texelFetch(texels, pair, 0), texel.x);
}
