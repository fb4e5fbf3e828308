// The medium and the source: medium.rs and source.rs.
//   params.extinction  extinction of red, green, blue; the anisotropy
//   params.scattering  scattering of red, green, blue; 1 if all three are integrated at once, else 0
//   params.phase       (1 - |g|)^2, 4 |g|, (1 - g^2) / (4 pi), (1 - |g|) / (1 + |g|)
//   params.light       position relative to the eye (a distant one: 0); radius
//   params.axis        of the source; 1 if it is a sphere
//   params.cone        cos_cone, 1 / (1 - cos_cone), 1 / blend, cosine of the inner cone; of an area light: spread,
//                      1 / (spread - atan spread), cosine of the spread, unused

// Henyey and Greenstein's phase function; `ahead` = (1 - cos) / 2.
float phase(float ahead)
{
  float turned = params.extinction.w >= 0.0 ? ahead : 1.0 - ahead;
  float square = params.phase.x + params.phase.y * turned;
  return params.phase.z / (square * sqrt(square));
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

// Relative intensity: source.rs `Seen::intensity`.
float relative_intensity(Seen seen, float tau, float away)
{
#if defined(SPOT) || defined(AREA)
  float cosine = (seen.along0 + tau * seen.along1) / away;
  float from = tau - seen.across_tau;
  float sine2 = (seen.across0 + seen.across2 * from * from) / (away * away);
#  ifdef SPOT
  float off = cosine > 0.0 ? sine2 / (1.0 + cosine) : 1.0 - cosine;
  float x = clamp((1.0 - off * params.cone.y) * params.cone.z, 0.0, 1.0);
  return x * x * (3.0 - 2.0 * x);
#  else
  float facing = max(cosine, 0.0);
  if (params.cone.y == 0.0) {
    return facing;
  }
  return max(facing * params.cone.x - sqrt(sine2), 0.0) * params.cone.y;
#  endif
#else
  return 1.0;
#endif
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
