// The samples in rows below n: a row for each n from 0 to 256, with the words i and i + 1 of the bitmask in texel i, so
// that one look at it serves 33 columns or more (bitmask.glsl).
#include "samples.glsl"

uint word_of(uint word, uint row)
{
  uint bits = 0u;
  for (uint bit = 0u; bit < 32u && word < uint(SAMPLES) / 32u; bit++) {
    bits |= sample_row(32u * word + bit) < row ? 1u << bit : 0u;
  }
  return bits;
}

void main()
{
  uvec2 texel = gl_GlobalInvocationID.xy;
  if (texel.x >= uint(SAMPLES) / 32u || texel.y > uint(SAMPLES)) {
    return;
  }
  imageStore(rows, ivec2(texel), uvec4(word_of(texel.x, texel.y), word_of(texel.x + 1u, texel.y), 0u, 0u));
}
