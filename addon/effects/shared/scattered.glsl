// Whether a triangle is there where its pixel is sampled, of fragments that its grown box makes (pull.glsl). Corners are
// columns and rows from the image's middle times W, W, and depth: no edge is divided, so that none need be clipped.

vec3 weights;
float met_depth;

bool comes_first(vec4 p, vec4 q)
{
  if (p.x != q.x) {
    return p.x < q.x;
  }
  return p.y != q.y ? p.y < q.y : p.z < q.z;
}

// From the sample to a corner, times W: relative, or the differences of large numbers would decide.
vec2 from_place(vec4 corner, vec2 place)
{
  precise vec2 relative = corner.xy - place * corner.z;
  return relative;
}

// Of an edge that is given from its first corner to its second: more than 0 on its left (y up). `owns` is what lies on it.
float first_edge(vec4 p, vec4 q, vec2 place, out bool owns)
{
  vec2 a = from_place(p, place), b = from_place(q, place);
  precise float left = a.x * b.y, right = a.y * b.x, value = left - right;
  precise float along_x = a.y * q.z - p.z * b.y, along_y = p.z * b.x - a.x * q.z;
  owns = along_x > 0.0 || (along_x == 0.0 && along_y < 0.0); // as edge.rs
  return value;
}

// The same from p to q. Both triangles at an edge work out one number, whatever it rounds to, with another sign each: just
// one of them has the sample.
float edge_value(vec4 p, vec4 q, vec2 place, out bool owns)
{
  if (comes_first(p, q)) {
    return first_edge(p, q, place, owns);
  }
  float value = -first_edge(q, p, place, owns);
  owns = !owns;
  return value;
}

bool is_met()
{
  vec2 place = gl_FragCoord.xy + texelFetch(offsets, ivec2(gl_FragCoord.xy), 0).xy - 0.5 * params.places.xy;
  bvec3 owns;
  bool own[3];
  vec3 edges = vec3(edge_value(corner_b, corner_c, place, own[0]),
                    edge_value(corner_c, corner_a, place, own[1]),
                    edge_value(corner_a, corner_b, place, own[2]));
  owns = bvec3(own[0], own[1], own[2]);
  bool left = true, right = true;
  for (int i = 0; i < 3; i++) {
    left = left && (edges[i] > 0.0 || (edges[i] == 0.0 && owns[i]));
    right = right && (edges[i] < 0.0 || (edges[i] == 0.0 && !owns[i]));
  }
  // Far from 0, or squares of what is small and large would leave single precision.
  edges /= max(max(abs(edges.x), abs(edges.y)), max(abs(edges.z), 1e-37));
  float sum = edges.x + edges.y + edges.z;
  weights = edges / sum;
  met_depth = dot(weights, vec3(corner_a.w, corner_b.w, corner_c.w));
  return (left || right) && sum != 0.0 && is_finite(sum) && met_depth >= params.range.x;
}
