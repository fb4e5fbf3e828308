// Which part of a spot's disk or sphere shines on a point; twin of kernels/src/emitter/cone.rs, which says why.

const float GUARD = 1e-4;
const float LARGEST_PART = 3.0;

// Angles are (sine, cosine): GPUs' inverse functions are a thousand times coarser than their arithmetic.
vec2 plus(vec2 a, vec2 b)
{
  return vec2(a.x * b.y + a.y * b.x, a.y * b.y - a.x * b.x);
}

vec2 minus(vec2 a, vec2 b)
{
  return plus(a, vec2(-b.x, b.y));
}

// Where a ray at an angle to the way meets the plane, or `beyond`, which it runs away from.
float in_plane(vec2 angle, float distance, float beyond)
{
  return angle.y > 0.0 ? distance * angle.x / angle.y : beyond;
}

float half_sine(vec2 angle)
{
  return angle.y > 0.0 ? abs(angle.x) * inversesqrt(2.0 * (1.0 + angle.y)) : sqrt(0.5 * (1.0 - angle.y));
}

// From a place x, y radii from the middle of a disk that faces the point, `distance` radii away, the point is seen
// within the cone where distance cos a - x sin a >= cos c sqrt(distance^2 + x^2 + y^2).
vec4 part_of_disk(vec2 angle, vec2 cone, float distance)
{
  vec2 inner = minus(cone, angle); // -180 to 90 degrees; their sum is 0 to 270
  float left = clamp(-in_plane(plus(cone, angle), distance, LARGEST) - GUARD, -1.0, 1.0);
  float right = clamp(in_plane(inner, distance, inner.x > 0.0 ? LARGEST : -LARGEST) + GUARD, left, 1.0);
  float nearest = left < 0.0 && 0.0 < right ? 0.0 : min(abs(left), abs(right));
  float half_side = sqrt(max(1.0 - nearest * nearest, 0.0));
  if (cone.y > 1e-6) {
    float s = angle.x / cone.y, c = angle.y / cone.y;
    vec2 ends = vec2(left, right), along = distance * c - ends * s;
    vec2 squares = along * along - distance * distance - ends * ends;
    float largest = max(squares.x, squares.y);
    float bend = s * s - 1.0, top = distance * c * s / (bend != 0.0 ? bend : 1.0);
    if (bend < 0.0 && left < top && top < right) {
      float at = distance * c - top * s;
      largest = at * at - distance * distance - top * top;
    }
    half_side = min(half_side, sqrt(max(largest, 0.0)) + GUARD);
  }
  return vec4(left, right, -half_side, half_side);
}

// Directions at an angle t from the middle lie sin(t / 2) / sin(cap / 2) from the middle of the unit disk.
vec4 part_of_cap(vec2 angle, vec2 cone, float one_minus_cosine)
{
  float scale = inversesqrt(0.5 * one_minus_cosine);
  vec2 sum = plus(angle, cone), apart = minus(angle, cone);
  bool has_opposite = sum.x <= 0.0 && sum.y < 0.0;
  float outer = has_opposite ? 1.0 : min(half_sine(sum) * scale + GUARD, 1.0);
  if (apart.x <= 0.0 || has_opposite) {
    return vec4(-outer, outer, -outer, outer);
  }
  float inner = clamp(half_sine(apart) * scale - GUARD, 0.0, outer);
  float across = clamp(cone.x / angle.x, 0.0, 1.0);
  float half_side = min(outer * across + GUARD, 1.0);
  return vec4(inner * sqrt(1.0 - across * across), outer, -half_side, half_side);
}

// Whether that is worth it: then `part` (left, right, bottom, top) lies along `right` and `up`. `radii` is the distance
// over the radius.
bool part_in_cone(vec3 towards, float radii, float one_minus_cosine, inout vec3 right, inout vec3 up, out vec4 part)
{
  part = vec4(-1.0, 1.0, -1.0, 1.0);
  if (params.radiance.x >= LARGEST || !(radii > 0.0)) {
    return false;
  }
  float cosine = -dot(params.forward.xyz, towards);
  vec3 aside = params.forward.xyz + cosine * towards;
  float sine = length(aside);
  vec2 angle = vec2(sine, cosine);
  vec2 cone = vec2(sqrt(max(params.radiance.x * (2.0 - params.radiance.x), 0.0)), 1.0 - params.radiance.x);
#ifdef SPHERE
  vec4 found = part_of_cap(angle, cone, one_minus_cosine);
  float side = -1.0;
#else
  vec4 found = part_of_disk(angle, cone, radii);
  float side = 1.0;
#endif
  if ((found.y - found.x) * (found.w - found.z) > LARGEST_PART) {
    return false;
  }
  if (sine > 1e-6) {
    right = side * aside / sine;
  }
  up = cross(towards, right);
  part = found;
  return true;
}
