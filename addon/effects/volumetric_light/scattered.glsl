// Adds one point of a light to the others: steps.py `_scattered`. params.size.z is 1 for the first.
void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  vec3 before = params.size.z != 0.0 ? vec3(0.0) : imageLoad(total, pixel).rgb;
  imageStore(total, pixel, vec4(before + params.share.rgb * texelFetch(part, pixel, 0).rgb, 0.0));
}
