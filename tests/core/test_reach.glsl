void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (all(lessThan(pixel, ivec2(params.size.xy)))) {
    int reach = int(params.size.z);
    float there = texelFetch(depth, pixel + 2 * reach, 0).r, before = texelFetch(depth, pixel, 0).r;
    imageStore(result, pixel, vec4(there - before));
  }
}
