// What a light sends to shading points if nothing is in the way, per unit of its radiance: the mean of sixteen
// samples of the light, as kernels/src/emitter/sample.rs places and weighs them.
//
// Defines: the emitter's kind; SINGLE for one of no size; LINKED where only some instances receive. In `params`,
// `centre`.w is tan_half_spread, `right`.w and `up`.w are half sizes, `forward`.w is the spread's scale, and
// `radiance` holds 1 - cos_cone and the blend's scale.
#include "tables.glsl"

const float PI = 3.14159265358979;
const float LARGEST = 3.0e38;

#if defined(RECTANGLE) || defined(ELLIPSE) || defined(FACING_DISK)
#  define PLANE
#endif

// Two unit vectors that are perpendicular to a unit vector and to each other (Duff et al. 2017).
void tangents(vec3 n, out vec3 a, out vec3 b)
{
  float side = n.z >= 0.0 ? 1.0 : -1.0;
  float scale = -1.0 / (side + n.z);
  float skew = n.x * n.y * scale;
  a = vec3(1.0 + side * n.x * n.x * scale, side * skew, -side * n.x);
  b = vec3(skew, side + n.y * n.y * scale, -n.y);
}

// The square to the unit disk, equal areas to equal areas (Shirley and Chiu 1997).
vec2 concentric(vec2 uv)
{
  vec2 at = 2.0 * uv - 1.0;
  bool wide = abs(at.x) > abs(at.y);
  float longer = wide ? at.x : at.y, shorter = wide ? at.y : at.x;
  float angle = 0.25 * PI * shorter / (longer == 0.0 ? 1.0 : longer);
  vec2 turned = longer * vec2(cos(angle), sin(angle));
  return wide ? turned : turned.yx;
}

// Part of a side, as shares of its half, that spread lets shine on a point whose foot is at `foot`.
vec2 within_spread(float foot, float reach, float half_size)
{
  return reach > 0.0 && half_size > 0.0 ? clamp((foot + vec2(-reach, reach)) / half_size, -1.0, 1.0) :
                                          vec2(-1.0, 1.0);
}

#if (defined(FACING_DISK) || defined(SPHERE)) && !defined(SINGLE)
#  define ROUND
#  include "spot_part.glsl"
#endif

// Relative radiance towards the point; formulas in addon/core/emitter.py.
float relative_radiance(vec3 direction)
{
  vec3 apart = direction + params.forward.xyz;
  float versine = 0.5 * dot(apart, apart); // 1 - cos a, without the cancellation
  float result = 1.0;
  if (params.centre.w < LARGEST) {
    float tangent = sqrt(versine * max(2.0 - versine, 0.0)) / max(1.0 - versine, 1e-20);
    result = max(params.centre.w - tangent, 0.0) * params.forward.w;
  }
  float x = clamp((params.radiance.x - versine) * params.radiance.y, 0.0, 1.0);
  return params.radiance.x < LARGEST ? result * x * x * (3.0 - 2.0 * x) : result;
}

