// Which of the light's samples are hidden: plain.rs `Bits`, `horizon` and `resolve`.
#include "light.glsl"

// One bit a light sample; set: hidden.
struct Bits {
  uvec4 low;
  uvec4 high;
};

// 1 at the word's place among four, else 0.
uvec4 word_in_four(uint word)
{
  return uvec4(equal(uvec4(word % 4u), uvec4(0u, 1u, 2u, 3u)));
}

// Samples at or below the geometric horizon are hidden.
Bits horizon(Seen seen)
{
  Bits hidden = Bits(uvec4(0u), uvec4(0u));
  for (uint word = 0u; word < 8u; word++) {
    uint bits = 0u;
    for (uint bit = 0u; bit < 32u; bit++) {
      vec3 direction = direction_to(seen, sample_place(seen, 32u * word + bit));
      bits |= dot(seen.geometric_normal, direction) <= 0.0 ? 1u << bit : 0u;
    }
    uvec4 here = bits * word_in_four(word);
    hidden.low |= word < 4u ? here : uvec4(0u);
    hidden.high |= word < 4u ? uvec4(0u) : here;
  }
  return hidden;
}

bool all_hidden(Bits hidden)
{
  return (hidden.low & hidden.high) == uvec4(0xffffffffu);
}

bool none_hidden(Bits hidden)
{
  return (hidden.low | hidden.high) == uvec4(0u);
}

// Share of the irradiance that is not hidden; 1 where there is none.
float resolve(Seen seen, Bits hidden)
{
  float open = 0.0, all_light = 0.0;
  for (uint word = 0u; word < 8u; word++) {
    uvec4 half_of = word < 4u ? hidden.low : hidden.high;
    uvec4 here = half_of * word_in_four(word);
    uint bits = here.x | here.y | here.z | here.w;
    for (uint bit = 0u; bit < 32u; bit++) {
      float weight = sample_weight(seen, sample_place(seen, 32u * word + bit));
      all_light += weight;
      open += (bits >> bit & 1u) == 0u ? weight : 0.0;
    }
  }
  return all_light > 0.0 ? open / all_light : 1.0;
}
