// Where a light's 256 samples lie: light.rs `SAMPLE_ROWS`.

const int SAMPLES = 256;

const uint SCRAMBLE = 254u;

// Row of the sample in each of the 256 columns, a scrambled (0, 2)-net: Owen scrambling of the van der Corput
// sequence with Laine and Karras's hash.
uint sample_row(uint column)
{
  uint x = column + SCRAMBLE;
  x ^= x * 0x6c50b47cu;
  x ^= x * 0xb82f1e52u;
  x ^= x * 0xc7afe638u;
  x ^= x * 0x8d22f6e6u;
  return bitfieldReverse(x) >> 24;
}
