// An image without `params.size.z` pixels at each side; `xy` is what is left.
void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (all(lessThan(pixel, ivec2(params.size.xy)))) {
    imageStore(part, pixel, texelFetch(whole, pixel + ivec2(params.size.z), 0));
  }
}
