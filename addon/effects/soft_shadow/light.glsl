// The light as a shading point sees it, a rectangle of the light's plane holding 256 weighted samples: light.rs.
//
// All emitters share one form. In the axes of the view, directions from the point to the light are
// D = (X - base.x, Y - base.y, -base.z), where (X, Y) lies on the light's plane: the plane through the eye of a
// perspective view, the plane at unit distance of an orthographic one. Irradiance is the integral of
// L (n . D) base.z / |D|^4 dX dY over the light.
//
// Defines: ORTHOGRAPHIC (the view); ROUND (a sphere or, with FACING, a facing disk), or ELLIPTIC (an ellipse, a
// distant disk), or neither (a rectangle); SPREAD and CONE where radiance depends on direction.
#include "samples.glsl"
#include "tables.glsl"

// Share of its coordinates, turned into the view, by which a point's depth there may be off: light.rs.
const float ROUNDING = 1e-6;

// Sine of the elevation, about, below which a texel belongs to the point's own surface.
const float OWN_SURFACE = 0.01;

// Smallest half-angle (tangent) a light is given, so that a light of no size casts a hard shadow.
const float SMALLEST_HALF_SIZE = 1e-5;

// Steepness of a round light's rim: a sample stands for the area around it, so that its weight falls from 1 to 0 over
// about the distance to the next, rather than at once. Per square of the share of the radius.
const float RIM = 2.5;

struct Seen {
  vec2 window; // where the point projects, in window units
  float rise;
  float rounding; // by how much that and the rise of the point's own surface in a map may differ
  vec3 base;   // D = (X - base.x, Y - base.y, -base.z)
  vec4 bounds; // left, right, bottom, top of the samples on the light's plane; zero lies inside
  vec3 geometric_normal;
  vec3 shading_normal;
  float sin2_rim; // ROUND: squared sine of the half-angle
  bool too_close; // `bounds` had to be cut
};

vec3 to_view(vec3 v)
{
  return vec3(dot(params.axis_x.xyz, v), dot(params.axis_y.xyz, v), dot(params.axis_z.xyz, v));
}

// Planes through the point, parallel to an axis and tangent to the sphere, cut the light's plane at X with
// X^2 (z^2 - r^2) + 2 r^2 x X - r^2 (x^2 + z^2) = 0.
vec2 tangent_roots(float x, float z, float radius2)
{
  float spread = sqrt(radius2 * max(x * x + z * z - radius2, 0.0)) * z;
  float middle = -radius2 * x, scale = 1.0 / (z * z - radius2);
  return vec2(middle - spread, middle + spread) * scale;
}

// Sets the rectangle that holds the light's samples.
void bound_samples(inout Seen seen)
{
  vec3 base = seen.base;
  float smallest = SMALLEST_HALF_SIZE * base.z;
#ifdef ROUND
  float distance2 = dot(base, base);
  float sin2 = params.half_size.x * params.half_size.x / distance2;
#  ifdef FACING
  sin2 /= 1.0 + sin2; // a facing disk looks like the sphere whose rim it is
#  endif
  float largest2 = 0.64 * base.z * base.z / distance2;
  seen.too_close = sin2 > largest2;
  sin2 = clamp(sin2, smallest * smallest / distance2, largest2);
  seen.sin2_rim = sin2;
  float radius2 = sin2 * distance2;
  seen.bounds = vec4(tangent_roots(base.x, base.z, radius2), tangent_roots(base.y, base.z, radius2));
#else
  vec2 half_size = max(params.half_size, vec2(smallest));
  seen.bounds = vec4(-half_size.x, half_size.x, -half_size.y, half_size.y);
#endif
}

