// The medium and the source: medium.rs and source.rs.
//   params.extinction  extinction of red, green, blue; the anisotropy
//   params.scattering  scattering of red, green, blue; 1 if all three are integrated at once, else 0
//   params.phase       1 - |g|, |g| / 2, scale of the near field over h^2, (1 - |g|) / (1 + |g|)
//   params.light       position relative to the eye (a distant one: 0); radius
//   params.axis        of the source; 1 if it is a sphere
//   params.cone        of a spot: 1 - cos and its width where light fades, the cone's half angle, that of its even part;
//                      of an area light: spread, 1 / (spread - atan spread), cosine of the spread, unused

const float PI = 3.14159265358979;
const float BLURRED = 1.15;
#ifdef SPOT
const float NEARBY = 0.06;
#else
const float NEARBY = 0.25;
#endif
const float SHARPEST = 0.9;
const float CLOSEST_SHARE = 5.9604645e-8;

// Henyey and Greenstein's phase function; `turned` = (1 - cos) / 2 for light that mostly goes on, (1 + cos) / 2 for light
// that mostly returns; `filled` as medium.rs has it.
float phase_turned(float turned, float filled)
{
  float missing = params.phase.x + params.phase.y * filled;
  float square = missing * missing + 4.0 * (1.0 - missing) * turned;
  return missing * (2.0 - missing) / (4.0 * PI * square * sqrt(square));
}

// The same of `ahead` = (1 - cos) / 2.
float phase(float ahead, float filled)
{
  return phase_turned(params.extinction.w >= 0.0 ? ahead : 1.0 - ahead, filled);
}

// A ray as a source sees it: source.rs `Seen`.
struct Seen {
  float closest;
  float height;
  float along0, along1;
  float across0, across2, across_tau;
};

Seen seen_from_light(vec3 origin, vec3 direction)
{
  Seen seen;
  seen.closest = -dot(origin, direction);
  seen.height = max(max(length(cross(origin, direction)), (length(origin) + params.light.w) * CLOSEST_SHARE), 1e-15);
  vec3 foot = origin + seen.closest * direction;
  vec3 turn0 = cross(params.axis.xyz, foot), turn1 = cross(params.axis.xyz, direction);
  seen.across2 = dot(turn1, turn1);
  seen.across_tau = seen.across2 > 1e-12 ? -dot(turn0, turn1) / seen.across2 : 0.0;
  vec3 lowest = turn0 + seen.across_tau * turn1;
  seen.across0 = dot(lowest, lowest);
  seen.along0 = dot(params.axis.xyz, foot);
  seen.along1 = dot(params.axis.xyz, direction);
  return seen;
}

// Irradiance over intensity: source.rs `Source::falloff`.
float falloff(float away)
{
  float r = params.light.w;
  if (params.axis.w != 0.0) {
    float d = max(away, r), sine = r / d;
    return 2.0 / (d * d * (1.0 + sqrt(max(1.0 - sine * sine, 0.0))));
  }
  float slant = sqrt(away * away + r * r);
  return 2.0 / (slant * (slant + away));
}

// 1 - cos of the half angle that the source fills.
float filled(float away)
{
  return 0.5 * params.light.w * params.light.w * falloff(away);
}

float smooth_step(float x)
{
  x = clamp(x, 0.0, 1.0);
  return x * x * (3.0 - 2.0 * x);
}

// A spot's intensity: source.rs `Seen::intensity`. `off` = 1 - cosine.
float spot(float cosine, float off, float sine2, float own)
{
  off += 0.5 * own * cosine;
  float spread = cosine * cosine * own * own / 12.0 + 0.5 * sine2 * (own - own * own / 3.0);
  return smooth_step((params.cone.x - off) / sqrt(params.cone.y * params.cone.y + 20.0 * spread) + 0.5);
}

// Directions that a light nearby is taken as: lanes/light.rs `SPOT` and `EVEN`.
#ifdef SPOT
const int RINGS = 4;
const vec2 RING[RINGS] = vec2[RINGS](
    vec2(0.06943184, 0.17392742), vec2(0.33000948, 0.32607258), vec2(0.6699905, 0.32607258), vec2(0.93056816, 0.17392742));
const int TURNS = 6;
const float OWN = 0.0125;
#else
const int RINGS = 2;
const vec2 RING[RINGS] = vec2[RINGS](vec2(0.21132487, 0.5), vec2(0.7886751, 0.5));
const int TURNS = 8;
const float OWN = 0.05;
#endif

