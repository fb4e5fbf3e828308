// Ink where the hull lies before every surface, and on inner lines: kernels/src/effects/toon/outline.rs. Defines: LINES.
#include "tables.glsl"

const float CONTACT = 1e-6;  // kernels/src/raster/surface.rs

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  int which = -1;
  if (texelFetch(hull_depth, pixel, 0).r < texelFetch(depth, pixel, 0).r * (1.0 - CONTACT)) {
    which = int(texelFetch(hull_instance, pixel, 0).r);
  }
#ifdef LINES
  else if (texelFetch(lines, pixel, 0).r != 0u) {
    which = int(texelFetch(instance, pixel, 0).r);
  }
#endif
  vec3 colour = which >= 0 ? texelFetch(colours, table_texel(uint(which)), 0).rgb : vec3(0.0);
  imageStore(ink, pixel, vec4(colour, which >= 0 ? 1.0 : 0.0));
}
