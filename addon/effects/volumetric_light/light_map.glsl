// Lowest and highest nearness of ever larger squares of a light's depth map: map.rs `LightMap::new`. With FIRST the
// texels, from depths; else a level from the one below. Levels lie above each other, each from row
// params.level.x (the one below from params.level.y) on.
#include "map_lines.glsl"

void main()
{
  ivec2 node = ivec2(gl_GlobalInvocationID.xy);
  ivec2 count = ivec2(params.size.xy);
  if (any(greaterThanEqual(node, count))) {
    return;
  }
#ifdef FIRST
  float depth = texelFetch(depths, node, 0).r;
#  ifdef ORTHOGRAPHIC
  float near = depth < LARGEST_DEPTH ? -depth : -LARGEST_DEPTH;
#  else
  float near = depth < LARGEST_DEPTH ? 1.0 / depth : 0.0;
#  endif
  vec2 range = vec2(near);
#else
  ivec2 last = ivec2(params.size.zw) - 1;
  vec2 range = vec2(LARGEST_DEPTH, -LARGEST_DEPTH);
  for (int i = 0; i < 4; i++) {
    ivec2 finer = min(2 * node + ivec2(i & 1, i >> 1), last);
    vec2 below = imageLoad(pyramid, finer + ivec2(0, int(params.level.y))).xy;
    range = vec2(min(range.x, below.x), max(range.y, below.y));
  }
#endif
  imageStore(pyramid, node + ivec2(0, int(params.level.x)), vec4(range, 0.0, 0.0));
}
