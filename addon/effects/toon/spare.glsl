// Paper where toon leaves a surface to the picture below.

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  bool is_shaded = texelFetch(shaded, pixel, 0).a > 0.0;
  imageStore(result, pixel, vec4(is_shaded ? texelFetch(dots, pixel, 0).r : 1.0));
}
