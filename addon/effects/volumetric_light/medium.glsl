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
  seen.height = max(max(length(cross(origin, direction)), length(origin) * 5.9604645e-8), 1e-18);
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

// A spot's intensity: source.rs `Seen::intensity`. `off` = 1 - cosine.
float spot(float cosine, float off, float sine2, float own)
{
  off += 0.5 * own * cosine;
  float spread = cosine * cosine * own * own / 12.0 + 0.5 * sine2 * (own - own * own / 3.0);
  float x = clamp((params.cone.x - off) / sqrt(params.cone.y * params.cone.y + 20.0 * spread) + 0.5, 0.0, 1.0);
  return x * x * (3.0 - 2.0 * x);
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
  if (!nearby) {
#  ifdef SPOT
    float off = cosine > 0.0 ? sine2 / (1.0 + cosine) : 1.0 - cosine;
    return spot(cosine, off, sine2, fills) * phase_turned(turned, fills);
#  else
    return phase_turned(turned, fills);
#  endif
  }
  float ahead = tau / away, sine = sqrt(max(sine2, 1e-20));
  float across2 = max(1.0 - ahead * ahead, 0.0), limit = sqrt(across2);
  float level = clamp((seen.along1 - cosine * ahead) / sine, -limit, limit);
  float upright = sqrt(max(across2 - level * level, 0.0)), own = 0.05 * fills, total = 0.0;
  for (int ring = 0; ring < 2; ring++) {
    float lean = 1.0 - (fills - own) * (ring == 0 ? 0.21132487 : 0.7886751);
    float wide = sqrt(max(1.0 - lean * lean, 0.0));
    for (int turn = 0; turn < 8; turn++) {
      float angle = PI / 8.0 * float(2 * turn + 1);
      float right = wide * cos(angle), up = wide * sin(angle);
      float straight = lean * ahead + right * level + up * upright;
      float shines = phase(max(0.5 + 0.5 * straight, 0.0), own);
#  ifdef SPOT
      float here = lean * cosine + right * sine;
      shines *= spot(here, 1.0 - here, max(1.0 - here * here, 0.0), own);
#  endif
      total += shines;
    }
  }
  return total / 16.0;
#endif
}
