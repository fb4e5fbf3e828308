// A light's layered depth map made ready for backprojection, as textures: prepare.rs.
//
// Depths are kept as `rise`, a number that grows towards the light and is linear over planes: 1/depth in a
// perspective view, -depth in an orthographic one.
//
// `texels` has a cell a layer, params.map.w cells side by side. Level 0 of a cell is w x h; above it lie the
// coarser levels in a row, so that a cell is h / 2 higher. A texel holds the bits of its rise, and its tilt.
// `pyramid` is one such cell of (largest rise, largest biased rise), its sizes rounded up. `blocks` has cells above each
// other, with levels in blocks of texels: the bits of the highest and the lowest rise, of the rise in the middle of a
// plane that just clears the highest, and that plane's tilt.
#include "tables.glsl"

#define EMPTY uintBitsToFloat(0xff800000u)

// The upper halves of two floats: 8 bits of precision, any size.
uint pack_tilt(vec2 tilt)
{
  uvec2 rounded = floatBitsToUint(tilt) + 0x8000u;
  return (rounded.x & 0xffff0000u) | (rounded.y >> 16);
}

// Change of rise per column and per row.
vec2 unpack_tilt(uint bits)
{
  return vec2(uintBitsToFloat(bits & 0xffff0000u), uintBitsToFloat(bits << 16));
}

ivec2 map_size()
{
  return ivec2(params.map.xy);
}

int map_layers()
{
  return int(params.map.z);
}

ivec2 level_size(int level)
{
  return map_size() >> level;
}

// First texel of a level in a layer's cell.
ivec2 level_place(int layer, int level)
{
  ivec2 size = map_size();
  int columns = int(params.map.w);
  ivec2 cell = ivec2(size.x, size.y + (size.y >> 1)) * ivec2(layer % columns, layer / columns);
  return level == 0 ? cell : cell + ivec2(size.x - (size.x >> (level - 1)), size.y);
}

// The same place in the next layer's cell.
ivec2 next_layer(ivec2 texel)
{
  ivec2 size = map_size();
  int right = size.x * int(params.map.w);
  int x = texel.x + size.x;
  return x < right ? ivec2(x, texel.y) : ivec2(x - right, texel.y + size.y + (size.y >> 1));
}

ivec2 node_count(int level)
{
  ivec2 size = map_size();
  return (size + (1 << level) - 1) >> level;
}

ivec2 node_place(int level)
{
  ivec2 size = map_size();
  return level == 0 ? ivec2(0) : ivec2(size.x - (size.x >> (level - 1)) + level - 1, size.y);
}

const int BLOCK = 8;

ivec2 block_count(int level)
{
  return (level_size(level) + BLOCK - 1) / BLOCK;
}

ivec2 block_place(int layer, int level)
{
  ivec2 size = block_count(0);
  ivec2 cell = ivec2(0, (size.y + (size.y >> 1) + 1) * layer);
  return level == 0 ? cell : cell + ivec2(size.x - (size.x >> (level - 1)) + level - 1, size.y);
}

// Bias as a difference of rise: how far above a point a surface must be to shadow it. To first order
// the slope of rise gives it directly; of the cap, d(1/z) = dz / z^2.
float gradient_bias(float rise, vec2 tilt)
{
#ifdef ORTHOGRAPHIC
  float metre = 1.0;
#else
  float metre = rise * rise;
#endif
  return min(params.bias.x * max(abs(tilt.x), abs(tilt.y)), params.bias.y * metre);
}