// False: the point is not in front of the light's plane, or is not finite.
bool see(vec3 position, vec3 geometric_normal, vec3 shading_normal, out Seen seen)
{
  vec3 at = to_view(position) + params.eye_offset.xyz;
  seen.geometric_normal = to_view(geometric_normal);
  seen.shading_normal = to_view(shading_normal);
  seen.sin2_rim = 0.0;
  seen.too_close = false;
  seen.bounds = vec4(0.0);
  float rounding = ROUNDING * (dot(abs(params.axis_z.xyz), abs(position)) + abs(params.eye_offset.z));
#ifdef ORTHOGRAPHIC
  seen.window = at.xy;
  seen.rise = -at.z;
  seen.rounding = rounding;
  seen.base = vec3(0.0, 0.0, 1.0);
  bool visible = is_finite(at.x + at.y + at.z);
#else
  seen.window = at.xy / at.z;
  seen.rise = 1.0 / at.z;
  seen.rounding = rounding * seen.rise * seen.rise;
  seen.base = at;
  bool visible = at.z > 0.0 && is_finite(seen.rise) && is_finite(at.x + at.y + at.z);
#endif
  if (visible) {
    bound_samples(seen);
  }
  return visible;
}

// From the shading point to a place on the light's plane.
vec3 direction_to(Seen seen, vec2 place)
{
  return vec3(place - seen.base.xy, -seen.base.z);
}

// Whether the middle of a texel, `place` from the point in the window, is above the tangent plane. The direction
// to where it is projected, times `above`, needs no division.
bool clears_own_surface(Seen seen, vec2 place, float above)
{
  vec3 direction = vec3(place, 0.0) - above * seen.base;
  float size = abs(direction.x) + abs(direction.y) + abs(direction.z);
  return dot(seen.geometric_normal, direction) > OWN_SURFACE * size;
}

// Where sample `i` lies on the light's plane.
vec2 sample_place(Seen seen, uint i)
{
  vec2 share = (vec2(float(i), float(sample_row(i))) + 0.5) / float(SAMPLES);
  return seen.bounds.xz + share * (seen.bounds.yw - seen.bounds.xz);
}

// Smallest and largest n . D over `bounds`; the light is above the plane of `normal` where positive.
vec2 height_range(Seen seen, vec3 normal)
{
  vec2 low = seen.bounds.xz, high = seen.bounds.yw;
  float middle = dot(normal, direction_to(seen, 0.5 * (low + high)));
  float reach = 0.5 * dot(abs(normal.xy), high - low);
  return vec2(middle - reach, middle + reach);
}

// False only where no sample has a weight: the point is below the horizon of its shading normal, or outside the light's
// cone by more than the light's own size.
bool reaches(Seen seen)
{
  // Written so that a NaN in a normal reads as no light.
  bool above = height_range(seen, seen.shading_normal).y > 0.0;
#ifdef CONE
  float sin2_rim = seen.sin2_rim * (1.0 + 0.5 / RIM), cos_cone = params.cos_cone;
  float sin2_cone = 1.0 - cos_cone * cos_cone;
  float cos_both = cos_cone * sqrt(max(1.0 - sin2_rim, 0.0)) - sqrt(sin2_cone * sin2_rim);
  // Less than a hundred-thousandth is rounding.
  return above && dot(seen.base, params.cone_axis.xyz) >= (cos_both - 1e-5) * length(seen.base);
#else
  return above;
#endif
}

// Irradiance per area of the light's plane, up to a factor that is the same for all samples.
float sample_weight(Seen seen, vec2 place)
{
  vec3 to_light = direction_to(seen, place);
  float length2 = dot(to_light, to_light);
  float weight = max(dot(seen.shading_normal, to_light), 0.0) / (length2 * length2);
  float radius2 = 0.0; // squared share of the way from the middle to the rim
#ifdef ELLIPTIC
  vec2 share = place / seen.bounds.yw;
  radius2 = dot(share, share);
#endif
#ifdef ROUND
  // The sine from the cross product with the direction to the middle: exact for the smallest lights.
  vec3 across = vec3(place * seen.base.z, place.x * seen.base.y - place.y * seen.base.x);
  radius2 = dot(across, across) / (length2 * (dot(seen.base, seen.base) * seen.sin2_rim));
#endif
  weight *= clamp(0.5 + RIM * (1.0 - radius2), 0.0, 1.0);
#ifdef SPREAD
  weight *= max(params.tan_half_spread - length(to_light.xy) / seen.base.z, 0.0);
#endif
#ifdef CONE
  float cos_axis = -dot(to_light, params.cone_axis.xyz) * inversesqrt(length2);
  float t = clamp((cos_axis - params.cos_cone) * params.cone_sharpness, 0.0, 1.0);
  weight *= t * t * (3.0 - 2.0 * t);
#endif
  return weight;
}
