// The constant colour of each point's material, alpha 1; all 0 where there is no surface.
#include "tables.glsl"

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  int found = int(texelFetch(material, pixel, 0).r);
  imageStore(colour, pixel, found < 0 ? vec4(0.0) : texelFetch(colours, table_texel(uint(found)), 0));
}
