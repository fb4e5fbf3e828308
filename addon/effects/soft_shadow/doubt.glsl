// Where a map is too coarse to be believed, around the point's own texel: doubt.rs.
#include "light.glsl"
#include "texel.glsl"

// Distance of a texel's middle from the tangent plane, in texels, up to which it is the point's own surface.
const float OWN = 0.5;
// Distance above the tangent plane, in texels, from which an occluder is large enough to be believed.
const float CONTACT = 16.0;
// Distance above the tangent plane, in texels, from which a texel shades the place beneath it.
const float SHADES = 0.15;
// Texels that the light covers, seen past an occluder, from which that one's edge is a penumbra to the map.
const float HARD = 4.0;

// Whether rays are to look in place of the map. With DOUBT where one of the 3 x 3 texels around the point does not know
// the point's surface (it bends, ends, or lies under more layers than are kept), or knows an occluder almost in contact with
// it. With that or EDGES where some are shaded and some are not, past an occluder so close that two texels cover the light.
bool is_doubtful(Seen seen)
{
  vec2 texel_size = params.texel_size;
  vec2 at = (seen.window - params.window_low) / texel_size;
  vec2 middle = floor(at);
  bool inside = all(greaterThanEqual(middle, vec2(1.0))) && all(lessThanEqual(middle + 2.0, vec2(map_size())));
  float texel = max(texel_size.x, texel_size.y);
  bool contact = !inside; // also where the place is not a number
  int shaded = 0;
  float nearest = INFINITE, along = dot(seen.geometric_normal, seen.base);
  for (int i = 0; i < 9 && inside; i++) {
    vec2 place = middle + vec2(i % 3 - 1, i / 3 - 1);
    vec2 across = (place + 0.5 - at) * texel_size;
    bool own = false, shades = false;
    for (int layer = 0; layer < map_layers(); layer++) {
      float above = uintBitsToFloat(texel_at(layer, 0, ivec2(place)).x) - seen.rise;
      // Of the texel's surface, times its rise: then a texel is `texel` long.
      float height = dot(seen.geometric_normal.xy, across) - above * along;
      own = own || abs(height) <= OWN * texel;
      contact = contact || (height > OWN * texel && height <= CONTACT * texel);
      if (height > SHADES * texel && above > seen.rounding) {
        shades = true;
        nearest = min(nearest, above);
      }
    }
    contact = contact || !own;
    shaded += shades ? 1 : 0;
  }
  vec2 light = (seen.bounds.yw - seen.bounds.xz) / texel_size;
  bool at_hard_edge = shaded > 0 && shaded < 9 && nearest < sqrt(HARD / (light.x * light.y));
#ifdef DOUBT
  return contact || at_hard_edge;
#else
  return at_hard_edge;
#endif
}
