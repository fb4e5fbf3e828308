// Rows of one table into another, from the row on that `params.rows.xy` names; `zw` is how many.
#include "tables.glsl"

void main()
{
  ivec2 from = ivec2(gl_GlobalInvocationID.xy);
  uint row = uint(from.y) * 4096u + uint(from.x);
  if (from.x >= 4096 || row >= joined(params.rows.zw)) {
    return;
  }
  imageStore(table, table_texel(joined(params.rows.xy) + row), texelFetch(source, from, 0));
}
