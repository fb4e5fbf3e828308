// Colours from a texture, repeated and bilinear, where the material is `which.x`; of them the share `which.w`.

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy))) ||
      int(texelFetch(material, pixel, 0).r) != int(params.which.x)) {
    return;
  }
  ivec2 extent = ivec2(params.which.yz);
  // Whole turns are taken off first: float32 keeps few digits of a uv far from 0.
  vec2 at = fract(texelFetch(uv, pixel, 0).rg) * params.which.yz - 0.5;
  ivec2 low = ivec2(floor(at)), high = low + 1;
  vec2 share = at - floor(at);
  low = (low + extent) % extent;
  high = (high + extent) % extent;
  vec3 bottom = mix(texelFetch(texels, low, 0).rgb, texelFetch(texels, ivec2(high.x, low.y), 0).rgb, share.x);
  vec3 top = mix(texelFetch(texels, ivec2(low.x, high.y), 0).rgb, texelFetch(texels, high, 0).rgb, share.x);
  imageStore(colour, pixel, vec4(params.which.w * mix(bottom, top, share.y), 1.0));
}
