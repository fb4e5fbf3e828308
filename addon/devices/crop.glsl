// A part of an image: `params.size.xy` pixels from pixel `zw` on.
void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (all(lessThan(pixel, ivec2(params.size.xy)))) {
    imageStore(part, pixel, texelFetch(whole, pixel + ivec2(params.size.zw), 0));
  }
}
