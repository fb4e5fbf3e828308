// The bitmask method, one texel at a time: plain.rs `backproject`.
#include "bits.glsl"
#include "region.glsl"

// Smallest rise above the point that an edge of a tilted texel may come to, as a share of its middle's.
const float LOWEST_EDGE = 1e-3;

// Bits of columns below `end` in the two words from column `first` on.
uvec2 columns_below(int end, int first)
{
  ivec2 count = clamp(end - first - ivec2(0, 32), 0, 32);
  // Shifted in two steps, since a shift by 32 is undefined.
  ivec2 part = count >> 1;
  return ((uvec2(1u) << part) << (count - part)) - 1u;
}

// Hides samples of columns x.x to x.y and rows y.x to y.y, two words of the bitmask at a time: few texels reach into more.
void hide(inout Bits hidden, ivec2 x, ivec2 y)
{
  for (int word = x.x >> 5; 32 * word < x.y; word += 2) {
    uvec2 rows = texelFetch(first_rows, ivec2(word, y.y), 0).xy & ~texelFetch(first_rows, ivec2(word, y.x), 0).xy;
    uvec2 found = rows & columns_below(x.y, 32 * word) & ~columns_below(x.x, 32 * word);
    ivec4 low = ivec4(0, 1, 2, 3) - word, high = low + 4;
    hidden.low |= found.x * uvec4(equal(low, ivec4(0))) | found.y * uvec4(equal(low, ivec4(1)));
    hidden.high |= found.x * uvec4(equal(high, ivec4(0))) | found.y * uvec4(equal(high, ivec4(1)));
  }
}

// First and last sample that a texel's two edges on an axis come to.
ivec2 sample_range(vec2 offsets, float texel, vec2 above_edges, float lowest, float start, float samples)
{
  vec2 covered = offsets * texel / max(above_edges, vec2(lowest)) - start;
  ivec2 ranks = ivec2(roundEven(clamp(covered * samples, 0.0, float(SAMPLES))));
  return ivec2(min(ranks.x, ranks.y), max(ranks.x, ranks.y));
}

// Whether all texels of a block are in the point's tangent plane or below it, so that all they hide is below the
// horizon. `middle` of the block from the point in the window; `clear` and `slope` of the plane over the block. Allows
// for rounding, within what `clears_own_surface` allows: tile.rs `OwnPlane`.
bool is_own_surface(Seen seen, vec2 middle, vec2 texel_size, float clear, vec2 slope)
{
  float towards = -dot(seen.geometric_normal, seen.base);
  if (towards <= 0.0) {
    return false;
  }
  vec3 terms = vec3(seen.geometric_normal.xy * middle, towards * (clear - seen.rise));
  vec2 change = abs(seen.geometric_normal.xy * texel_size + towards * slope);
  float most = terms.x + terms.y + terms.z + 0.5 * float(BLOCK - 1) * (change.x + change.y);
  return most <= 0.1 * OWN_SURFACE * (abs(terms.x) + abs(terms.y) + abs(terms.z));
}

// Whether rays from the light to the point pass by what lies between `low` and `high` in the window, relative to the
// point, and no more than `above` it.
bool passes_by(Seen seen, vec2 low, vec2 high, float above)
{
  return any(greaterThanEqual(low, seen.bounds.yw * above)) || any(lessThanEqual(high, seen.bounds.xz * above));
}

// Whether what lies between `low` and `high` in the window, relative to the point, lies whole in `inner`, left, right,
// bottom, top: the window of a smaller map, to which it is left.
bool is_within(vec2 low, vec2 high, vec4 inner)
{
#ifdef NESTED
  return all(greaterThanEqual(low, inner.xz)) && all(lessThanEqual(high, inner.yw));
#else
  return false;
#endif
}

// A level of the map as a point sees it.
struct Looked {
  int level;
  vec2 band;       // for which rises above the point the level answers
  vec2 texel_size; // in the window
  vec2 at;         // where the point is, in texels
  vec4 inner;      // the smaller map's window, relative to the point
};

Looked look_at(Seen seen, int level, vec2 band)
{
  vec2 texel_size = params.texel_size * float(1 << level);
  vec2 at = (seen.window - params.window_low) / texel_size;
  return Looked(level, band, texel_size, at, params.inner - seen.window.xxyy);
}

// Blocks that wait to be read: row and column, then what look_at_block says, level and layer.
const int MOST_WAITING = 32;

uvec2 pack_block(ivec3 block, int level, uint look)
{
  return uvec2(block.x | block.y << 16, look | uint(level) << 9 | uint(block.z) << 16);
}

ivec2 block_of(uvec2 waiting)
{
  return ivec2(waiting.x & 0xffffu, waiting.x >> 16);
}

int level_of(uvec2 waiting)
{
  return int(waiting.y >> 9 & 15u);
}

// First of the pairs of texels of the block.
ivec2 pairs_of(uvec2 waiting)
{
  return pair_place(int(waiting.y >> 16), level_of(waiting)) + block_of(waiting) * ivec2(BLOCK / 2, BLOCK);
}

const uint WORTH_A_LOOK = 1u; // and then in bits 3 to 5 and 6 to 8 the first and the last row that counts
const uint LAST_LAYER = 2u;   // nor are the same texels of deeper layers

