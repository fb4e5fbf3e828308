// The samples in rows below n, a row of two texels for each n from 0 to 256: what bitmask.glsl hides rows by.
#include "samples.glsl"

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  if (texel.x >= 2 || texel.y > SAMPLES) {
    return;
  }
  uvec4 words = uvec4(0u);
  for (int i = 0; i < 4; i++) {
    for (uint bit = 0u; bit < 32u; bit++) {
      uint column = uint(128 * texel.x + 32 * i) + bit;
      words[i] |= sample_row(column) < uint(texel.y) ? 1u << bit : 0u;
    }
  }
  imageStore(rows, texel, words);
}
