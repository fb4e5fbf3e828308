// Points near the terminator of smooth surfaces as rays of their shadows leave them:
// kernels/src/effects/soft_shadow/raised.rs.
#include "tables.glsl"

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  vec3 place = texelFetch(position, pixel, 0).xyz;
  vec3 facing = texelFetch(geometric_normal, pixel, 0).xyz;
  vec3 lift = texelFetch(terminator_lift, pixel, 0).xyz;
  int which = int(texelFetch(instance, pixel, 0).r);
  float offset = which >= 0 ? texelFetch(offsets, table_texel(uint(which)), 0).r : 0.0;
  if (offset > 0.0 && lift != vec3(0.0)) {
    vec3 shaded = texelFetch(shading_normal, pixel, 0).xyz;
    vec3 way = params.spread.y > 0.0 ? params.light.xyz : params.light.xyz - place;
    // Of the part of the light that is lowest over the surface.
    vec2 lowest = (vec2(dot(facing, way), dot(shaded, way)) - params.spread.x) / max(length(way), 1e-30);
    float share = clamp(2.0 - (lowest.x + clamp(lowest.y, 0.0, offset)) / offset, 0.0, 1.0);
    if (share > 0.0) { // a lift may be too large for a number
      place += share * lift;
      facing = shaded;
    }
  }
  imageStore(raised_position, pixel, vec4(place, 0.0));
  imageStore(raised_normal, pixel, vec4(facing, 0.0));
}
