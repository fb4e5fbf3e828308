// Light scattered along a stretch of a ray: integral.rs and lanes.rs, whose comments explain it. GLSL has neither
// expm1 nor log1p: where they would be needed the forms below keep their digits.
#include "medium.glsl"

#if defined(SPOT) || defined(AREA)
const float PANEL_WIDTH = 0.6;
#else
const float PANEL_WIDTH = 2.0;
#endif
const float NEARBY_WIDTH = 0.3;  // of spots
const float PANEL_DEPTH = 6.0;
#ifdef LOOKED_UP
const float OPAQUE = 100.0;  // of light from outside s grows faster than what it goes through
#else
const float OPAQUE = 20.0;
#endif
const int MOST_PANELS = 256;
const float LEAST_SCALE = 1e-6;
const float MOST_GROWTH = 1e9;

// (1 - exp(-x)) / x.
float mean_transmittance(float x)
{
  float thin = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0)));
  return x < 0.25 ? thin : (1.0 - exp(-x)) / x;
}

// ln(1 + x) for x >= 0.
float log_1p(float x)
{
  float series = x * (1.0 - x * (0.5 - x * (1.0 / 3.0 - x * (0.25 - x * 0.2))));
  return x < 0.02 ? series : log(1.0 + x);
}

// sinh for |x| <= 1.
float small_sinh(float x)
{
  float x2 = x * x;
  return x * (1.0 + x2 / 6.0 * (1.0 + x2 / 20.0 * (1.0 + x2 / 42.0 * (1.0 + x2 / 72.0))));
}

// What z grows by, and its slope, `d` further in y: lanes.rs `further`.
vec2 further(float start, float slope, float d)
{
  float s = small_sinh(0.5 * d), c = sqrt(1.0 + s * s);
  return vec2(2.0 * s * (slope * c + start * s), slope + 2.0 * s * (slope * s + start * c));
}

// A stretch from `tau` on, `length_m` metres long, `travelled` metres of medium until there (where the light's way is
// looked up: along the ray only); channels whose extinctions lie between `low` and `high`.
vec3 near_group(Seen seen, float tau, float length_m, float travelled, float low, float high)
{
  float h = max(seen.height, CLOSEST_SHARE * tau);
  float tau1 = tau + length_m;
  float d0 = sqrt(h * h + tau * tau), d1 = sqrt(h * h + tau1 * tau1);
  float sum0 = d0 + abs(tau), sum1 = d1 + abs(tau1);
  float z0 = tau > 0.0 ? sum0 / h : h / sum0, z1 = tau1 > 0.0 ? sum1 / h : h / sum1;
  float change = min(length_m * ((z0 + z1) / (d0 + d1)), MOST_GROWTH * (1.0 + z0));
  if (low > 0.0) {
    change = min(change, OPAQUE / low / h);
  }
  float c = params.extinction.w > 0.0 ? params.phase.w : 1.0;
  if (params.light.w > 0.0) {
    c = min(c, h * params.phase.z);
  }
  if (high > 0.0) {
    c = min(c, 1.0 / high / h);
  }
  c = max(c, LEAST_SCALE * z0);
  float a0 = z0 / c, a1 = (z0 + change) / c;
  float cosh0 = sqrt(1.0 + a0 * a0), cosh1 = sqrt(1.0 + a1 * a1);
  float width = log_1p((change / c) * (1.0 + (a0 + a1) / (cosh0 + cosh1)) / (a0 + cosh0));
  float turned = abs(params.extinction.w), widest = PANEL_WIDTH;
#ifdef LOOKED_UP
  bool nearby = false;  // as evaluate.rs, which takes moments there
#else
  bool nearby = params.light.w > NEARBY * h;
#endif
#ifdef SPOT
  widest = nearby ? NEARBY_WIDTH : widest;
#else
  nearby = nearby && turned > 0.0 && turned <= SHARPEST;
#endif
  int panels = clamp(int(ceil(max(width / widest, high * h * change / PANEL_DEPTH))), 1, MOST_PANELS);
  float step_y = width / float(panels);
  int order = int(params.walk.x);
  float start = z0, before = 0.0;
  vec3 sum = vec3(0.0);
  for (int panel = 0; panel < panels; panel++) {
    float slope = sqrt(c * c + start * start);
    for (int i = 0; i < order; i++) {
      vec2 node = texelFetch(nodes, ivec2(i, 0), 0).xy;
      vec2 grown = further(start, slope, step_y * node.x);
      float z = start + grown.x, mirrored = 1.0 / z;
      float away = 0.5 * h * (z + mirrored);
      float value = falloff(away) * (away * mirrored) * grown.y * (node.y * step_y);
      value *= scattered_share(seen, 0.5 * h * (z - mirrored), away, (params.extinction.w >= 0.0 ? z : mirrored) / (z + mirrored), nearby);
#ifdef LOOKED_UP
      float t = 0.5 * h * (z - mirrored) + seen.closest;
      float path = travelled + (t - (tau + seen.closest)) + way_travelled(ray.origin + t * ray.direction);
      sum += value * exp(-params.extinction.xyz * path);
#else
      sum += value * exp(-params.extinction.xyz * h * (before + grown.x));
#endif
    }
    before += further(start, slope, step_y).x;
    start = z0 + before;
  }
#ifdef LOOKED_UP
  return sum;
#else
  return sum * exp(-params.extinction.xyz * travelled);
#endif
}