float irradiance_at(vec3 point, vec3 normal)
{
  vec3 middle = params.centre.xyz - point;
  vec3 right = params.right.xyz, up = params.up.xyz, facing = params.forward.xyz;
  vec2 half_size = max(vec2(params.right.w, params.up.w), 0.0);
  vec4 part = vec4(-1.0, 1.0, -1.0, 1.0);
  float distance = length(middle);
  vec3 towards = distance > 0.0 ? middle / distance : -facing;
  float area = 1.0;
#if defined(RECTANGLE) || defined(ELLIPSE)
#  ifndef SINGLE
  float reach = params.centre.w < LARGEST ? params.centre.w * -dot(middle, facing) : -1.0;
  part.xy = within_spread(-dot(middle, right), reach, half_size.x);
  part.zw = within_spread(-dot(middle, up), reach, half_size.y);
#  endif
  vec2 sides = vec2(half_size.x > 0.0 ? 2.0 * half_size.x : 1.0, half_size.y > 0.0 ? 2.0 * half_size.y : 1.0);
  area = sides.x * sides.y * (part.y - part.x) * (part.w - part.z) / 4.0;
#endif
  bool whole = part == vec4(-1.0, 1.0, -1.0, 1.0);
#if defined(ELLIPSE) && !defined(SINGLE)
  area *= whole ? 0.25 * PI : 1.0;
#endif
#ifdef FACING_DISK
  facing = -towards;
  tangents(towards, right, up);
#  ifndef SINGLE
  bool is_cut = part_in_cone(towards, half_size.x > 0.0 ? distance / half_size.x : 0.0, 0.0, right, up, part);
  area = half_size.x * half_size.y * (is_cut ? (part.y - part.x) * (part.w - part.z) : PI);
#  endif
#endif
#ifdef SPHERE
  float sine2 = half_size.x / distance;
  sine2 *= sine2;
  float one_minus_cosine = sine2 < 1.0 ? sine2 / (1.0 + sqrt(1.0 - sine2)) : 2.0;
  tangents(towards, right, up);
#  ifdef SINGLE
  area = 1.0 / (distance * distance);
#  else
  bool is_cut = part_in_cone(towards, distance / half_size.x, one_minus_cosine, right, up, part);
  area = 2.0 * one_minus_cosine * (is_cut ? (part.y - part.x) * (part.w - part.z) : PI);
#  endif
#endif
#if defined(DISTANT_DISK) && !defined(SINGLE)
  area = PI * half_size.x * half_size.x;
#endif
  float sum = 0.0;
#ifdef SINGLE
  const int COUNT = 1;
#else
  const int COUNT = 16;
#endif
  for (int i = 0; i < COUNT; i++) {
    vec2 uv = (vec2(float(i % 4), float(i / 4)) + 0.5) / 4.0;
    float weight = 1.0;
    vec3 direction;
#ifdef RECTANGLE
    vec2 at = mix(part.xz, part.yw, uv);
#elif defined(ELLIPSE)
    vec2 at = whole ? concentric(uv) : mix(part.xz, part.yw, uv);
    weight = whole || dot(at, at) <= 1.0 ? 1.0 : 0.0;
#elif defined(ROUND)
    vec2 at = is_cut ? mix(part.xz, part.yw, uv) : concentric(uv);
    weight = !is_cut || dot(at, at) <= 1.0 ? 1.0 : 0.0;
#else
    vec2 at = concentric(uv);
#endif
#ifdef PLANE
    vec3 to_light = middle + right * (at.x * half_size.x) + up * (at.y * half_size.y);
    float inverse = 1.0 / sqrt(max(min(dot(to_light, to_light), LARGEST), 1e-30));
    direction = to_light * inverse;
    weight *= max(-dot(direction, facing), 0.0) * inverse * inverse;
#elif defined(SPHERE)
    float versine = dot(at, at) * one_minus_cosine;
    float across = sqrt(one_minus_cosine * max(2.0 - versine, 0.0));
    direction = towards * (1.0 - versine) + right * (at.x * across) + up * (at.y * across);
#else
    at *= half_size.x;
    float cosine = 1.0 / sqrt(1.0 + dot(at, at));
    direction = (-facing + right * at.x + up * at.y) * cosine;
    weight = cosine * cosine * cosine;
#endif
    weight *= max(dot(normal, direction), 0.0) * area * relative_radiance(direction);
    sum += is_finite(weight) ? weight : 0.0;
  }
  return sum / float(COUNT);
}

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  vec3 point = texelFetch(position, pixel, 0).xyz;
  vec3 normal = texelFetch(shading_normal, pixel, 0).xyz;
  bool lit = normal != vec3(0.0) && is_finite(point.x + point.y + point.z);
#ifdef LINKED
  int which = int(texelFetch(instance, pixel, 0).r);
  lit = lit && which >= 0 && texelFetch(receives, table_texel(uint(which)), 0).r > 0.0;
#endif
  imageStore(result, pixel, vec4(lit ? irradiance_at(point, normal) : 0.0));
}
