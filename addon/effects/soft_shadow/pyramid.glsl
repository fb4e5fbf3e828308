// Largest rise and largest biased rise of squares of texels, over all layers, from the level below: pyramid.rs. Level 0
// is made by prepare.glsl.
#include "map.glsl"

void main()
{
  int level = int(params.level);
  ivec2 node = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(node, node_count(level)))) {
    return;
  }
  vec2 nearest = vec2(EMPTY);
  ivec2 below = node_place(level - 1), last = node_count(level - 1) - 1;
  for (int i = 0; i < 4; i++) {
    ivec2 finer = min(2 * node + ivec2(i & 1, i >> 1), last);
    nearest = max(nearest, imageLoad(pyramid, below + finer).xy);
  }
  imageStore(pyramid, node_place(level) + node, vec4(nearest, 0.0, 0.0));
}
