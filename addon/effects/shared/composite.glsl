// One join of the composite. Defines: FIRST, which starts it; LIGHT or PRODUCT with FACTORS, the number of images
// that scale light, each grey where params.grey has 1 for it; or how a layer joins (MULTIPLY, ADD, OVER), with GREY where
// it has one channel. With PART only some of the light is summed: no alpha, and of what lies over it only what it
// hides. PRODUCT is of FACTORS images that scale light, for a lamp that has more of them than a program takes.

#ifdef FACTORS
#  include "scaled.glsl"
#endif

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
#ifdef PRODUCT
  vec4 sum = vec4(scaled(vec3(1.0), pixel), 1.0);
#elif defined(FIRST)
#  ifdef PART
  vec4 sum = vec4(0.0);
#  else
  vec4 sum = vec4(0.0, 0.0, 0.0, texelFetch(albedo, pixel, 0).a);
#  endif
#else
  vec4 sum = imageLoad(total, pixel);
#  ifdef LIGHT
  vec3 arriving = vec3(texelFetch(irradiance, pixel, 0).r);
  arriving = scaled(arriving, pixel);
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
