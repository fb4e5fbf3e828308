// Where each pixel has its sample: kernels/src/raster/places.rs `pixel_offsets`, to the last bit.
//   params.size        columns and rows, and the first of either in the image
//   params.seed        in halves
//   params.dimensions  the sample's point of the sequence, both dimensions with their bits reversed, in halves
//   quantiles          of the filter along an axis, in 1/256 of a pixel
#include "chance.glsl"
#include "tables.glsl"

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  ivec2 place = pixel + ivec2(params.size.zw);
  uint key = pcg(pcg(joined(params.seed.xy) ^ uint(place.x)) ^ uint(place.y));
  uint x = scrambled(joined(params.dimensions.xy), pcg(key)), y = scrambled(joined(params.dimensions.zw), key);
  ivec2 shares = ivec2(bitfieldReverse(x) >> 20u, bitfieldReverse(y) >> 20u);
  vec2 offset = vec2(texelFetch(quantiles, ivec2(shares.x, 0), 0).r, texelFetch(quantiles, ivec2(shares.y, 0), 0).r);
  imageStore(offsets, pixel, vec4(offset / 256.0, 0.0, 0.0));
}
