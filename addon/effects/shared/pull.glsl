// Vertex stage: pulls triangle gl_VertexID / 3 of a draw list (addon/devices/gpu_geometry.py).
#include "tables.glsl"
#ifdef TESTED
#include "chance.glsl"
#endif

const uint BLOCK = 64u;

// The run that holds a triangle of the draw list: the block's first run, or one soon after it.
uint run_of(uint triangle)
{
  uint run = uint(texelFetch(blocks, table_texel(triangle / BLOCK), 0).r);
  while (joined(texelFetch(runs, table_texel(2u * run + 2u), 0).xy) <= triangle) {
    run++;
  }
  return run;
}

vec4 vertex_position(uint vertex)
{
  return vec4(texelFetch(positions, table_texel(vertex), 0).xyz, 1.0);
}

#ifdef PLACES
// Two triangles of vertices each: the box around what is beyond the near plane, grown by how far pixels are sampled
// beside their centres. Which of its fragments the triangle has is asked one by one (scattered.glsl).
const uint VERTICES = 6u;

vec4 corner_of(vec4 to_clip_x, vec4 to_clip_y, vec4 vertex, float depth)
{
  precise float x = dot(to_clip_x, vertex), y = dot(to_clip_y, vertex);
#ifdef ORTHOGRAPHIC
  float w = 1.0;
#else
  float w = depth;
#endif
  return vec4(0.5 * params.places.xy * vec2(x, y), w, depth);
}

vec4 box_corner(uint which)
{
  vec4 corners[3] = vec4[3](corner_a, corner_b, corner_c);
  vec2 low = vec2(1e30), high = vec2(-1e30);
  float near = params.range.x;
  for (int i = 0; i < 3; i++) {
    vec4 p = corners[i], q = corners[(i + 1) % 3];
    if (p.w >= near) {
      low = min(low, p.xy / p.z);
      high = max(high, p.xy / p.z);
    }
    if ((p.w >= near) != (q.w >= near)) {
      vec4 cut = mix(p, q, (near - p.w) / (q.w - p.w));
#ifdef ORTHOGRAPHIC
      float w = 1.0;
#else
      float w = near;
#endif
      vec2 rounding = 1e-6 * max(abs(p.xy), abs(q.xy)) / w;
      low = min(low, cut.xy / w - rounding);
      high = max(high, cut.xy / w + rounding);
    }
  }
  vec2 border = 0.5 * params.places.xy, reach = vec2(params.places.z);
  low = clamp(low - reach, -border, border);
  high = clamp(high + reach, -border, border);
  bool is_right = which == 1u || which == 2u || which == 4u, is_top = which == 2u || which >= 4u;
  vec2 at = vec2(is_right ? high.x : low.x, is_top ? high.y : low.y);
  return vec4(at / border, 0.0, 1.0);
}
#else
const uint VERTICES = 3u;
#endif

void main()
{
  uint triangle = joined(params.draw.xy) + uint(gl_VertexID) / VERTICES;
  uint corner = uint(gl_VertexID) % VERTICES;
  uint run = run_of(triangle);
  vec4 start_and_instance = texelFetch(runs, table_texel(2u * run), 0);
  vec4 offsets = texelFetch(runs, table_texel(2u * run + 1u), 0);
  uint instance = uint(start_and_instance.z);
  uint row = joined(offsets.xy) + triangle - joined(start_and_instance.xy);
  uvec3 vertices = uvec3(texelFetch(triangles, table_texel(row), 0).xyz) + joined(offsets.zw);

  vec4 to_clip_x = texelFetch(matrices, table_texel(3u * instance), 0);
  vec4 to_clip_y = texelFetch(matrices, table_texel(3u * instance + 1u), 0);
  vec4 to_depth = texelFetch(matrices, table_texel(3u * instance + 2u), 0);
  vec4 a = vertex_position(vertices.x), b = vertex_position(vertices.y), c = vertex_position(vertices.z);
  vec3 depths = vec3(dot(to_depth, a), dot(to_depth, b), dot(to_depth, c));
  vec4 position = corner == 0u ? a : (corner == 1u ? b : c);
  float depth = corner == 0u ? depths.x : (corner == 1u ? depths.y : depths.z);
  float near = params.range.x;
  range = vec2(max(near, min(depths.x, min(depths.y, depths.z))), max(depths.x, max(depths.y, depths.z)));
  ids = uvec2(run + 1u, row);
#ifdef TESTED
#ifndef PLACES
  uv = texelFetch(corner_uvs, table_texel(3u * row + corner), 0).xy;
#ifdef BY_CORNER
  factor = texelFetch(corner_opacity, table_texel(3u * row + corner), 0).x;
#endif
#endif
  // The eye is behind where it is so in object space, whatever the matrix turns: by the sign of what the clip
  // matrix makes of the corners' volume with the eye, over that of its own determinant.
  vec3 rows[3] = vec3[3](to_clip_x.xyz, to_clip_y.xyz, to_depth.xyz);
  vec3 ab = b.xyz - a.xyz, ac = c.xyz - a.xyz;
  ab = vec3(dot(rows[0], ab), dot(rows[1], ab), dot(rows[2], ab));
  ac = vec3(dot(rows[0], ac), dot(rows[1], ac), dot(rows[2], ac));
#ifdef ORTHOGRAPHIC
  float volume = ab.x * ac.y - ab.y * ac.x;
#else
  float volume = dot(vec3(dot(to_clip_x, a), dot(to_clip_y, a), depths.x), cross(ab, ac));
#endif
  bool is_behind = sign(volume) * sign(dot(rows[0], cross(rows[1], rows[2]))) > 0.0;
  uint number = uint(texelFetch(triangles, table_texel(row), 0).w);
  side = uvec2(key_of(joined(params.draw.zw), instance, number), is_behind ? 1u : 0u);
#endif

#ifdef PLACES
  corner_a = corner_of(to_clip_x, to_clip_y, a, depths.x);
  corner_b = corner_of(to_clip_x, to_clip_y, b, depths.y);
  corner_c = corner_of(to_clip_x, to_clip_y, c, depths.z);
  gl_Position = box_corner(corner);
#else
  // Only the near plane clips: -w <= z holds from it on, and z <= w always. Beyond the far plane
  // fragments are dropped one by one, by their true depth.
#ifdef ORTHOGRAPHIC
  linear_depth = depth;
  gl_Position = vec4(
      dot(to_clip_x, position), dot(to_clip_y, position), (depth - near) * params.range.z - 1.0, 1.0);
#else
  gl_Position = vec4(dot(to_clip_x, position), dot(to_clip_y, position), depth - 2.0 * near, depth);
#endif
#endif
  bool drawable = is_finite(range.x) && is_finite(range.y) && is_finite(depths.x + depths.y + depths.z);
  if (!drawable) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  }
}
