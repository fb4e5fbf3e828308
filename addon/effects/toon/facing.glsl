// One light's part of what the ramp is looked up with: kernels/src/effects/toon/facing.rs.
//
// Defines: FIRST, where nothing was summed yet; BRIGHTNESS, where the light's irradiance is there to be summed
// as it is; SHADOWED; LINKED, where the light lights some instances only.
#include "tables.glsl"

const float AREA = 1.0;
const float SUN = 2.0;

#ifndef BRIGHTNESS
// What a surface that faces the light would count for, and the share of that which arrives.
vec2 facing(vec3 place, vec3 facing_normal)
{
  if (params.kind == SUN) {
    return vec2(params.weight, max(-dot(params.forward.xyz, facing_normal), 0.0));
  }
  vec3 to = params.centre.xyz - place;
  float squared = max(dot(to, to), 1e-20);
  float inverse = 1.0 / sqrt(squared);
  float cosine = max(dot(to, facing_normal) * inverse, 0.0);
  float along = -dot(to, params.forward.xyz) * inverse;
  float x = clamp((along - params.cone_cosine) * params.cone_sharpness, 0.0, 1.0);
  float arriving = x * x * (3.0 - 2.0 * x);
  if (params.kind == AREA) {
    float across = sqrt(max(1.0 - along * along, 0.0));
    arriving = max(along, 0.0) * max(1.0 - across / max(along, 1e-6) * params.spread_cotangent, 0.0);
  }
  return vec2(params.weight / squared, cosine * arriving);
}
#endif

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size)))) {
    return;
  }
#ifdef FIRST
  vec2 sum = vec2(0.0);
#else
  vec2 sum = imageLoad(summed, pixel).xy;
#endif
#ifdef SHADOWED
  float arrives = texelFetch(visibility, pixel, 0).r;
#else
  float arrives = 1.0;
#endif
#ifdef BRIGHTNESS
  sum += vec2(params.share * texelFetch(irradiance, pixel, 0).r * arrives, 0.0);
  sum.y = 1.0;
#else
  vec3 facing_normal = texelFetch(normal, pixel, 0).xyz;
  bool lit = facing_normal != vec3(0.0);
#  ifdef LINKED
  int which = int(texelFetch(instance, pixel, 0).r);
  lit = lit && which >= 0 && texelFetch(receives, table_texel(uint(which)), 0).r > 0.0;
#  endif
  if (lit) {
    vec2 part = facing(texelFetch(position, pixel, 0).xyz, facing_normal);
    sum += vec2(part.x * part.y * arrives, part.x);
  }
#endif
  imageStore(summed, pixel, vec4(sum, 0.0, 0.0));
}
