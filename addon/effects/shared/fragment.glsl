// What every fragment stage starts with: its depth, and whether it is there at all.
#include "tables.glsl"

#ifdef PLACES
#include "scattered.glsl"
#endif

#ifdef TESTED
#include "chance.glsl"

#ifdef PLACES
vec2 uv;
float factor;

// What is interpolated elsewhere.
void find_uv()
{
  uv = vec2(0.0);
  factor = 0.0;
  for (uint i = 0u; i < 3u; i++) {
    uv += weights[i] * texelFetch(corner_uvs, table_texel(3u * ids.y + i), 0).xy;
#ifdef BY_CORNER
    factor += weights[i] * texelFetch(corner_opacity, table_texel(3u * ids.y + i), 0).x;
#endif
  }
}
#endif

// What is kept (gpu_steps.py), besides what is drawn by chance.
const float WHOLE = 0.0, PARTIAL = 1.0;

// Half a step of a picture of 8 bits: kernels/src/raster/presence.rs.
const float NEARLY = 1.0 / 512.0;

float texel_at(sampler2D texels, float column, float row, vec2 size)
{
  ivec2 texel = ivec2(mod(vec2(column, row), size));
  return texelFetch(texels, min(texel, ivec2(size) - 1), 0).r;
}

// Bilinear and repeated: kernels/src/geometry/mesh.rs `Opacity::sample`.
float sampled(sampler2D texels, vec2 at, vec2 size)
{
  if (size == vec2(1.0)) {
    return texelFetch(texels, ivec2(0), 0).r;
  }
  vec2 texel = fract(at) * size - 0.5;
  vec2 low = floor(texel), part = texel - low;
  float bottom = mix(texel_at(texels, low.x, low.y, size), texel_at(texels, low.x + 1.0, low.y, size), part.x);
  float top = mix(
      texel_at(texels, low.x, low.y + 1.0, size), texel_at(texels, low.x + 1.0, low.y + 1.0, size), part.x);
  return mix(bottom, top, part.y);
}

// Of a side whose threshold, size of texels, and whether corners count `of` has.
float opacity_of(sampler2D texels, vec4 of)
{
  float opacity = sampled(texels, uv, of.yz);
#ifdef BY_CORNER
  opacity *= of.w > 0.0 ? factor : 1.0;
#endif
  if (of.x > 0.0) {
    return opacity >= of.x ? 1.0 : 0.0;
  }
  return opacity > 0.0 ? min(opacity, 1.0) : 0.0;
}

bool is_kept()
{
  float opacity = side.y != 0u ? opacity_of(back, params.back) : opacity_of(front, params.front);
  bool is_whole = opacity >= 1.0 - NEARLY;
  if (params.rule.x == WHOLE) {
    return is_whole;
  }
  if (params.rule.x == PARTIAL) {
    return opacity > NEARLY && !is_whole;
  }
  ivec2 place = ivec2(gl_FragCoord.xy) + ivec2(params.rule.zw);
  return is_drawn(side.x, place, uint(params.rule.y), opacity);
}
#endif

// Metres along the view's forward axis. 1 / depth is affine over the image; a sliver's plane leaves the
// triangle by extrapolation, so the triangle's own range bounds it.
float fragment_depth()
{
#ifdef PLACES
  float depth = met_depth;
#elif defined(ORTHOGRAPHIC)
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
#ifdef TESTED
#ifdef PLACES
  find_uv();
#endif
  if (!is_kept()) {
    return false;
  }
#endif
  return depth <= params.range.y;
}
