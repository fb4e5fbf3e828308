// Floats as unsigned integers of the same order, so that integer atomics sort them.

const uint SORTABLE_INFINITE = 0xff800000u;

uint to_sortable(float x)
{
  uint bits = floatBitsToUint(x);
  return (bits & 0x80000000u) != 0u ? ~bits : bits | 0x80000000u;
}

float from_sortable(uint key)
{
  return uintBitsToFloat((key & 0x80000000u) != 0u ? key & 0x7fffffffu : ~key);
}
