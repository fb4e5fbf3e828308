// From the sums of all lights to the position on the ramp.

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  vec2 sum = texelFetch(summed, pixel, 0).xy;
  float light = sum.y > 0.0 ? clamp(sum.x / sum.y, 0.0, 1.0) : 0.0;
  imageStore(result, pixel, vec4(light));
}
