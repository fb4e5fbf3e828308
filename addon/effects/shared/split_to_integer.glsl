// Integers from their two 16 bit halves, low and high; textures can only be filled from floats.
void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  if (texel.x >= int(params.size.x) || texel.y >= int(params.size.y)) {
    return;
  }
  vec2 parts = texelFetch(halves, texel, 0).xy;
  imageStore(integers, texel, uvec4(uint(parts.y) * 65536u + uint(parts.x)));
}
