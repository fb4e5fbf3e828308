// What one source adds to every ray of a lattice, within one map's window or, with OUTSIDE, beyond it too: evaluate.rs
// and map.rs `LightMap::walk`. Each window is one dispatch; windows do not overlap.
//   params.size    width and height of the lattice; 1 to begin from nothing, else 0 to add
//   params.first   first and step of the image's lattice; right.w and up.w: where in it this one begins; forward.w is the
//                  near plane
//   params.window  left, bottom, and texels per slope (metre) across and up; params.reach: right, top, near
//   params.map     width and height in texels, levels, 1 where there is a map and 0 where all in the window is lit
//   params.map_x   the map's axes, with the camera's eye in them as w
//   params.walk    nodes a panel; row of a block that stands for it; the share of the source that the map is of; 1 where
//                  rays go through places of their pixels' own, which `offsets` has then
//   params.table   with TABLE, the source's own method: its reach, and metres from the eye to the light
struct Ray {
  vec3 origin;  // relative to the eye
  vec3 direction;
  float start;   // where the medium begins
  float before;  // metres of it before that
};

Ray ray;

#ifdef LOOKED_UP
#include "way.glsl"
#endif
#ifdef BOUNDED
#include "spans.glsl"
#endif
#include "integral.glsl"
#include "map_lines.glsl"

const float FAR = 1e9;
const float ENDLESS = 1e15;

Seen seen;
vec3 total = vec3(0.0);

void stretch(float from, float to)
{
  if (to <= from) {
    return;
  }
  float before = ray.before + (from - ray.start);
#ifdef DISTANT
  total += distant_light(ray.direction, from, before, to - from);
#elif defined(TABLE)
  total += tabled(seen, to) - tabled(seen, from);
#else
  float tau = from - seen.closest;
#  ifndef LOOKED_UP
  before += sqrt(seen.height * seen.height + tau * tau);
#  endif
  total += near_light(seen, tau, to - from, before);
#endif
}

#ifndef UNSHADOWED
int level_row(int level)
{
  int height = int(params.map.y), row = 0;
  for (int i = 0; i < level; i++) {
    row += (height + (1 << i) - 1) >> i;
  }
  return row;
}

// Texels of a level: sizes are halved and rounded up.
ivec2 level_last(int level)
{
  return (ivec2(params.map.xy) - 1) >> level;
}

void walk(vec3 origin, vec3 direction, float from, float to)
{
  vec3 p0 = origin + from * direction, p1 = origin + to * direction;
#ifdef ORTHOGRAPHIC
  vec2 start = (p0.xy - params.window.xy) * params.window.zw, end = (p1.xy - params.window.xy) * params.window.zw;
  float near0 = -p0.z, near1 = -p1.z;
#else
  vec2 start = (p0.xy / p0.z - params.window.xy) * params.window.zw;
  vec2 end = (p1.xy / p1.z - params.window.xy) * params.window.zw;
  float near0 = 1.0 / p0.z, near1 = 1.0 / p1.z;
#endif
  vec2 change = end - start;
  float rise = near1 - near0, span = to - from;
  int top = int(params.map.z) - 1, level = min(top, 5);
  int row = level_row(level);
  ivec2 cell = clamp(ivec2(floor(start)), ivec2(0), level_last(0)) >> level;
  float share = 0.0, since = -1.0;
#ifdef ORTHOGRAPHIC
#  define METRES(s) (from + span * (s))
#else
#  define METRES(s) (from + span * ((s) * near1 / (near0 + (s) * rise)))
#endif
  for (int guard = 0; guard < 32768; guard++) {
    vec2 range = texelFetch(pyramid, cell + ivec2(0, row), 0).xy;
    vec2 edge = vec2((cell + ivec2(change.x > 0.0, change.y > 0.0)) << level);
    vec2 leaves = vec2(change.x == 0.0 ? LARGEST_DEPTH : (edge.x - start.x) / change.x,
                       change.y == 0.0 ? LARGEST_DEPTH : (edge.y - start.y) / change.y);
    bool across = leaves.x <= leaves.y;
    float leave = clamp(min(leaves.x, leaves.y), share, 1.0);
    float a = near0 + rise * share, b = near0 + rise * leave;
    bool lit = min(a, b) >= range.y;
    if (!lit && max(a, b) >= range.x && level > 0) {
      level -= 1;
      row = level_row(level);
      vec2 place = start + share * change;
      ivec2 first = cell * 2;
      vec2 half_way = vec2((first + 1) << level);
      bvec2 beyond = bvec2(change.x < 0.0 ? place.x > half_way.x : place.x >= half_way.x,
                           change.y < 0.0 ? place.y > half_way.y : place.y >= half_way.y);
      cell = min(first + ivec2(beyond), level_last(level));
      continue;
    }
    if (lit) {
      since = since < 0.0 ? share : since;
    }
    else if (max(a, b) < range.x) {
      if (since >= 0.0) {
        stretch(METRES(since), METRES(share));
        since = -1.0;
      }
    }
    else {
      float crossing = clamp((range.y - near0) / rise, share, leave);
      if (rise > 0.0) {
        if (since >= 0.0) {
          stretch(METRES(since), METRES(share));
        }
        since = crossing;
      }
      else {
        stretch(METRES(since < 0.0 ? share : since), METRES(crossing));
        since = -1.0;
      }
    }
    share = leave;
    int axis = across ? 0 : 1;
    bool forwards = change[axis] > 0.0;
    cell[axis] += forwards ? 1 : -1;
    if (leave >= 1.0 || cell[axis] < 0 || cell[axis] > level_last(level)[axis]) {
      break;
    }
    if (level < top && (cell[axis] & 1) == (forwards ? 0 : 1)) {
      level += 1;
      row = level_row(level);
      cell >>= 1;
    }
  }
  if (since >= 0.0) {
    stretch(METRES(since), to);
  }
}

