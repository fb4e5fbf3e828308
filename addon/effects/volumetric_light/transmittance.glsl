// What gets through the medium from the surface to the eye: upsample.rs `transmittance`.
#ifdef BOUNDED
#include "spans.glsl"
#endif

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  float per_depth = 1.0;
#ifndef PARALLEL
  vec2 place = params.size.zw + vec2(pixel);
  if (params.range.y > 0.0) { // each through its pixel's own place
    place += texelFetch(offsets, pixel, 0).xy;
  }
  vec2 at = params.first.xy + place * params.first.zw;
  per_depth = sqrt(1.0 + dot(at, at));
#endif
  float end = min(texelFetch(depth, pixel, 0).r, 1e30) * per_depth, near = params.range.x * per_depth;
#ifdef BOUNDED
  float length_m = 0.0, since = near;
  int count = read_crossings(pixel, per_depth);
  bool inside = (count & 1) == 1;
  for (int i = 0; i < count; i++) {
    length_m += inside ? max(min(crossings[i], end) - max(since, near), 0.0) : 0.0;
    since = crossings[i];
    inside = !inside;
  }
#else
  float length_m = max(end - near, 0.0);
#endif
  vec3 depth_here = params.extinction.xyz * length_m;
  imageStore(result, pixel, vec4(exp(-depth_here), 0.0));
}
