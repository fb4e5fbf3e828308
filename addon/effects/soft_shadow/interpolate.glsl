// Points between evaluated ones: interpolate.rs, which says what the constants mean.

const float WIDEST = 0.1;
const float ALIKE = 0.99;
const float FLAT = 0.02;

bool on_one_surface(vec3 place, vec3 facing, vec3 shaded, ivec2 corner)
{
  vec3 way = texelFetch(position, corner, 0).xyz - place;
  float off = dot(facing, way);
  // Written so that a NaN is no surface.
  return dot(facing, texelFetch(geometric_normal, corner, 0).xyz) >= ALIKE &&
         dot(shaded, texelFetch(shading_normal, corner, 0).xyz) >= ALIKE && off * off <= FLAT * FLAT * dot(way, way);
}

// Whether the visibility of a point, `share`, follows from the corners of its cell of the grid of evaluated points.
bool is_interpolated(ivec2 pixel, out float share)
{
  int spacing = int(params.spacing);
  ivec2 cell = pixel / spacing * spacing;
  vec2 part = vec2(pixel - cell) / float(spacing);
  // On a line of the grid two of the corners do not count.
  ivec2 far = ivec2(greaterThan(part, vec2(0.0)));
  vec3 place = texelFetch(position, pixel, 0).xyz;
  vec3 facing = texelFetch(geometric_normal, pixel, 0).xyz;
  vec3 shaded = texelFetch(shading_normal, pixel, 0).xyz;
  vec2 range = vec2(1.0, 0.0); // lowest and highest so far; V is within
  share = 0.0;
  for (int i = 0; i <= far.y; i++) {
    for (int j = 0; j <= far.x; j++) {
      ivec2 corner = cell + ivec2(j, i) * spacing;
      if (any(greaterThanEqual(corner, ivec2(params.size))) || !on_one_surface(place, facing, shaded, corner) ||
          imageLoad(uncertain, corner).r != 0u)
      {
        return false;
      }
      float value = imageLoad(visibility, corner).r;
      range = vec2(min(range.x, value), max(range.y, value));
      share += (j == 1 ? part.x : 1.0 - part.x) * (i == 1 ? part.y : 1.0 - part.y) * value;
    }
  }
  return range.y - range.x <= WIDEST;
}
