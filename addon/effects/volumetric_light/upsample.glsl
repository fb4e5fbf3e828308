// From a coarse image to every pixel, by weights of the four texels around it, less where their depth is another:
// upsample.rs.
const float LIKENESS = 0.02;
const float NONE = 1e37;

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  int stride = int(params.size.z);
  ivec2 count = ivec2(params.coarser.xy), offset = ivec2(params.coarser.zw);
  ivec2 seen = pixel + stride; // the depth image has as many pixels more at each side
  vec2 at = vec2(seen - offset) / float(stride);
  vec2 first = clamp(floor(at), vec2(0.0), vec2(max(count, ivec2(2)) - 2));
  vec2 share = clamp(at - first, 0.0, 1.0);
  float own = texelFetch(depth, seen, 0).r;
  vec3 sum = vec3(0.0);
  float total = 0.0;
  for (int i = 0; i < 4; i++) {
    ivec2 corner = ivec2(i & 1, i >> 1);
    ivec2 texel = min(ivec2(first) + corner, count - 1);
    float other = texelFetch(depth, texel * stride + offset, 0).r;
    float away = 0.0;  // both without a surface too
    if (own < NONE || other < NONE) {
      away = own < NONE && other < NONE ? abs(own - other) / min(own, other) / LIKENESS : 1e6;
    }
    vec2 near = mix(1.0 - share, share, vec2(corner));
    float weight = (near.x * near.y + 1e-4) / (1.0 + min(away * away, 1e12));
    total += weight;
    sum += weight * texelFetch(coarse, texel, 0).rgb;
  }
  imageStore(result, pixel, vec4(sum / total, 0.0));
}
