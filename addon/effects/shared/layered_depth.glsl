// The nearest depths of every texel in one pass: a k-buffer kept sorted by atomics (thesis 4.3).
#include "fragment.glsl"
#include "sortable.glsl"

void main()
{
  nothing = uvec2(0u);
  float depth = fragment_depth();
  if (!is_there(depth)) {
    return; // what lands in `nothing` is never read
  }
  // Each layer keeps the smaller of its depth and what falls on it, and passes the other on. Whatever the
  // order of arrival, layer n ends with the n-th smallest of all fragments.
  uint falling = to_sortable(depth);
  ivec2 texel = ivec2(gl_FragCoord.xy);
  // Reading costs a fraction of an atomic. What is kept only ever falls, so that even a value read too early tells
  // that a depth is not among the nearest.
  if (imageLoad(sorted, texel + ivec2(params.last.xy)).r <= falling) {
    return;
  }
  ivec2 size = ivec2(params.map.xy);
  int right = size.x * int(params.map.z);
  for (int layers = int(params.map.w); layers > 0; layers--) {
    if (imageLoad(sorted, texel).r > falling) {
      falling = max(imageAtomicMin(sorted, texel, falling), falling);
      if (falling == SORTABLE_INFINITE) {
        break;
      }
    }
    // The next layer lies to the right, or starts a row of layers.
    texel.x += size.x;
    if (texel.x >= right) {
      texel = ivec2(texel.x - right, texel.y + size.y);
    }
  }
}
