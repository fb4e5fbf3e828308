// One join of the composite. Defines: FIRST, which starts it; LIGHT with SHADOWS, the number of layers that
// scale the light; or how a layer joins (MULTIPLY, ADD, OVER), with GREY where it has one channel. With PART
// only some of the light is summed: no alpha, and of what lies over it only what it hides.

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
#ifdef FIRST
#  ifdef PART
  vec4 sum = vec4(0.0);
#  else
  vec4 sum = vec4(0.0, 0.0, 0.0, texelFetch(albedo, pixel, 0).a);
#  endif
#else
  vec4 sum = imageLoad(total, pixel);
#  ifdef LIGHT
  float arriving = texelFetch(irradiance, pixel, 0).r;
#    if SHADOWS > 0
  arriving *= texelFetch(shadow0, pixel, 0).r;
#    endif
#    if SHADOWS > 1
  arriving *= texelFetch(shadow1, pixel, 0).r;
#    endif
#    if SHADOWS > 2
  arriving *= texelFetch(shadow2, pixel, 0).r;
#    endif
#    if SHADOWS > 3
  arriving *= texelFetch(shadow3, pixel, 0).r;
#    endif
  sum.rgb += texelFetch(albedo, pixel, 0).rgb * (arriving * params.share.rgb);
#  else
#    ifdef GREY
  vec4 joined = texelFetch(layer, pixel, 0).rrrr;
#    else
  vec4 joined = texelFetch(layer, pixel, 0);
#    endif
#    ifdef MULTIPLY
  sum.rgb *= joined.rgb;
#    endif
#    ifdef ADD
  sum.rgb += joined.rgb;
#    endif
#    ifdef OVER
#      ifdef PART
  sum = (1.0 - joined.a) * sum;
#      else
  sum = joined + (1.0 - joined.a) * sum;
#      endif
#    endif
#  endif
#endif
  imageStore(total, pixel, sum);
}
