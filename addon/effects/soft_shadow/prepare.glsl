// Level 0 of a map: rise and slope of every texel. prepare.rs `Source`.
#include "map.glsl"

float depth_at(int layer, ivec2 texel)
{
  ivec2 size = map_size();
  int columns = int(params.depths.x);
  return texelFetch(depths, texel + size * ivec2(layer % columns, layer / columns), 0).r;
}

float rise_of(float depth)
{
#ifdef ORTHOGRAPHIC
  return -depth;
#else
  return 1.0 / depth;
#endif
}

// Slope of the texel's surface along an axis: of the two neighbours and of their layers, the one closest in
// depth is taken to be the same surface, unless the next layer of the texel itself is closer (a thin wire).
float slope_along(ivec2 axis, int layer, ivec2 texel, float depth, float reach)
{
  float closest = reach, slope = 0.0;
  for (int side = -1; side <= 1; side += 2) {
    ivec2 neighbour = texel + side * axis;
    bool inside = all(greaterThanEqual(neighbour, ivec2(0))) && all(lessThan(neighbour, map_size()));
    for (int other = max(layer - 1, 0); inside && other < min(layer + 2, map_layers()); other++) {
      float there = depth_at(other, neighbour);
      if (abs(there - depth) < closest) {
        closest = abs(there - depth);
        slope = float(side) * (rise_of(there) - rise_of(depth));
      }
    }
  }
  return slope;
}

void main()
{
  ivec2 size = map_size();
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  int layer = texel.y / size.y;
  texel.y %= size.y;
  if (texel.x >= size.x || layer >= map_layers()) {
    return;
  }
  float depth = depth_at(layer, texel);
  float rise = EMPTY;
  uint tilt = 0u;
#ifdef ORTHOGRAPHIC
  bool holds = is_finite(depth);
#else
  bool holds = is_finite(depth) && depth > 0.0;
#endif
  if (holds) {
    rise = rise_of(depth);
    float reach = layer + 1 < map_layers() ? depth_at(layer + 1, texel) - depth : INFINITE;
    tilt = pack_tilt(vec2(slope_along(ivec2(1, 0), layer, texel, depth, reach),
                          slope_along(ivec2(0, 1), layer, texel, depth, reach)));
  }
  imageStore(texels, level_place(layer, 0) + texel, uvec4(floatBitsToUint(rise), tilt, 0u, 0u));
}
