// The nearest triangle of every pixel: its run + 1, and its row in the table of triangles.
#include "fragment.glsl"

void main()
{
#ifdef PLACES
  if (!is_met()) {
    discard;
  }
#endif
  float depth = fragment_depth();
  if (!is_there(depth)) {
    discard;
  }
  nearest = ids;
  // Linear in depth (a hardware depth buffer is hyperbolic): float32 then parts surfaces as the CPU does.
  gl_FragDepth = clamp((depth - params.depth.x) * params.depth.y, 0.0, 1.0);
}
