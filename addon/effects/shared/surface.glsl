// Attributes of the nearest triangle at every pixel: kernels/src/raster/hit.rs and surface.rs, in float32.
#include "tables.glsl"

const uint NOTHING = 0u;

struct Ray {
  vec3 origin;
  vec3 direction;
};

struct Hit {
  uint instance;
  uint row;
  vec3 corners[3];
  vec3 sides[2];
};

vec3 normalised(vec3 v, vec3 otherwise)
{
  float largest = max(abs(v.x), max(abs(v.y), abs(v.z)));
  vec3 scaled = v / largest; // so that squares neither overflow nor vanish
  return largest > 0.0 && is_finite(largest) ? scaled / length(scaled) : otherwise;
}

vec4 matrix_row(uint instance, uint row)
{
  return texelFetch(matrices, table_texel(6u * instance + row), 0);
}

vec3 turned(uint instance, uint first_row, vec3 v)
{
  return vec3(dot(matrix_row(instance, first_row).xyz, v),
              dot(matrix_row(instance, first_row + 1u).xyz, v),
              dot(matrix_row(instance, first_row + 2u).xyz, v));
}

Ray ray_of(ivec2 pixel)
{
  vec2 place = params.size.zw + vec2(pixel);
#ifdef PLACES
  place += texelFetch(offsets, pixel, 0).xy;
#endif
  vec2 at = params.window.xy + place * params.window.zw;
  vec3 across = params.right.xyz * at.x + params.up.xyz * at.y;
#ifdef ORTHOGRAPHIC
  return Ray(across, params.forward.xyz);
#else
  return Ray(vec3(0.0), across + params.forward.xyz);
#endif
}

vec3 local_position(uint vertex)
{
  return texelFetch(positions, table_texel(vertex), 0).xyz;
}

Hit hit_of(uint instance, uint row, uint first_vertex)
{
  uvec3 vertices = uvec3(texelFetch(triangles, table_texel(row), 0).xyz) + first_vertex;
  vec3 a = local_position(vertices.x), b = local_position(vertices.y), c = local_position(vertices.z);
  vec3 moved = vec3(matrix_row(instance, 0u).w, matrix_row(instance, 1u).w, matrix_row(instance, 2u).w);
  Hit hit;
  hit.instance = instance;
  hit.row = row;
  hit.corners = vec3[3](
      turned(instance, 0u, a) + moved, turned(instance, 0u, b) + moved, turned(instance, 0u, c) + moved);
  // Sides from object space: no digits are lost far from the eye.
  hit.sides = vec3[2](turned(instance, 0u, b - a), turned(instance, 0u, c - a));
  return hit;
}

// The point of the outline that the ray passes nearest to, as seen from the eye.
vec3 nearest_on_outline(Hit hit, Ray ray)
{
  vec3 forward = params.forward.xyz;
  float near = params.right.w;
  float best = INFINITE;
  vec3 weights = vec3(1.0, 0.0, 0.0);
  for (int i = 0; i < 3; i++) {
    int j = (i + 1) % 3;
    vec3 start = hit.corners[i] - ray.origin;
    vec3 side = i == 0 ? hit.sides[0] : (i == 1 ? hit.sides[1] - hit.sides[0] : -hit.sides[1]);
    float squared = dot(ray.direction, ray.direction);
    vec3 start_across = start - ray.direction * (dot(start, ray.direction) / squared);
    vec3 side_across = side - ray.direction * (dot(side, ray.direction) / squared);
    float depth = dot(hit.corners[i], forward), slope = dot(side, forward);
    float s = -dot(start_across, side_across) / dot(side_across, side_across);
    s = is_finite(s) ? clamp(s, 0.0, 1.0) : 0.0;
    if (depth + s * slope < near && slope != 0.0) {
      s = clamp((near - depth) / slope, 0.0, 1.0);
    }
    vec3 off = start_across + side_across * s;
#ifdef ORTHOGRAPHIC
    float away = 1.0;
#else
    float away = depth + s * slope;
#endif
    float distance = dot(off, off) / (away * away);
    if (away > 0.0 && distance < best) {
      best = distance;
      weights = vec3(0.0);
      weights[i] = 1.0 - s;
      weights[j] = s;
    }
  }
  return weights;
}

// Weights of the corners where the ray meets the triangle (Moeller and Trumbore); they never leave it.
vec3 weights_of(Hit hit, Ray ray)
{
  vec3 p = cross(ray.direction, hit.sides[1]);
  float inverse = 1.0 / dot(hit.sides[0], p);
  vec3 t = ray.origin - hit.corners[0];
  float u = dot(t, p) * inverse;
  float v = dot(ray.direction, cross(t, hit.sides[0])) * inverse;
  vec3 weights = vec3(1.0 - u - v, u, v);
  bool inside = all(greaterThanEqual(weights, vec3(0.0))) && is_finite(weights.x + weights.y + weights.z);
  return inside ? weights : nearest_on_outline(hit, ray);
}

#if defined(GEOMETRIC_NORMAL) || defined(SHADING_NORMAL) || defined(TERMINATOR_LIFT)
#define NORMALS
#endif

#ifdef NORMALS
vec3 outward_normal(Hit hit, uint first_vertex)
{
  uvec3 vertices = uvec3(texelFetch(triangles, table_texel(hit.row), 0).xyz) + first_vertex;
  vec3 a = local_position(vertices.x);
  vec3 b = local_position(vertices.y) - a, c = local_position(vertices.z) - a;
  vec3 winding = cross(normalised(b, vec3(0.0)), normalised(c, vec3(0.0)));
  return turned(hit.instance, 3u, winding) * matrix_row(hit.instance, 3u).w;
}
#endif

