// What gets through the medium from the surface to the eye: upsample.rs `transmittance`.
void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  float per_depth = 1.0;
#ifndef PARALLEL
  vec2 at = params.first.xy + vec2(pixel) * params.first.zw;
  per_depth = sqrt(1.0 + dot(at, at));
#endif
  float length_m = max(min(texelFetch(depth, pixel, 0).r, 1e30) - params.range.x, 0.0) * per_depth;
  vec3 depth_here = params.extinction.xyz * length_m;
  imageStore(result, pixel, vec4(exp(-depth_here), 0.0));
}
