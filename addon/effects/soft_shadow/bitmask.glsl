// The bitmask method, one texel at a time: plain.rs `backproject`.
#include "bits.glsl"
#include "region.glsl"

const uint GROUP = 64u; // invocations: 8 x 8 pixels

// Sine of the elevation, about, below which a texel belongs to the point's own surface.
const float OWN_SURFACE = 0.01;

// Smallest rise above the point that an edge of a tilted texel may come to, as a share of its middle's.
const float LOWEST_EDGE = 1e-3;

// Bits of columns below `end`, in the four words from column `first` on.
uvec4 columns_below(int end, int first)
{
  ivec4 count = clamp(end - first - ivec4(0, 32, 64, 96), 0, 32);
  // Shifted in two steps, since a shift by 32 is undefined.
  ivec4 part = count >> 1;
  return ((uvec4(1u) << part) << (count - part)) - 1u;
}

// Blender takes declarations that start with the keyword out of the text, for its own programs only.
#define SHARED shared

// For each n the samples in rows below n, two words of four; a group's own copy, since every texel reads it.
SHARED uvec4 rows_below[2 * (SAMPLES + 1)];

// To be called by the whole group, at first.
void share_rows()
{
  for (uint i = gl_LocalInvocationIndex; i < uint(2 * (SAMPLES + 1)); i += GROUP) {
    rows_below[i] = texelFetch(first_rows, ivec2(i & 1u, i >> 1), 0);
  }
  barrier();
}

// Hides samples of columns x.x to x.y and rows y.x to y.y.
void hide(inout Bits hidden, ivec2 x, ivec2 y)
{
  uvec4 low = rows_below[2 * y.y] & ~rows_below[2 * y.x];
  uvec4 high = rows_below[2 * y.y + 1] & ~rows_below[2 * y.x + 1];
  hidden.low |= low & columns_below(x.y, 0) & ~columns_below(x.x, 0);
  hidden.high |= high & columns_below(x.y, 128) & ~columns_below(x.x, 128);
}

// Whether the middle of a texel, `place` from the point in the window, is above the tangent plane. The direction
// to where it is projected, times `above`, needs no division.
bool clears_own_surface(Seen seen, vec2 place, float above)
{
  vec3 direction = vec3(place, 0.0) - above * seen.base;
  float size = abs(direction.x) + abs(direction.y) + abs(direction.z);
  return dot(seen.geometric_normal, direction) > OWN_SURFACE * size;
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

// Projects a texel that is nearer to the light than the point back onto the light (thesis eq. 5.3) and hides the
// samples it covers (Schwarz and Stamminger 2007). Each of its four edges is projected from its own depth, and a texel
// whose middle is not above the point's tangent plane is passed over. `offset` from the point in texels; `band`: for
// which rises above the point the level answers.
void backproject_texel(Seen seen, uvec2 texel, vec2 offset, vec2 texel_size, vec2 band, inout Bits hidden)
{
  float rise = uintBitsToFloat(texel.x);
  float above = rise - seen.rise;
  vec2 tilt = unpack_tilt(texel.y);
  if (above <= band.x || above > band.y || above <= gradient_bias(rise, tilt)) {
    return;
  }
  if (passes_by(seen, offset * texel_size, (offset + 1.0) * texel_size, above)) {
    return;
  }
  if (!clears_own_surface(seen, (offset + 0.5) * texel_size, above)) {
    return;
  }
  vec2 start = seen.bounds.xz;
  vec2 samples = float(SAMPLES) / (seen.bounds.yw - seen.bounds.xz);
  vec2 edges_x = above + vec2(-0.5, 0.5) * tilt.x, edges_y = above + vec2(-0.5, 0.5) * tilt.y;
  float lowest = LOWEST_EDGE * above;
  ivec2 x = sample_range(vec2(offset.x, offset.x + 1.0), texel_size.x, edges_x, lowest, start.x, samples.x);
  ivec2 y = sample_range(vec2(offset.y, offset.y + 1.0), texel_size.y, edges_y, lowest, start.y, samples.y);
  if (x.x < x.y && y.x < y.y) {
    hide(hidden, x, y);
  }
}

// Whether what lies between `low` and `high` in the window, relative to the point, lies whole in `inner`, left, right,
// bottom, top: the window of a smaller map, to which it is left.
bool is_within(vec2 low, vec2 high, vec4 inner)
{
  return all(greaterThanEqual(low, inner.xz)) && all(lessThanEqual(high, inner.yw));
}

// All texels of a region that lie in blocks worth a look: tile.rs.
void backproject(Seen seen, Region region, int level, vec2 band, inout Bits hidden)
{
  vec2 texel_size = params.window.zw * float(1 << level);
  vec2 at = (seen.window - params.window.xy) / texel_size;
  vec4 inner = params.inner - seen.window.xxyy;
  ivec2 first_block = region.low / BLOCK, last_block = (region.high - 1) / BLOCK;
  for (int layer = 0; layer < map_layers(); layer++) {
    ivec2 block_at = block_place(layer, level), texel_at = level_place(layer, level);
    for (int block_row = first_block.y; block_row <= last_block.y; block_row++) {
      for (int block_column = first_block.x; block_column <= last_block.x; block_column++) {
        ivec2 block = ivec2(block_column, block_row);
        uvec4 known = texelFetch(blocks, block_at + block, 0);
        float highest = uintBitsToFloat(known.x) - seen.rise, lowest = uintBitsToFloat(known.y) - seen.rise;
        if (highest <= band.x || lowest > band.y) {
          continue;
        }
        float above = min(highest, band.y);
        vec2 low = (vec2(BLOCK * block) - at) * texel_size, size = float(BLOCK) * texel_size;
        if (passes_by(seen, low, low + size, above) || is_within(low, low + size, inner) ||
            is_own_surface(seen, low + 0.5 * size, texel_size, uintBitsToFloat(known.z), unpack_tilt(known.w)))
        {
          continue;
        }
        // Only texels that the light's rays to the point cross this far above it.
        ivec2 first = ivec2(floor(at + seen.bounds.xz * above / texel_size));
        ivec2 last = ivec2(floor(at + seen.bounds.yw * above / texel_size));
        ivec2 from = max(BLOCK * block, max(region.low, first));
        ivec2 to = min(BLOCK * block + BLOCK, min(region.high, last + 1));
        for (int row = from.y; row < to.y; row++) {
          for (int column = from.x; column < to.x; column++) {
            vec2 offset = vec2(column, row) - at;
            if (!is_within(offset * texel_size, (offset + 1.0) * texel_size, inner)) {
              uvec2 texel = texelFetch(texels, texel_at + ivec2(column, row), 0).xy;
              backproject_texel(seen, texel, offset, texel_size, band, hidden);
            }
          }
        }
      }
    }
  }
}
