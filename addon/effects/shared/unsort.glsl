// Sorted keys back to depths.
#include "sortable.glsl"

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  if (texel.x >= int(params.size.x) || texel.y >= int(params.size.y)) {
    return;
  }
  imageStore(depths, texel, vec4(from_sortable(texelFetch(sorted, texel, 0).r)));
}
