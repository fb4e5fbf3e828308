// Level 0 of a map, rise and slope of every texel (finest.rs), and of its pyramid (pyramid.rs). An invocation makes two
// neighbours of a row, layer by layer.
#include "map.glsl"

// Infinite beyond the map's sides and its layers.
float depth_at(int layer, ivec2 texel)
{
  ivec2 size = map_size();
  bool inside = all(greaterThanEqual(texel, ivec2(0))) && all(lessThan(texel, size)) && layer < map_layers();
  ivec2 place = inside ? texel + size * cell_of(layer, params.depth_columns) : ivec2(0);
  float depth = texelFetch(depths, place, 0).r;
  return inside ? depth : INFINITE;
}

// Around and including a pair in one layer: from left to right; below it, and above.
struct Around {
  vec4 row;
  vec2 below;
  vec2 above;
};

Around around_pair(int layer, ivec2 first)
{
  ivec2 x = ivec2(1, 0), y = ivec2(0, 1);
  return Around(vec4(depth_at(layer, first - x),
                     depth_at(layer, first),
                     depth_at(layer, first + x),
                     depth_at(layer, first + 2 * x)),
                vec2(depth_at(layer, first - y), depth_at(layer, first - y + x)),
                vec2(depth_at(layer, first + y), depth_at(layer, first + y + x)));
}

float rise_of(float depth)
{
#ifdef ORTHOGRAPHIC
  return -depth;
#else
  return 1.0 / depth;
#endif
}

// Slope of a texel's surface along an axis: of the neighbours before and after it, each in three layers, the one
// closest in depth is taken to be the same surface, unless the next layer of the texel itself is closer (a thin wire).
float slope(float depth, float behind, vec3 before, vec3 after)
{
  float closest = behind - depth, there = depth, side = 1.0;
  for (int i = 0; i < 6; i++) {
    float other = i < 3 ? before[i] : after[i - 3];
    bool closer = abs(other - depth) < closest;
    closest = closer ? abs(other - depth) : closest;
    there = closer ? other : there;
    side = closer ? (i < 3 ? -1.0 : 1.0) : side;
  }
  return side * (rise_of(there) - rise_of(depth));
}

// The bits of a texel's rise, and its tilt.
uvec2 texel_of(float depth, float behind, vec3 left, vec3 right, vec3 below, vec3 above)
{
#ifdef ORTHOGRAPHIC
  bool holds = is_finite(depth);
#else
  bool holds = is_finite(depth) && depth > 0.0;
#endif
  uint tilt = pack_tilt(vec2(slope(depth, behind, left, right), slope(depth, behind, below, above)));
  return holds ? uvec2(floatBitsToUint(rise_of(depth)), tilt) : uvec2(floatBitsToUint(EMPTY), 0u);
}

// Rise and biased rise.
vec2 node_of(uvec2 texel)
{
  float rise = uintBitsToFloat(texel.x);
  return vec2(rise, rise == EMPTY ? rise : rise - gradient_bias(rise, unpack_tilt(texel.y)));
}

void main()
{
  ivec2 size = map_size();
  ivec2 pair = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pair, pair_count(0)))) {
    return;
  }
  ivec2 first = ivec2(2 * pair.x, pair.y);
  // The layer before, this one, and the next.
  Around a = Around(vec4(INFINITE), vec2(INFINITE), vec2(INFINITE)), b = around_pair(0, first);
  vec2 nearest[2] = vec2[2](vec2(EMPTY), vec2(EMPTY));
  for (int layer = 0; layer < map_layers(); layer++) {
    Around c = around_pair(layer + 1, first);
    uvec2 even = texel_of(b.row.y,
                          c.row.y,
                          vec3(a.row.x, b.row.x, c.row.x),
                          vec3(a.row.z, b.row.z, c.row.z),
                          vec3(a.below.x, b.below.x, c.below.x),
                          vec3(a.above.x, b.above.x, c.above.x));
    uvec2 odd = texel_of(b.row.z,
                         c.row.z,
                         vec3(a.row.y, b.row.y, c.row.y),
                         vec3(a.row.w, b.row.w, c.row.w),
                         vec3(a.below.y, b.below.y, c.below.y),
                         vec3(a.above.y, b.above.y, c.above.y));
    imageStore(texels, pair_place(layer, 0) + pair, uvec4(even, odd));
    nearest[0] = max(nearest[0], node_of(even));
    nearest[1] = max(nearest[1], node_of(odd));
    a = b;
    b = c;
  }
  imageStore(pyramid, first, vec4(nearest[0], 0.0, 0.0));
  if (first.x + 1 < size.x) {
    imageStore(pyramid, first + ivec2(1, 0), vec4(nearest[1], 0.0, 0.0));
  }
}