// Keeps of a stretch where value + t slope >= 0.
void clip(float value, float slope, inout vec2 part)
{
  if (slope > 0.0) {
    part.x = max(part.x, -value / slope);
  }
  else if (slope < 0.0) {
    part.y = min(part.y, -value / slope);
  }
  else if (value < 0.0) {
    part.y = -LARGEST_DEPTH;
  }
}
#endif

void piece(float from, float to)
{
#ifdef UNSHADOWED
  stretch(from, to);
#else
  vec3 o = vec3(params.map_x.w, params.map_y.w, params.map_z.w) +
           vec3(dot(params.map_x.xyz, ray.origin), dot(params.map_y.xyz, ray.origin), dot(params.map_z.xyz, ray.origin));
  vec3 d = vec3(dot(params.map_x.xyz, ray.direction), dot(params.map_y.xyz, ray.direction), dot(params.map_z.xyz, ray.direction));
  to = min(to, FAR);
  vec2 part = vec2(from, to);
  vec2 low = params.window.xy, high = params.reach.xy;
#  ifdef ORTHOGRAPHIC
  clip(o.x - low.x, d.x, part);
  clip(high.x - o.x, -d.x, part);
  clip(o.y - low.y, d.y, part);
  clip(high.y - o.y, -d.y, part);
#  else
  clip(o.z - params.reach.z, d.z, part);
  clip(o.x - low.x * o.z, d.x - low.x * d.z, part);
  clip(high.x * o.z - o.x, high.x * d.z - d.x, part);
  clip(o.y - low.y * o.z, d.y - low.y * d.z, part);
  clip(high.y * o.z - o.y, high.y * d.z - d.y, part);
#  endif
  bool enters = part.x < part.y;
#  ifdef OUTSIDE
  stretch(from, enters ? part.x : to);
  if (enters) {
    stretch(part.y, to);
  }
#  endif
  if (enters) {
    if (params.map.w != 0.0) {
      walk(o, d, part.x, part.y);
    }
    else {
      stretch(part.x, part.y);
    }
  }
#endif
}

// Where the ray enters or leaves a cone around the axis: source.rs `Seen::cone`. LARGEST_DEPTH where it does not.
vec2 cone_cuts(float cosine)
{
  float c2 = cosine * cosine, s2 = (1.0 - cosine) * (1.0 + cosine);
  float a = seen.along1 * seen.along1 * s2 - seen.across2 * c2;
  float b = seen.along0 * seen.along1 * s2 + seen.across2 * seen.across_tau * c2;
  float c = seen.along0 * seen.along0 * s2 - (seen.across0 + seen.across2 * seen.across_tau * seen.across_tau) * c2;
  float discriminant = b * b - a * c;
  if (discriminant < 0.0) {
    return vec2(LARGEST_DEPTH);
  }
  float q = -(b + (b < 0.0 ? -1.0 : 1.0) * sqrt(discriminant));
  vec2 cuts = vec2(a != 0.0 ? q / a : LARGEST_DEPTH, q != 0.0 ? c / q : LARGEST_DEPTH);
  for (int i = 0; i < 2; i++) {
    if ((seen.along0 + cuts[i] * seen.along1) * cosine < 0.0) {
      cuts[i] = LARGEST_DEPTH;
    }
  }
  return cuts;
}

