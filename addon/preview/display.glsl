// What a picture looks like. Defines: GREY for a layer of one channel; DATA where no view transform may touch it;
// SHOWN for what this has made already.
// `params.levels` is the smallest level of the view transform's table, its steps to a stop, and its size;
// `params.style` is the factor of the view's exposure; of SHOWN, whether the framebuffer encodes to sRGB itself.

void main()
{
#ifdef SHOWN
  vec4 shown = textureLod(image, at, 0.0);
  if (params.style.y > 0.0) {
    // The framebuffer encodes what it is given, by IEC 61966-2-1. Not before texels are mixed: what lies between black
    // and white is to look like grey of 0.5.
    vec3 low = shown.rgb / 12.92, high = pow((shown.rgb + 0.055) / 1.055, vec3(2.4));
    shown.rgb = mix(high, low, vec3(lessThanEqual(shown.rgb, vec3(0.04045))));
  }
#else
#  ifdef GREY
  vec4 light = vec4(textureLod(image, at, 0.0).rrr, 1.0);
#  else
  vec4 light = textureLod(image, at, 0.0);
#  endif
#  ifdef DATA
  vec4 shown = clamp(light, 0.0, 1.0);
#  else
  // Colour is premultiplied; the transform is of what the covered part looks like.
  vec3 level = max(light.rgb / max(light.a, 1e-6) * params.style.x, 0.0);
  float smallest = exp2(params.levels.x);
  vec3 place = mix(1.0 + (log2(max(level, smallest)) - params.levels.x) * params.levels.y,
                   level / smallest,
                   vec3(lessThan(level, vec3(smallest))));
  place = (clamp(place, 0.0, params.levels.z - 1.0) + 0.5) / params.levels.z;
  vec4 shown = vec4(textureLod(table, place, 0.0).rgb * light.a, light.a);
#  endif
#endif
  colour = shown;
}
