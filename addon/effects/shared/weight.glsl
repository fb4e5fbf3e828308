// What samples weigh: a colour, which is there where its alpha is, times FACTORS images, each grey where params.grey
// has 1 for it, times params.share. With LUMINANCE one number, of those coefficients; else channel by channel.
#include "scaled.glsl"

float held(float weight)
{
  return weight > 0.0 ? min(weight, params.limits.x) : 0.0; // what is no number is 0
}

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  vec4 seen = texelFetch(colour, pixel, 0);
  vec3 light = scaled(seen.rgb * params.share.rgb, pixel);
  float lowest = seen.a > 0.0 ? params.limits.y : params.limits.z;
#ifdef LUMINANCE
  imageStore(weight, pixel, vec4(held(dot(light, params.luminance.rgb)) + lowest));
#else
  imageStore(weight, pixel, vec4(held(light.r), held(light.g), held(light.b), 0.0) + lowest);
#endif
}
