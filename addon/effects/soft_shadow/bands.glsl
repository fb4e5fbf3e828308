// The bitmask over all levels of a map: region.rs `bands`.
#include "bitmask.glsl"

// For which rises above the point a level answers. Thesis 5.3.3 strides over a search region with too many texels.
// Instead, every level answers for the occluders whose texels look about equally large from the point: far above it a
// coarse map shows as much as a fine one shows close to it. No level has many more than params.most_texels texels.
vec2 band_of(Search search, int level)
{
  float light = (search.reach.y - search.reach.x) * (search.reach.w - search.reach.z);
  // With texels of level 0, this far above the point the light covers params.most_texels of them.
  float unit = sqrt(params.most_texels / light);
  return vec2(level == 0 ? 0.0 : 0.5 * unit * float(1 << level),
              level + 1 == int(params.levels) ? INFINITE : 0.5 * unit * float(2 << level));
}

// Projects all texels that may hide something. Invocations that run side by side look at different blocks and texels, so
// each step is done for several before the next begins: blocks of all levels are collected, then read for which of
// their texels matter, and those are projected.
void backproject_bands(Seen seen, Search search, inout Bits hidden)
{
  int level = int(params.levels);
  Looked looked;
  ivec2 first = ivec2(0), last = ivec2(-1);
  ivec3 block = ivec3(0); // column, row, layer
  while (!all_hidden(hidden)) {
    uvec2 waiting[MOST_WAITING], found[MOST_WAITING];
    int count = 0;
    while (count < MOST_WAITING) {
      if (block.y > last.y) {
        level--;
        if (level < 0) {
          break;
        }
        looked = look_at(seen, level, band_of(search, level));
        Region region;
        if (search.above > looked.band.x && around(search, min(search.above, looked.band.y), level, region) &&
            !is_within((vec2(region.low) - looked.at) * looked.texel_size,
                       (vec2(region.high) - looked.at) * looked.texel_size,
                       looked.inner))
        {
          first = region.low / BLOCK;
          last = (region.high - 1) / BLOCK;
          block = ivec3(first, 0);
        }
        continue;
      }
      uint look = look_at_block(seen, looked, block);
      if ((look & WORTH_A_LOOK) != 0u) {
        waiting[count] = pack_block(block, level, look);
        count++;
      }
      block.z++;
      if (look == LAST_LAYER || block.z == map_layers()) {
        block.xz = ivec2(block.x + 1, 0);
      }
      if (block.x > last.x) {
        block.xy = ivec2(first.x, block.y + 1);
      }
    }
    if (count == 0) {
      return;
    }
    for (int i = 0; i < count; i++) {
      int which = level_of(waiting[i]);
      found[i] = found_in(seen, look_at(seen, which, band_of(search, which)), waiting[i]);
    }
    int next = 0;
    uvec2 bits = uvec2(0u);
    Looked now;
    ivec2 corner, pairs;
    while (true) {
      while (bits == uvec2(0u) && next < count) {
        bits = found[next];
        now = look_at(seen, level_of(waiting[next]), vec2(0.0));
        corner = BLOCK * block_of(waiting[next]);
        pairs = pairs_of(waiting[next]);
        next++;
      }
      if (bits == uvec2(0u)) {
        break;
      }
      int bit = bits.x != 0u ? findLSB(bits.x) : 32 + findLSB(bits.y);
      bits = bits.x != 0u ? uvec2(bits.x & (bits.x - 1u), bits.y) : uvec2(0u, bits.y & (bits.y - 1u));
      ivec2 texel = ivec2(bit & 7, bit >> 3);
      uvec2 rise_and_tilt = one_of(texelFetch(texels, pairs + ivec2(texel.x >> 1, texel.y), 0), texel.x);
      backproject_texel(seen, now, rise_and_tilt, vec2(corner + texel) - now.at, hidden);
    }
  }
}
