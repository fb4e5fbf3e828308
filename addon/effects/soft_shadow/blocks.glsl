// What is known of each block of texels of all levels, so that most need not be read: prepare.rs `Block`.
// The highest rise is that of deeper layers too: what even that does not reach is never reached there.
#include "texel.glsl"

// Whole where it is no number.
float whole_slope(float slope)
{
  return is_finite(slope) ? slope : 0.0;
}

float rise_at(int layer, int level, ivec2 texel)
{
  return uintBitsToFloat(texel_at(layer, level, texel).x);
}

void main()
{
  ivec2 place = ivec2(gl_GlobalInvocationID.xy);
  int level = level_at(block_count(0), place);
  ivec2 block = place - level_place(block_count(0), level);
  if (level >= int(params.levels) || any(greaterThanEqual(block, block_count(level)))) {
    return;
  }
  ivec2 first = block * BLOCK, size = level_size(level);
  bool is_whole = all(lessThanEqual(first + BLOCK, size));
  ivec2 inside = min(size - first, ivec2(BLOCK));
  float middle = 0.5 * float(BLOCK - 1);
  float highest = EMPTY;
  for (int layer = map_layers() - 1; layer >= 0; layer--) {
    // The slope between opposite sides, if those are whole.
    vec2 change = vec2(0.0);
    if (is_whole) {
      change.x = rise_at(layer, level, first + ivec2(BLOCK - 1, 4)) - rise_at(layer, level, first + ivec2(0, 4));
      change.y = rise_at(layer, level, first + ivec2(4, BLOCK - 1)) - rise_at(layer, level, first + ivec2(4, 0));
    }
    uint slopes = pack_tilt(vec2(whole_slope(change.x), whole_slope(change.y)) / float(BLOCK - 1));
    vec2 slope = unpack_tilt(slopes);
    float lowest = INFINITE, clear = EMPTY;
    ivec2 pairs = pair_place(layer, level) + ivec2(first.x >> 1, first.y);
    for (int row = 0; row < inside.y; row++) {
      for (int column = 0; column < inside.x; column += 2) {
        uvec4 pair = texelFetch(texels, pairs + ivec2(column >> 1, row), 0);
        vec2 rise = uintBitsToFloat(pair.xz); // the odd one beyond the side is EMPTY
        vec2 over = rise - (slope.x * (float(column) + vec2(0.0, 1.0) - middle) + slope.y * (float(row) - middle));
        highest = max(highest, max(rise.x, rise.y));
        clear = max(clear, max(over.x, over.y));
        lowest = min(lowest, rise.x == EMPTY ? INFINITE : rise.x);
        lowest = min(lowest, rise.y == EMPTY ? INFINITE : rise.y);
      }
    }
    uvec3 bits = uvec3(floatBitsToUint(highest), floatBitsToUint(lowest), floatBitsToUint(clear));
    imageStore(blocks, block_place(layer, level) + block, uvec4(bits, slopes));
  }
}