vec3 near_light(Seen seen, float tau, float length_m, float travelled)
{
  vec3 e = params.extinction.xyz;
  float low = min(e.x, min(e.y, e.z)), high = max(e.x, max(e.y, e.z));
  vec3 sum;
  if (params.scattering.w != 0.0) {
    sum = near_group(seen, tau, length_m, travelled, low, high);
  }
  else {
    sum.x = near_group(seen, tau, length_m, travelled, e.x, e.x).x;
    sum.y = near_group(seen, tau, length_m, travelled, e.y, e.y).y;
    sum.z = near_group(seen, tau, length_m, travelled, e.z, e.z).z;
  }
  return sum * params.scattering.xyz;
}

// A sun's light from `from` on along the ray, `before` metres of medium before that.
vec3 distant_light(vec3 direction, float from, float before, float length_m)
{
  vec3 turn = cross(params.axis.xyz, direction);
  float along = dot(params.axis.xyz, direction);
  float small = 0.5 * dot(turn, turn) / (1.0 + abs(along));
  float value = phase(along < 0.0 ? small : 1.0 - small, 0.0);
#ifdef LOOKED_UP
  float thickest = max(params.extinction.x, max(params.extinction.y, params.extinction.z));
  int panels = int(clamp(ceil(thickest * length_m / 3.0), 1.0, 64.0));
  float step_m = length_m / float(panels);
  vec3 sum = vec3(0.0);
  for (int panel = 0; panel < panels; panel++) {
    for (int i = 0; i < int(params.walk.x); i++) {
      vec2 node = texelFetch(nodes, ivec2(i, 0), 0).xy;
      float further_m = step_m * (float(panel) + node.x);
      float path = before + further_m + way_travelled(ray.origin + (from + further_m) * direction);
      sum += node.y * step_m * exp(-params.extinction.xyz * path);
    }
  }
  return params.scattering.xyz * value * sum;
#else
  vec3 e = params.extinction.xyz * length_m;
  vec3 mean = vec3(mean_transmittance(e.x), mean_transmittance(e.y), mean_transmittance(e.z));
  return params.scattering.xyz * value * length_m * mean * exp(-params.extinction.xyz * before);
#endif
}

#ifdef TABLE
// The antiderivative at `t` metres: table.rs `Table::at`.
vec3 tabled(Seen seen, float t)
{
  float cosine = params.table.y > 0.0 ? -seen.closest / params.table.y : 1.0;
  vec2 most = vec2(textureSize(table, 0) - 1);
  vec2 at = vec2(clamp(t / params.table.x, 0.0, 1.0), clamp(sqrt(max(0.5 + 0.5 * cosine, 0.0)), 0.0, 1.0)) * most;
  ivec2 low = min(ivec2(at), ivec2(most) - 1);
  vec2 share = at - vec2(low);
  vec3 below = mix(texelFetch(table, low, 0).rgb, texelFetch(table, low + ivec2(1, 0), 0).rgb, share.x);
  vec3 above = mix(texelFetch(table, low + ivec2(0, 1), 0).rgb, texelFetch(table, low + ivec2(1, 1), 0).rgb, share.x);
  return mix(below, above, share.y);
}
#endif