// Cuts a stretch where the source's intensity has a kink: source.rs `Seen::pieces`.
void pieces(float from, float to)
{
#if defined(SPOT) || defined(AREA)
  float low = from - seen.closest, high = to - seen.closest;
  vec4 cuts;
  float darkest = 0.0;  // the cosine beyond which nothing shines
#  ifdef SPOT
  float blurred = BLURRED * 2.0 * asin(min(sqrt(0.5 * filled(seen.height)), 1.0));
  darkest = cos(min(params.cone.z + blurred, PI));
  cuts = vec4(cone_cuts(darkest), vec2(high));
  if (params.cone.w > blurred && (params.cone.w < params.cone.z || blurred > 0.0)) {
    cuts.zw = cone_cuts(cos(params.cone.w - blurred));
  }
#  else
  cuts.x = seen.along1 != 0.0 ? -seen.along0 / seen.along1 : LARGEST_DEPTH;
  cuts.yz = params.cone.y != 0.0 ? cone_cuts(params.cone.z) : vec2(LARGEST_DEPTH);
  cuts.w = high;
  darkest = params.cone.y != 0.0 ? params.cone.z : 0.0;
#  endif
  for (int i = 0; i < 4; i++) {
    cuts[i] = cuts[i] > low && cuts[i] < high ? cuts[i] : high;
  }
  // A sorting network: Mesa's compilers lost values of a loop that swaps.
  cuts = vec4(min(cuts.xz, cuts.yw), max(cuts.xz, cuts.yw)).xzyw;
  cuts = vec4(min(cuts.xy, cuts.zw), max(cuts.xy, cuts.zw));
  cuts.yz = vec2(min(cuts.y, cuts.z), max(cuts.y, cuts.z));
  float start = low;
  for (int i = 0; i < 5; i++) {
    float cut = i < 4 ? cuts[i] : high;
    float middle = cut < 0.5 * ENDLESS ? 0.5 * (start + cut) : 2.0 * max(abs(start), seen.height);
    if (cut > start && seen.along0 + middle * seen.along1 >= darkest * sqrt(seen.height * seen.height + middle * middle)) {
      piece(start + seen.closest, cut + seen.closest);
    }
    start = cut;
  }
#else
  piece(from, to);
#endif
}

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size.xy)))) {
    return;
  }
  ivec2 shown = pixel * int(params.size.w) + ivec2(params.reach.w, params.walk.y);
  float depth_here = texelFetch(depth, shown, 0).r;
  vec2 place = vec2(params.right.w, params.up.w) + vec2(pixel);
  if (params.walk.w > 0.0) { // each through its pixel's own place
    place += texelFetch(offsets, shown, 0).xy / params.size.w;
  }
  vec2 at = params.first.xy + place * params.first.zw;
  vec3 across = at.x * params.right.xyz + at.y * params.up.xyz;
  float per_depth = 1.0;
#ifdef PARALLEL
  ray.origin = across;
  ray.direction = params.forward.xyz;
#else
  vec3 towards = params.forward.xyz + across;
  per_depth = length(towards);
  ray.origin = vec3(0.0);
  ray.direction = towards / per_depth;
#endif
  ray.start = params.forward.w * per_depth;
  float end = min(depth_here, ENDLESS) * per_depth;
  seen = seen_from_light(ray.origin - params.light.xyz, ray.direction);
  ray.before = 0.0;
#ifdef BOUNDED
  float near = ray.start, since = near;
  int count = read_crossings(pixel, per_depth);
  bool inside = (count & 1) == 1;
  for (int i = 0; i < count; i++) {
    if (inside) {
      ray.start = max(since, near);
      float stop = min(crossings[i], end);
      if (ray.start < stop) {
        pieces(ray.start, stop);
        ray.before += stop - ray.start;
      }
    }
    since = crossings[i];
    inside = !inside;
  }
#else
  if (end > ray.start) {
    pieces(ray.start, end);
  }
#endif
  vec3 before = params.size.z != 0.0 ? vec3(0.0) : imageLoad(result, pixel).rgb;
  imageStore(result, pixel, vec4(before + params.walk.z * total, 0.0));
}
