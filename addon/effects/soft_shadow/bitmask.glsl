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

// Projects the texels of the region that are nearer to the light than the point back onto the light (thesis
// eq. 5.3) and hides the samples they cover (Schwarz and Stamminger 2007). Each of a texel's four edges is
// projected from its own depth, and a texel whose middle is not above the point's tangent plane is passed over.
// The region answers for occluders whose rise is above the point's by band.x to band.y.
void backproject(Seen seen, Region region, int level, vec2 band, inout Bits hidden)
{
  vec2 texel_size = params.window.zw * float(1 << level);
  vec2 at = (seen.window - params.window.xy) / texel_size;
  vec2 start = seen.bounds.xz;
  vec2 samples = float(SAMPLES) / (seen.bounds.yw - seen.bounds.xz);
  ivec2 place = level_place(0, level);
  for (int row = region.low.y; row < region.high.y; row++) {
    for (int column = region.low.x; column < region.high.x; column++) {
      ivec2 at_layer = place + ivec2(column, row);
      for (int layer = 0; layer < map_layers(); layer++, at_layer = next_layer(at_layer)) {
        uvec2 texel = texelFetch(texels, at_layer, 0).xy;
        float rise = uintBitsToFloat(texel.x);
        float above = rise - seen.rise;
        // Layers of the finest level fall, and behind an empty one all are empty: nothing more above the point.
        if (level == 0 ? above <= 0.0 : rise == EMPTY) {
          break;
        }
        vec2 tilt = unpack_tilt(texel.y);
        if (above <= band.x || above > band.y || above <= gradient_bias(rise, tilt)) {
          continue;
        }
        vec2 offset = vec2(column, row) - at;
        // Rays from the light to the point pass it by.
        if (any(greaterThanEqual(offset * texel_size, seen.bounds.yw * above)) ||
            any(lessThanEqual((offset + 1.0) * texel_size, seen.bounds.xz * above)))
        {
          continue;
        }
        if (!clears_own_surface(seen, (offset + 0.5) * texel_size, above)) {
          continue;
        }
        vec2 edges_x = above + vec2(-0.5, 0.5) * tilt.x, edges_y = above + vec2(-0.5, 0.5) * tilt.y;
        float lowest = LOWEST_EDGE * above;
        ivec2 x = sample_range(vec2(offset.x, offset.x + 1.0), texel_size.x, edges_x, lowest, start.x, samples.x);
        ivec2 y = sample_range(vec2(offset.y, offset.y + 1.0), texel_size.y, edges_y, lowest, start.y, samples.y);
        if (x.x < x.y && y.x < y.y) {
          hide(hidden, x, y);
        }
      }
    }
  }
}