#ifdef TERMINATOR_LIFT
// The way from the point to the surface that the corners' normals tell of: kernels/src/raster/lift.rs.
vec3 lift_of(Hit hit, uint first_vertex, vec3 weights, vec3 facing)
{
  uvec3 vertices = uvec3(texelFetch(triangles, table_texel(hit.row), 0).xyz) + first_vertex;
  vec3 corners[3], normals[3];
  for (uint i = 0u; i < 3u; i++) {
    corners[i] = local_position(vertices[i]);
    normals[i] = texelFetch(corner_normals, table_texel(3u * hit.row + i), 0).xyz;
  }
  vec3 normal = turned(hit.instance, 0u, normals[0] * weights.x + normals[1] * weights.y + normals[2] * weights.z);
  float side = dot(normal, facing) > 0.0 ? 1.0 : -1.0;
  mat3 above; // of corner j over the plane of corner i: above[i][j]
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) {
      above[i][j] = side * dot(corners[j] - corners[i], normals[i]);
    }
  }
  float planes = INFINITE, parabola = 0.0;
  for (int i = 0; i < 3; i++) {
    float highest = max(max(above[i].x, above[i].y), max(above[i].z, 0.0));
    planes = min(planes, max(highest - dot(weights, above[i]), 0.0)); // rounding may make it less
    for (int j = 0; j < i; j++) {
      parabola -= 0.5 * weights[i] * weights[j] * (above[i][j] + above[j][i]);
    }
  }
  return normal * (side * max(planes, parabola));
}
#endif

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (pixel.x >= int(params.size.x) || pixel.y >= int(params.size.y)) {
    return;
  }
  uvec2 ids = texelFetch(nearest, pixel, 0).xy;
  vec3 place = vec3(0.0), facing = vec3(0.0), shaded = vec3(0.0), lift = vec3(0.0);
  vec2 at = vec2(0.0);
  vec3 carried = vec3(0.0);
  float along = INFINITE;
  int object = -1, which = -1, of_mesh = -1, made_of = -1;
  if (ids.x != NOTHING) {
    uint run = ids.x - 1u;
    vec4 start = texelFetch(runs, table_texel(2u * run), 0);
    uint first_vertex = joined(texelFetch(runs, table_texel(2u * run + 1u), 0).zw);
    uint instance = uint(start.z);
    Hit hit = hit_of(instance, ids.y, first_vertex);
    Ray ray = ray_of(pixel);
    vec3 weights = weights_of(hit, ray);
    place = hit.corners[0] + hit.sides[0] * weights.y + hit.sides[1] * weights.z;
    along = dot(place, params.forward.xyz);
#ifdef NORMALS
    vec3 towards = normalised(-ray.direction, vec3(0.0, 0.0, 1.0));
    vec3 outward = normalised(outward_normal(hit, first_vertex), towards);
    float turn = dot(outward, ray.direction) > 0.0 ? -1.0 : 1.0;
    facing = outward * turn;
#endif
#ifdef SHADING_NORMAL
    vec3 smooth_normal = vec3(0.0);
    for (uint i = 0u; i < 3u; i++) {
      smooth_normal += texelFetch(corner_normals, table_texel(3u * hit.row + i), 0).xyz * weights[i];
    }
    float side = matrix_row(instance, 3u).w * turn;
    shaded = normalised(turned(instance, 3u, smooth_normal) * side, facing);
#endif
#ifdef TERMINATOR_LIFT
    lift = lift_of(hit, first_vertex, weights, facing);
#endif
#ifdef UV
    for (uint i = 0u; i < 3u; i++) {
      at += texelFetch(corner_uvs, table_texel(3u * hit.row + i), 0).xy * weights[i];
    }
#endif
#ifdef CORNER_COLOUR
    for (uint i = 0u; i < 3u; i++) {
      carried += texelFetch(corner_colours, table_texel(3u * hit.row + i), 0).xyz * weights[i];
    }
#endif
    object = int(joined(vec2(matrix_row(instance, 4u).w, matrix_row(instance, 5u).w)));
    which = int(instance);
    of_mesh = int(texelFetch(triangles, table_texel(ids.y), 0).w);
    made_of = int(start.w);
#ifdef HOLDOUTS
    // A hole: but for depth as where there is nothing.
    if (texelFetch(holdouts, table_texel(instance), 0).r > 0.0) {
      place = facing = shaded = lift = carried = vec3(0.0);
      at = vec2(0.0);
      object = which = of_mesh = made_of = -1;
    }
#endif
  }
#ifdef POSITION
  imageStore(position_out, pixel, vec4(place, 0.0));
#endif
#ifdef GEOMETRIC_NORMAL
  imageStore(geometric_normal_out, pixel, vec4(facing, 0.0));
#endif
#ifdef SHADING_NORMAL
  imageStore(shading_normal_out, pixel, vec4(shaded, 0.0));
#endif
#ifdef TERMINATOR_LIFT
  imageStore(terminator_lift_out, pixel, vec4(lift, 0.0));
#endif
#ifdef DEPTH
  imageStore(depth_out, pixel, vec4(along));
#endif
#ifdef UV
  imageStore(uv_out, pixel, vec4(at, 0.0, 0.0));
#endif
#ifdef CORNER_COLOUR
  imageStore(corner_colour_out, pixel, vec4(carried, 0.0));
#endif
#ifdef OBJECT_ID
  imageStore(object_id_out, pixel, uvec4(uint(object)));
#endif
#ifdef MATERIAL
  imageStore(material_out, pixel, uvec4(uint(made_of)));
#endif
#ifdef INSTANCE
  imageStore(instance_out, pixel, uvec4(uint(which)));
#endif
#ifdef TRIANGLE
  imageStore(triangle_out, pixel, uvec4(uint(of_mesh)));
#endif
}
