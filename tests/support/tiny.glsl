// What tiny_effects.py computes on a GPU.

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  vec3 place = texelFetch(position, pixel, 0).xyz;
#ifdef GOBO
  imageStore(result, pixel, vec4(params.value.rgb * (0.5 + 0.5 * tanh(place.x)), 1.0));
#endif
#ifdef PANE
  imageStore(result, pixel, params.value);
#endif
#ifdef SLOPE
  imageStore(result, pixel, vec4(5.0 + params.value.x * tanh(place.x)));
#endif
#ifdef HALF
  imageStore(result, pixel, vec4(0.5));
#endif
}
