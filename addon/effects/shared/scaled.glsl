// Light times FACTORS images, each grey where params.grey has 1 for it.

#define SCALE(light, factor, k) \
  light *= params.grey[k] > 0.5 ? texelFetch(factor, pixel, 0).rrr : texelFetch(factor, pixel, 0).rgb

vec3 scaled(vec3 light, ivec2 pixel)
{
#if FACTORS > 0
  SCALE(light, factor0, 0);
#endif
#if FACTORS > 1
  SCALE(light, factor1, 1);
#endif
#if FACTORS > 2
  SCALE(light, factor2, 2);
#endif
#if FACTORS > 3
  SCALE(light, factor3, 3);
#endif
  return light;
}
