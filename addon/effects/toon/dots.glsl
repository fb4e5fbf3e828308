// The area of round dots on a square grid of cells, exactly: kernels/src/effects/toon/dots.rs.

const float MOST_CELLS = 4.0;
const float PI = 3.14159265358979;
const float HALF_DIAGONAL = 0.70710678118655;

// To a few units in the last place (Cephes, asinf): built-in ones err by 1e-4, and areas are differences.
float arcsine(float x)
{
  float size = min(abs(x), 1.0);
  bool steep = size > 0.5;
  float z = steep ? 0.5 * (1.0 - size) : size * size;
  float root = steep ? sqrt(z) : size;
  float series = (((4.2163199048e-2 * z + 2.4181311049e-2) * z + 4.5470025998e-2) * z + 7.4953002686e-2) * z +
                 1.6666752422e-1;
  float angle = root + root * z * series;
  angle = steep ? 0.5 * PI - 2.0 * angle : angle;
  return x < 0.0 ? -angle : angle;
}

float circle_up_to(float x, float r)
{
  return 0.5 * (x * sqrt(max(r * r - x * x, 0.0)) + r * r * arcsine(x / r));
}

// Area of the disc of radius `r` about the origin within [0, x] x [0, y], signed as x * y is.
float corner_area(float x, float y, float r)
{
  float side = (x < 0.0 ? -1.0 : 1.0) * (y < 0.0 ? -1.0 : 1.0);
  x = min(abs(x), r);
  y = min(abs(y), r);
  if (x * x + y * y <= r * r) {
    return side * x * y;
  }
  float a = sqrt(max(r * r - y * y, 0.0));
  return side * (a * y + circle_up_to(x, r) - circle_up_to(a, r));
}

float disc_area(vec2 low, vec2 high, float r)
{
  return corner_area(high.x, high.y, r) - corner_area(low.x, high.y, r) - corner_area(high.x, low.y, r) +
         corner_area(low.x, low.y, r);
}

float cell_coverage(float r)
{
  if (r <= 0.5) {
    return PI * r * r;
  }
  float half_chord = sqrt(max(r * r - 0.25, 0.0));
  return PI * r * r - 4.0 * (r * r * (0.5 * PI - arcsine(0.5 / r)) - 0.5 * half_chord);
}

// Share of the rectangle `reach` to both sides of `at` (in cells) that dots of radius `r` cover.
float coverage(vec2 at, vec2 reach, float r)
{
  if (r <= 0.0) {
    return 0.0;
  }
  if (r >= HALF_DIAGONAL) {
    return 1.0;
  }
  if (!(2.0 * max(reach.x, reach.y) < MOST_CELLS)) {
    return cell_coverage(r);
  }
  reach = max(reach, vec2(1e-4));
  vec2 low = at - reach, high = at + reach;
  float area = 0.0;
  for (float row = floor(low.y); row < high.y; row += 1.0) {
    for (float column = floor(low.x); column < high.x; column += 1.0) {
      vec2 cell = vec2(column, row);
      area += disc_area(max(low, cell) - cell - 0.5, min(high, cell + 1.0) - cell - 0.5, r);
    }
  }
  return clamp(area / (4.0 * reach.x * reach.y), 0.0, 1.0);
}
