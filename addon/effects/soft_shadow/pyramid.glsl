// Largest rise and largest biased rise of squares of texels, over all layers: prepare.rs `build_pyramid` and
// `halved`. With FIRST level 0, from the texels; else a level from the one below.
#include "map.glsl"

void main()
{
  int level = int(params.level.x);
  ivec2 node = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(node, node_count(level)))) {
    return;
  }
  vec2 nearest = vec2(EMPTY);
#ifdef FIRST
  for (int layer = 0; layer < map_layers(); layer++) {
    uvec2 texel = texelFetch(texels, level_place(layer, 0) + node, 0).xy;
    float rise = uintBitsToFloat(texel.x);
    float bias = rise == EMPTY ? 0.0 : gradient_bias(rise, unpack_tilt(texel.y));
    nearest = max(nearest, vec2(rise, rise - bias));
  }
#else
  ivec2 below = node_place(level - 1), last = node_count(level - 1) - 1;
  for (int i = 0; i < 4; i++) {
    ivec2 finer = min(2 * node + ivec2(i & 1, i >> 1), last);
    nearest = max(nearest, imageLoad(pyramid, below + finer).xy);
  }
#endif
  imageStore(pyramid, node_place(level) + node, vec4(nearest, 0.0, 0.0));
}
