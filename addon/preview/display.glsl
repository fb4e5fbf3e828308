// What a picture looks like. Defines: GREY for a layer of one channel; DATA where no view transform may touch it;
// SHOWN for what this has made already.
// `params.levels` is the smallest level of the view transform's table, its steps to a stop, and its size;
// `params.style` is the factor of the view's exposure; of SHOWN, whether the framebuffer is that of a viewport's overlays.

#ifdef SHOWN
// An overlay's framebuffer keeps 8 bits, encoded by IEC 61966-2-1. Blender decodes them and shows their power of 1 / 2.2,
// so that the first step up from black is 6/255 on the screen: `shown` is met by mixing pixels of the two next to it.
float stored(float level)
{
  return level <= 0.04045 ? level / 12.92 : pow((level + 0.055) / 1.055, 2.4);
}

float overlaid(float shown, float threshold)
{
  float linear = pow(clamp(shown, 0.0, 1.0), 2.2);
  float level = 255.0 * (linear <= 0.0031308 ? linear * 12.92 : 1.055 * pow(linear, 1.0 / 2.4) - 0.055);
  float low = stored(floor(level) / 255.0), high = stored(min(floor(level) + 1.0, 255.0) / 255.0);
  float seen = pow(low, 1.0 / 2.2), next = pow(high, 1.0 / 2.2);
  return shown - seen > threshold * (next - seen) ? high : low;
}
#endif

void main()
{
#ifdef SHOWN
  vec4 shown = textureLod(image, at, 0.0);
  if (params.style.y > 0.0 && shown.a > 0.0) {
    float threshold = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    vec3 apart = shown.rgb / shown.a;
    for (int i = 0; i < 3; i++) {
      shown[i] = shown.a * overlaid(apart[i], threshold);
    }
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
