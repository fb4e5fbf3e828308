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

void main()
{
  uint triangle = joined(params.draw.xy) + uint(gl_VertexID) / 3u;
  uint corner = uint(gl_VertexID) % 3u;
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
  uv = texelFetch(corner_uvs, table_texel(3u * row + corner), 0).xy;
#ifdef BY_CORNER
  factor = texelFetch(corner_opacity, table_texel(3u * row + corner), 0).x;
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

  // Only the near plane clips: -w <= z holds from it on, and z <= w always. Beyond the far plane
  // fragments are dropped one by one, by their true depth.
#ifdef ORTHOGRAPHIC
  linear_depth = depth;
  gl_Position = vec4(
      dot(to_clip_x, position), dot(to_clip_y, position), (depth - near) * params.range.z - 1.0, 1.0);
#else
  gl_Position = vec4(dot(to_clip_x, position), dot(to_clip_y, position), depth - 2.0 * near, depth);
#endif
  bool drawable = is_finite(range.x) && is_finite(range.y) && is_finite(depths.x + depths.y + depths.z);
  if (!drawable) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  }
}
