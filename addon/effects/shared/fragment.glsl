// What every fragment stage starts with: its depth, and whether it is there at all.
#include "tables.glsl"

#ifdef ALPHA
float alpha_at(float column, float row, vec2 size)
{
  ivec2 texel = ivec2(mod(vec2(column, row), size));
  return texelFetch(alpha, min(texel, ivec2(size) - 1), 0).r;
}

// Bilinear and repeated: kernels/src/geometry/mesh.rs `Cutout::sample`.
float alpha_sample(vec2 at)
{
  vec2 size = params.alpha.yz;
  vec2 texel = fract(at) * size - 0.5;
  vec2 low = floor(texel), part = texel - low;
  float bottom = mix(alpha_at(low.x, low.y, size), alpha_at(low.x + 1.0, low.y, size), part.x);
  float top = mix(alpha_at(low.x, low.y + 1.0, size), alpha_at(low.x + 1.0, low.y + 1.0, size), part.x);
  return mix(bottom, top, part.y);
}
#endif

// Metres along the view's forward axis. 1 / depth is affine over the image; a sliver's plane leaves the
// triangle by extrapolation, so the triangle's own range bounds it.
float fragment_depth()
{
#ifdef ORTHOGRAPHIC
  float depth = linear_depth;
#else
  float depth = 1.0 / gl_FragCoord.w;
#endif
  // Written so that NaN becomes the nearest depth.
  depth = depth > range.x ? depth : range.x;
  return depth < range.y ? depth : range.y;
}

bool is_there(float depth)
{
#ifdef ALPHA
  if (alpha_sample(uv) < params.alpha.x) {
    return false;
  }
#endif
  return depth <= params.range.y;
}
