// Visibility 1 where the light does not light the instance (light linking).
#include "tables.glsl"

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  int which = int(texelFetch(instance, pixel, 0).r);
  bool lit = which >= 0 && texelFetch(receives, table_texel(uint(which)), 0).r > 0.0;
  imageStore(result, pixel, lit ? texelFetch(visibility, pixel, 0) : vec4(1.0));
}