// Whether a block of texels is worth a look: tile.rs. Deeper layers are farther from the light, and so hide less.
uint look_at_block(Seen seen, Looked looked, ivec3 block)
{
  uvec4 known = texelFetch(blocks, block_place(block.z, looked.level) + block.xy, 0);
  float highest = uintBitsToFloat(known.x) - seen.rise, lowest = uintBitsToFloat(known.y) - seen.rise;
  float above = min(highest, looked.band.y);
  vec2 low = (vec2(BLOCK * block.xy) - looked.at) * looked.texel_size, size = float(BLOCK) * looked.texel_size;
  if (highest <= looked.band.x || passes_by(seen, low, low + size, above) || is_within(low, low + size, looked.inner)) {
    return LAST_LAYER;
  }
  if (lowest > looked.band.y ||
      is_own_surface(seen, low + 0.5 * size, looked.texel_size, uintBitsToFloat(known.z), unpack_tilt(known.w)))
  {
    return 0u;
  }
  // Only rows that the light's rays to the point cross this far above it.
  vec2 crossed = floor(looked.at.y + seen.bounds.zw * above / looked.texel_size.y) - float(BLOCK * block.y);
  float last = float(min(BLOCK, level_size(looked.level).y - BLOCK * block.y) - 1);
  uvec2 rows = uvec2(clamp(crossed, vec2(0.0), vec2(last)));
  return WORTH_A_LOOK | rows.x << 3 | rows.y << 6;
}

// Whether each of four neighbouring texels is in the band and crossed by rays from the light to the point. `sides`: of
// the first, left and right in the window, relative to the point; `ends` of the row, bottom and top.
uint crossed_texels(Seen seen, Looked looked, vec4 rise, vec4 left, vec4 right, vec2 ends)
{
  vec4 above = rise - seen.rise;
  bvec4 in_band = bvec4(uvec4(greaterThan(above, vec4(looked.band.x))) & uvec4(lessThanEqual(above, vec4(looked.band.y))));
  uvec4 met = uvec4(in_band) & uvec4(lessThan(left, seen.bounds.y * above)) &
              uvec4(greaterThan(right, seen.bounds.x * above)) &
              uvec4(lessThan(vec4(ends.x), seen.bounds.w * above)) &
              uvec4(greaterThan(vec4(ends.y), seen.bounds.z * above));
  return met.x | met.y << 1 | met.z << 2 | met.w << 3;
}

// One bit for each texel of a block that may hide something, four rows in each word.
uvec2 found_in(Seen seen, Looked looked, uvec2 waiting)
{
  ivec2 block = block_of(waiting), rows = ivec2(waiting.y >> 3, waiting.y >> 6) & 7;
  ivec2 pairs = pairs_of(waiting);
  vec4 column = float(BLOCK * block.x) + vec4(0.0, 1.0, 2.0, 3.0) - looked.at.x;
  vec4 left = column * looked.texel_size.x, right = (column + 1.0) * looked.texel_size.x;
  vec4 left_4 = (column + 4.0) * looked.texel_size.x, right_4 = (column + 5.0) * looked.texel_size.x;
  uint on_map = (1u << min(BLOCK, level_size(looked.level).x - BLOCK * block.x)) - 1u;
  uvec2 found = uvec2(0u);
  for (int row = rows.x; row <= rows.y; row++) {
    ivec2 first = pairs + ivec2(0, row);
    uvec2 a = texelFetch(texels, first, 0).xz, b = texelFetch(texels, first + ivec2(1, 0), 0).xz;
    uvec2 c = texelFetch(texels, first + ivec2(2, 0), 0).xz, d = texelFetch(texels, first + ivec2(3, 0), 0).xz;
    float offset = float(BLOCK * block.y + row) - looked.at.y;
    vec2 ends = vec2(offset, offset + 1.0) * looked.texel_size.y;
    uint met = crossed_texels(seen, looked, uintBitsToFloat(uvec4(a, b)), left, right, ends) |
               crossed_texels(seen, looked, uintBitsToFloat(uvec4(c, d)), left_4, right_4, ends) << 4;
    uint placed = (met & on_map) << (8 * (row & 3));
    found |= row < 4 ? uvec2(placed, 0u) : uvec2(0u, placed);
  }
  return found;
}

// Projects a texel back onto the light (thesis eq. 5.3) and hides the samples it covers (Schwarz and Stamminger 2007).
// Each of its four edges is projected from its own depth, and a texel whose middle is not above the point's tangent plane
// is passed over.
void backproject_texel(Seen seen, Looked looked, uvec2 texel, vec2 offset, inout Bits hidden)
{
  float rise = uintBitsToFloat(texel.x);
  float above = rise - seen.rise;
  vec2 tilt = unpack_tilt(texel.y);
  if (above <= max(gradient_bias(rise, tilt), seen.rounding) ||
      is_within(offset * looked.texel_size, (offset + 1.0) * looked.texel_size, looked.inner) ||
      !clears_own_surface(seen, (offset + 0.5) * looked.texel_size, above))
  {
    return;
  }
  vec2 start = seen.bounds.xz;
  vec2 samples = float(SAMPLES) / (seen.bounds.yw - seen.bounds.xz);
  vec2 edges_x = above + vec2(-0.5, 0.5) * tilt.x, edges_y = above + vec2(-0.5, 0.5) * tilt.y;
  float lowest = LOWEST_EDGE * above;
  vec2 size = looked.texel_size;
  ivec2 x = sample_range(vec2(offset.x, offset.x + 1.0), size.x, edges_x, lowest, start.x, samples.x);
  ivec2 y = sample_range(vec2(offset.y, offset.y + 1.0), size.y, edges_y, lowest, start.y, samples.y);
  if (x.x < x.y && y.x < y.y) {
    hide(hidden, x, y);
  }
}

