// A light's layered depth map made ready for backprojection, as textures: prepare.rs.
//
// Depths are kept as `rise`, a number that grows towards the light and is linear over planes: 1/depth in a
// perspective view, -depth in an orthographic one.
//
// `texels` has a cell a layer, params.columns cells side by side, with two neighbouring texels in each of its own: the
// bits of their rises, and their tilts. `pyramid` is one cell of (largest rise, largest biased rise), its sizes rounded
// up. `blocks` has cells above each other, with levels in blocks of texels: the bits of the highest and the lowest rise,
// of the rise in the middle of a plane that just clears the highest, and that plane's tilt.
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
  return ivec2(params.map_size);
}

int map_layers()
{
  return int(params.layers);
}

// Column and row of a layer where so many lie side by side. By floats: processors divide integers one by one.
ivec2 cell_of(int layer, float columns)
{
  int row = int((float(layer) + 0.5) / columns);
  return ivec2(layer - row * int(columns), row);
}

ivec2 level_size(int level)
{
  return map_size() >> level;
}

// Where a level begins in a cell: above level 0, of this size, the coarser ones lie in a row.
ivec2 level_place(ivec2 finest, int level)
{
  return level == 0 ? ivec2(0) : ivec2(finest.x - (finest.x >> (level - 1)) + level - 1, finest.y);
}

// The level that a place in a cell belongs to, if any.
int level_at(ivec2 finest, ivec2 place)
{
  int level = place.y < finest.y ? 0 : 1;
  while (level > 0 && level + 1 < int(params.levels) && place.x >= level_place(finest, level + 1).x) {
    level++;
  }
  return level;
}

ivec2 pair_count(int level)
{
  ivec2 size = level_size(level);
  return ivec2((size.x + 1) >> 1, size.y);
}

// First pair of texels of a level of a layer.
ivec2 pair_place(int layer, int level)
{
  ivec2 finest = pair_count(0);
  ivec2 cell = ivec2(finest.x + int(params.levels), finest.y + (finest.y >> 1));
  return cell * cell_of(layer, params.columns) + level_place(finest, level);
}

// Of a pair the texel in an even or in an odd column.
uvec2 one_of(uvec4 pair, int column)
{
  return (column & 1) == 0 ? pair.xy : pair.zw;
}

ivec2 node_count(int level)
{
  ivec2 size = map_size();
  return (size + (1 << level) - 1) >> level;
}

ivec2 node_place(int level)
{
  return level_place(map_size(), level);
}

const int BLOCK = 8;

ivec2 block_count(int level)
{
  return (level_size(level) + BLOCK - 1) / BLOCK;
}

// A layer's cell is a block higher than its levels: one may start later than the halves before it end.
int block_cell_height()
{
  int height = block_count(0).y;
  return height + (height >> 1) + 1;
}

ivec2 block_place(int layer, int level)
{
  return ivec2(0, block_cell_height() * layer) + level_place(block_count(0), level);
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
  return min(params.gradient_scale * max(abs(tilt.x), abs(tilt.y)), params.gradient_cap_m * metre);
}