// The means over a ring of smoothstep(a + b cos), and of that times cos and times the cosine of twice the turn; b > 0.
vec3 on_ring(float a, float b)
{
  float full = clamp((1.0 - a) / b, -1.0, 1.0), none = clamp(-a / b, -1.0, 1.0);
  float from = acos(full), fading = acos(none) - from, sine = sqrt(1.0 - full * full);
  vec3 means = vec3(from, sine, sine * full);
  for (int i = 0; i < 3; i++) {
    float cosine = cos(from + (0.5 + 0.3872983 * float(i - 1)) * fading);
    float part = (i == 1 ? 4.0 : 2.5) / 9.0 * fading * smooth_step(a + b * cosine);
    means += part * vec3(1.0, cosine, 2.0 * cosine * cosine - 1.0);
  }
  return means / PI;
}

// From and to which 1 - cos a light that fills `fills` has rings that reach into a spot's cone.
vec2 lit_rings(float cosine, float sine, float off, float fills)
{
  float edge = params.cone.x + 0.5 * params.cone.y, edge_sine = sqrt(edge * (2.0 - edge));
  // 1 - cos of the difference and of the sum of the cone's half angle and the one to its axis.
  float both = off + edge - off * edge, product = sine * edge_sine;
  float low = off > edge ? max(both - product, 0.0) : 0.0;
  bool less_than_half_a_turn = sine * (1.0 - edge) + cosine * edge_sine > 0.0;
  return vec2(low, max(less_than_half_a_turn ? min(both + product, fills) : fills, low));
}

// Relative intensity times the phase function; `turned` as phase_turned has it. A light nearby is many directions:
// lanes/light.rs.
float scattered_share(Seen seen, float tau, float away, float turned, bool nearby)
{
  float fills = filled(away);
  float cosine = (seen.along0 + tau * seen.along1) / away;
  float from = tau - seen.across_tau;
  float sine2 = (seen.across0 + seen.across2 * from * from) / (away * away);
#ifdef AREA
  float facing = max(cosine, 0.0);
  if (params.cone.y != 0.0) {
    facing = max(facing * params.cone.x - sqrt(sine2), 0.0) * params.cone.y;
  }
  return facing * phase_turned(turned, fills);
#else
  float off = cosine > 0.0 ? sine2 / (1.0 + cosine) : 1.0 - cosine;
  if (!nearby) {
#  ifdef SPOT
    return spot(cosine, off, sine2, fills) * phase_turned(turned, fills);
#  else
    return phase_turned(turned, fills);
#  endif
  }
  float ahead = tau / away, sine = sqrt(max(sine2, 1e-20));
  float across2 = max(1.0 - ahead * ahead, 0.0), limit = sqrt(across2);
  float level = clamp((seen.along1 - cosine * ahead) / sine, -limit, limit);
  float upright = sqrt(max(across2 - level * level, 0.0)), own = OWN * fills, total = 0.0;
#  ifdef SPOT
  vec2 reach = lit_rings(cosine, sine, off, fills);
#  else
  vec2 reach = vec2(0.0, fills - own);
#  endif
  for (int ring = 0; ring < RINGS; ring++) {
    float apart = mix(reach.x, reach.y, RING[ring].x), lean = 1.0 - apart;
    float wide = sqrt(apart * (1.0 + lean));
    vec3 cosines = vec3(0.0);
    for (int turn = 0; turn < TURNS; turn++) {
      float angle = PI / float(TURNS) * float(2 * turn + 1);
      float right = cos(angle), up = sin(angle);
      float straight = lean * ahead + wide * (right * level + up * upright);
      float share = phase(max(0.5 + 0.5 * straight, 0.0), own);
      cosines += share * vec3(1.0, 2.0 * right, 4.0 * right * right - 2.0);
    }
#  ifdef SPOT
    float a = (params.cone.x - apart - lean * off) / params.cone.y + 0.5;
    total += RING[ring].y * dot(cosines, on_ring(a, max(wide * sine / params.cone.y, 1e-18)));
#  else
    total += RING[ring].y * cosines.x;
#  endif
  }
#  ifdef SPOT
  total *= (reach.y - reach.x) / fills;
#  endif
  return total / float(TURNS);
#endif
}
