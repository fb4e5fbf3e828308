// Tables: rows of numbers laid out in a texture (upload_table in addon/devices/gpu.py).

ivec2 table_texel(uint row)
{
  return ivec2(int(row & 4095u), int(row >> 12));
}

// Integers beyond 2^24 come as a high and a low half of 16 bits.
uint joined(vec2 halves)
{
  return uint(halves.x) * 65536u + uint(halves.y);
}

#define INFINITE uintBitsToFloat(0x7f800000u)

bool is_finite(float x)
{
  return abs(x) < INFINITE;
}
