// Inner lines: kernels/src/effects/toon/edges.rs. Defines: OBJECTS, MATERIALS, CREASES, what is looked at.
#include "tables.glsl"

int marked_at(ivec2 pixel)
{
  int which = int(texelFetch(instance, pixel, 0).r);
  return which >= 0 && texelFetch(marked, table_texel(uint(which)), 0).r > 0.0 ? which : -1;
}

void main()
{
  ivec2 inner = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(inner, ivec2(params.size.xy)))) {
    return;
  }
  ivec2 pixel = inner + int(params.size.z);
  int here = marked_at(pixel), reach = int(params.line.x);
  float middle = reach % 2 == 1 ? 0.5 : 0.0;
  float radius = length(vec2(0.5 * params.line.x, middle)) + 1e-4;
  bool found = false;
  for (int dy = -reach; here >= 0 && !found && dy <= reach; dy++) {
    for (int dx = -reach; !found && dx <= reach; dx++) {
      ivec2 other = pixel + ivec2(dx, dy);
      if (length(vec2(dx, dy) - middle) > radius) {
        continue;
      }
      int there = marked_at(other);
      if (there < 0) {
        continue;
      }
#ifdef OBJECTS
      found = found || texelFetch(object_id, other, 0).r != texelFetch(object_id, pixel, 0).r;
#endif
#ifdef MATERIALS
      found = found || texelFetch(material, other, 0).r != texelFetch(material, pixel, 0).r;
#endif
#ifdef CREASES
      vec3 a = texelFetch(shading_normal, pixel, 0).xyz, b = texelFetch(shading_normal, other, 0).xyz;
      found = found || (here == there && dot(a, b) < params.line.y);
#endif
    }
  }
  imageStore(result, inner, uvec4(found ? 1u : 0u));
}
