// How far light has come through a bounded medium to a point: spans.rs `MediumMap`. `way` holds entries and exits from
// the light.
//   params.way_map     width and height in texels, layers (0: no map), how many of them lie side by side
//   params.way_window  left, bottom, and windows per slope (metre) across and up
//   params.way_x       the map's axes, with the camera's eye in them as w

// Depth inside the medium from the map's eye to `depth`, at a texel.
float way_within(ivec2 texel, float depth)
{
  ivec2 size = ivec2(params.way_map.xy);
  int columns = int(params.way_map.w), count = 0;
  // An odd number of crossings means that light begins inside: the sums for both beginnings.
  float first_inside = 0.0, first_outside = 0.0, last = 0.0;
  for (int layer = 0; layer < int(params.way_map.z); layer++) {
    float here = texelFetch(way, texel + size * ivec2(layer % columns, layer / columns), 0).r;
    if (here > 1e37) {
      break;
    }
    float part = min(here, depth) - min(last, depth);
    if ((count & 1) == 0) {
      first_inside += part;
    }
    else {
      first_outside += part;
    }
    last = here;
    count++;
  }
  return (count & 1) == 1 ? first_inside : first_outside;
}

// `point` relative to the camera's eye.
float way_travelled(vec3 point)
{
  vec3 p = vec3(dot(params.way_x.xyz, point) + params.way_x.w,
                dot(params.way_y.xyz, point) + params.way_y.w,
                dot(params.way_z.xyz, point) + params.way_z.w);
#ifdef DISTANT
  vec2 slope = p.xy;
  float slant = 1.0;
#else
  vec2 slope = p.xy / max(p.z, 1e-30);
  float slant = sqrt(1.0 + dot(slope, slope));
  if (p.z <= 0.0) {
    return 0.0;
  }
#endif
  vec2 share = (slope - params.way_window.xy) * params.way_window.zw;
  // Shadows of other points of the light are cut into cube faces a little elsewhere.
  if (params.way_map.z == 0.0 || any(lessThan(share, vec2(-0.01))) || any(greaterThan(share, vec2(1.01)))) {
    return 0.0;
  }
  vec2 at = share * params.way_map.xy - 0.5, low = floor(at), near = at - low;
  ivec2 last = ivec2(params.way_map.xy) - 1;
  float sum = 0.0;
  for (int i = 0; i < 4; i++) {
    ivec2 corner = ivec2(i & 1, i >> 1);
    vec2 weight = mix(1.0 - near, near, vec2(corner));
    sum += weight.x * weight.y * way_within(clamp(ivec2(low) + corner, ivec2(0), last), p.z);
  }
  return sum * slant;
}
