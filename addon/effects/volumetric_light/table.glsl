// One row of the source's table of the antiderivative: table.rs. A row is an angle, a column a distance.
//   params.table  reach of a row in metres, and metres from the eye to the light
#include "medium.glsl"

void main()
{
  ivec2 size = ivec2(params.size.xy);
  int row = int(gl_GlobalInvocationID.x);
  if (row >= size.y || gl_GlobalInvocationID.y > 0u) {
    return;
  }
  float v = float(row) / float(size.y - 1);
  float far = params.table.y;
  float closest = -far * (2.0 * v * v - 1.0);
  float height = far * 2.0 * v * sqrt(max(1.0 - v * v, 0.0));
  float step_m = params.table.x / float(size.x - 1);
  vec3 sum = vec3(0.0), last = vec3(0.0);
  for (int i = 0; i < size.x; i++) {
    float t = float(i) * step_m, tau = t - closest;
    float away = max(sqrt(height * height + tau * tau), 1e-9);
    float light = phase(clamp(0.5 * (1.0 + tau / away), 0.0, 1.0), filled(away)) * falloff(away);
    vec3 here = light * params.scattering.xyz * exp(-params.extinction.xyz * (t + away));
    sum += i > 0 ? 0.5 * step_m * (last + here) : vec3(0.0);
    last = here;
    imageStore(table, ivec2(i, row), vec4(sum, 0.0));
  }
}
