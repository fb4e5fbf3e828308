// The bitmask over all levels of a map: region.rs `bands`.
#include "bitmask.glsl"

// Thesis 5.3.3 strides over a search region with too many texels. Instead, every level answers for the occluders
// whose texels look about equally large from the point: far above it a coarse map shows as much as a fine one
// shows close to it. No level has many more than params.settings.x texels.
void backproject_bands(Seen seen, Search search, inout Bits hidden)
{
  float light = (search.reach.y - search.reach.x) * (search.reach.w - search.reach.z);
  // With texels of level 0, this far above the point the light covers params.settings.x of them.
  float unit = sqrt(params.settings.x / light);
  float above_to = INFINITE;
  for (int level = int(params.bias.z) - 1; level >= 0 && !all_hidden(hidden); level--) {
    float above_from = level == 0 ? 0.0 : 0.5 * unit * float(1 << level);
    Region region;
    if (search.above > above_from && around(search, min(search.above, above_to), level, region)) {
      backproject(seen, region, level, vec2(above_from, above_to), hidden);
    }
    above_to = above_from;
  }
}
