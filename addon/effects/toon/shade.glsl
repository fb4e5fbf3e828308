// The ramp's colour over the material's: kernels/src/effects/toon/shade.rs and ramp.rs.
//
// Defines: BASE, where base colour comes by pixel; BY_INSTANCE, where instances have ramps; RIM.
#include "tables.glsl"

const float SOFT_LIGHT = 0.0;
const float MULTIPLY = 1.0;
const int EXCLUDED = -2;
const int BY_MATERIAL = -1;

vec4 ramp_at(int ramp, float at)
{
  vec4 range = texelFetch(ranges, table_texel(uint(ramp)), 0);
  int piece = int(range.x), end = int(range.x + range.y);
  while (piece + 1 < end && texelFetch(pieces, table_texel(5u * uint(piece + 1)), 0).x <= at) {
    piece++;
  }
  uint row = 5u * uint(piece);
  float x = max(at - texelFetch(pieces, table_texel(row), 0).x, 0.0);
  vec4 value = texelFetch(pieces, table_texel(row + 4u), 0);
  for (uint power = 3u; power > 0u; power--) {
    value = value * x + texelFetch(pieces, table_texel(row + power), 0);
  }
  return range.z > 0.0 ? clamp(value, 0.0, 1.0) : value;
}

vec3 mixed(vec3 base, vec3 ramp)
{
  if (params.mix == SOFT_LIGHT) {
    vec3 a = clamp(base, 0.0, 1.0), b = clamp(0.5 * ramp, 0.0, 1.0);
    vec3 dark = 2.0 * a * b + a * a * (1.0 - 2.0 * b);
    vec3 bright = 2.0 * a * (1.0 - b) + sqrt(a) * (2.0 * b - 1.0);
    return mix(dark, bright, vec3(greaterThan(b, vec3(0.5))));
  }
  return params.mix == MULTIPLY ? base * ramp : ramp;
}

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size)))) {
    return;
  }
  vec4 result = vec4(0.0);
  int made_of = int(texelFetch(material, pixel, 0).r);
  if (made_of >= 0) {
    vec4 base_and_ramp = texelFetch(materials, table_texel(2u * uint(made_of)), 0);
    int chosen = int(base_and_ramp.w);
#ifdef BY_INSTANCE
    int own = int(texelFetch(instance_ramps, table_texel(texelFetch(instance, pixel, 0).r), 0).r);
    chosen = own == BY_MATERIAL || chosen == EXCLUDED ? chosen : own;
#endif
    if (chosen != EXCLUDED) {
      vec4 colour = ramp_at(chosen, clamp(texelFetch(light, pixel, 0).r, 0.0, 1.0));
#ifdef BASE
      vec3 base_colour = texelFetch(base, pixel, 0).rgb;
#else
      vec3 base_colour = base_and_ramp.rgb;
#endif
      vec3 rgb = base_colour + (mixed(base_colour, colour.rgb) - base_colour) * colour.a;
#ifdef RIM
      vec3 towards = params.orthographic > 0.0 ? params.forward.xyz : texelFetch(position, pixel, 0).xyz;
      float cosine = abs(dot(towards, texelFetch(normal, pixel, 0).xyz)) / length(towards);
      if (cosine < params.rim_width) {
        rgb = mix(rgb, params.rim_color.rgb, params.rim_strength);
      }
#endif
      rgb += texelFetch(materials, table_texel(2u * uint(made_of) + 1u), 0).rgb * params.emission;
      result = vec4(rgb, 1.0);
    }
  }
  imageStore(colour_out, pixel, result);
}
