// Colours times what corners carry, where the material is by corner.
#include "tables.glsl"

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  int found = int(texelFetch(material, pixel, 0).r);
  if (found < 0 || texelFetch(by_corner, table_texel(uint(found)), 0).r == 0.0) {
    return;
  }
  vec4 before = imageLoad(colour, pixel);
  imageStore(colour, pixel, vec4(before.rgb * texelFetch(corner_colour, pixel, 0).rgb, before.a));
}
