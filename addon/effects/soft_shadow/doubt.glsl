// Where a map is too coarse to be believed, around the point's own texel: doubt.rs.
#include "light.glsl"
#include "texel.glsl"

// Distance of a texel's middle from the tangent plane, in texels, up to which it is the point's own surface.
const float OWN = 0.5;
// Distance above the tangent plane, in texels, from which an occluder is large enough to be believed.
const float CONTACT = 16.0;

// Whether one of the 3 x 3 texels around the point does not know the point's surface (it bends, ends, or lies under
// more layers than are kept), or knows an occluder almost in contact with it.
bool near_contact(Seen seen)
{
  vec2 texel_size = params.texel_size;
  vec2 at = (seen.window - params.window_low) / texel_size;
  vec2 middle = floor(at);
  bool inside = all(greaterThanEqual(middle, vec2(1.0))) && all(lessThanEqual(middle + 2.0, vec2(map_size())));
  float texel = max(texel_size.x, texel_size.y);
  bool unsure = !inside; // also where the place is not a number
  for (int i = 0; i < 9 && !unsure; i++) {
    vec2 place = middle + vec2(i % 3 - 1, i / 3 - 1);
    vec2 across = (place + 0.5 - at) * texel_size;
    bool own = false;
    for (int layer = 0; layer < map_layers(); layer++) {
      float above = uintBitsToFloat(texel_at(layer, 0, ivec2(place)).x) - seen.rise;
      // From the point to the texel's surface, times its rise: then a texel is `texel` long.
      float height = dot(seen.geometric_normal, vec3(across, 0.0) - above * seen.base);
      if (abs(height) <= OWN * texel) {
        own = true;
      }
      else if (height > 0.0 && height <= CONTACT * texel) {
        unsure = true;
      }
    }
    unsure = unsure || !own;
  }
  return unsure;
}
