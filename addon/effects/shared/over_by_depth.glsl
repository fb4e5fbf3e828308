// Layers that lie over the picture, sorted by depth at each pixel. STACK puts one of them and its depths into
// a stack, at rows from params.place.x on; otherwise all
// params.place.x of them are laid over what is there, the farthest first and of equally far ones the earlier. With PART only what they hide counts.

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
#ifdef STACK
  ivec2 target = pixel + ivec2(0, int(params.place.x));
  imageStore(colours_out, target, texelFetch(layer, pixel, 0));
  imageStore(depths_out, target, texelFetch(depth, pixel, 0));
#else
  int count = int(params.place.x);
  int rows = int(params.size.y);
  vec4 sum = imageLoad(total, pixel);
  float before = 0.0;
  int last = -1;
  for (int laid = 0; laid < count; laid++) {
    float farthest = 0.0;
    int next = -1;
    for (int k = 0; k < count; k++) {
      float there = texelFetch(depths, pixel + ivec2(0, k * rows), 0).r;
      bool waits = last < 0 || there < before || (there == before && k > last);
      if (waits && (next < 0 || there > farthest)) {
        farthest = there;
        next = k;
      }
    }
    if (next < 0) {
      break;
    }
    vec4 joined = texelFetch(colours, pixel + ivec2(0, next * rows), 0);
#  ifdef PART
    sum = (1.0 - joined.a) * sum;
#  else
    sum = joined + (1.0 - joined.a) * sum;
#  endif
    before = farthest;
    last = next;
  }
  imageStore(total, pixel, sum);
#endif
}
