// Which fragments are there of what is partly opaque: kernels/src/random.rs `Draw`, to the last bit.

uint pcg(uint bits)
{
  uint state = bits * 747796405u + 2891336453u;
  uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
  return (word >> 22u) ^ word;
}

// Owen scrambling of bits in reverse order.
uint scrambled(uint x, uint seed)
{
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16u) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}

// What the draws of a triangle's fragments have in common.
uint key_of(uint seed, uint instance, uint triangle)
{
  return pcg(pcg(seed ^ instance) ^ triangle);
}

// Whether the fragment at a pixel or texel, of this opacity, is there in a sample of this number.
bool is_drawn(uint key, ivec2 place, uint number, float opacity)
{
  key = pcg(pcg(key ^ uint(place.x)) ^ uint(place.y));
  uint index = bitfieldReverse(scrambled(bitfieldReverse(number), pcg(key)));
  uint bits = bitfieldReverse(scrambled(index, key));
  return (float(bits >> 9u) + 0.5) * (1.0 / 8388608.0) < opacity;
}
