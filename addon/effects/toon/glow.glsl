// The toon image with what materials emit.

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  vec4 colour = texelFetch(shaded, pixel, 0);
  if (colour.a > 0.0) {
    colour.rgb += params.size.z * texelFetch(emission, pixel, 0).rgb;
  }
  imageStore(result, pixel, colour);
}
