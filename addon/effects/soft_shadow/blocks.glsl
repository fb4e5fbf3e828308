// What is known of each block of texels, so that most need not be read: prepare.rs `Block`. One level at a time.
#include "map.glsl"

float rise_in_block(int layer, int level, ivec2 texel)
{
  bool inside = all(lessThan(texel, level_size(level)));
  return inside ? uintBitsToFloat(texelFetch(texels, level_place(layer, level) + texel, 0).x) : EMPTY;
}

float whole_slope(float slope)
{
  return is_finite(slope) ? slope : 0.0;
}

void main()
{
  int level = int(params.level.x);
  ivec2 count = block_count(level);
  ivec2 block = ivec2(gl_GlobalInvocationID.xy);
  int layer = block.y / count.y;
  block.y %= count.y;
  if (block.x >= count.x || layer >= map_layers()) {
    return;
  }
  ivec2 first = block * BLOCK;
  // The slope between opposite sides, if those are whole.
  float across = rise_in_block(layer, level, first + ivec2(BLOCK - 1, 4)) -
                 rise_in_block(layer, level, first + ivec2(0, 4));
  float along = rise_in_block(layer, level, first + ivec2(4, BLOCK - 1)) -
                rise_in_block(layer, level, first + ivec2(4, 0));
  uint slopes = pack_tilt(vec2(whole_slope(across), whole_slope(along)) / float(BLOCK - 1));
  vec2 slope = unpack_tilt(slopes);
  float highest = EMPTY, lowest = INFINITE, clear = EMPTY;
  for (int i = 0; i < BLOCK * BLOCK; i++) {
    ivec2 at = ivec2(i % BLOCK, i / BLOCK);
    float rise = rise_in_block(layer, level, first + at);
    highest = max(highest, rise);
    lowest = min(lowest, rise == EMPTY ? INFINITE : rise);
    clear = max(clear, rise - dot(slope, vec2(at) - 0.5 * float(BLOCK - 1)));
  }
  uvec3 bits = uvec3(floatBitsToUint(highest), floatBitsToUint(lowest), floatBitsToUint(clear));
  imageStore(blocks, block_place(layer, level) + block, uvec4(bits, slopes));
}
