// Paper between halftone dots: kernels/src/effects/toon/halftone.rs. Defines: OBJECT or SURFACE, what dots hold on to.
#include "dots.glsl"
#include "tables.glsl"

vec2 turned(vec2 v)
{
  vec2 turn = params.turn;
  return vec2(turn.x * v.x + turn.y * v.y, turn.x * v.y - turn.y * v.x);
}

#ifdef SURFACE
vec2 chosen(vec3 v, int axis)
{
  return axis == 0 ? v.yz : (axis == 1 ? v.xz : v.xy);
}
#endif

void main()
{
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, ivec2(params.size)))) {
    return;
  }
  float paper = 1.0;
  int which = int(texelFetch(instance, pixel, 0).r);
  float s = (1.0 - texelFetch(light, pixel, 0).r) * params.scale;
  bool inked = which >= 0 && s >= params.cutoff;
  if (inked) {
    inked = texelFetch(anchors, table_texel(4u * uint(which) + 3u), 0).x > 0.0;
  }
  if (inked) {
    vec3 p = texelFetch(position, pixel, 0).xyz;
    float fade = params.opacity;
    if (params.fade_scale != 0.0) {
      float x = clamp((length(p) - params.fade_end) * params.fade_scale, 0.0, 1.0);
      fade *= x * x * (3.0 - 2.0 * x);
    }
#ifdef SURFACE
    vec4 rows[3];
    vec3 facing, local, n = texelFetch(geometric_normal, pixel, 0).xyz;
    for (int k = 0; k < 3; k++) {
      rows[k] = texelFetch(anchors, table_texel(4u * uint(which) + uint(k)), 0);
      local[k] = dot(rows[k].xyz, p) + rows[k].w;
      facing[k] = abs(dot(rows[k].xyz, n) / sqrt(max(dot(rows[k].xyz, rows[k].xyz), 1e-20)));
    }
    int axis = facing.x >= facing.y && facing.x >= facing.z ? 0 : (facing.y >= facing.z ? 1 : 2);
    bool orthographic = params.orthographic > 0.0;
    vec3 ray = orthographic ? params.forward.xyz : p;
    float depth = orthographic ? 1.0 : dot(p, params.forward.xyz);
    float along = dot(n, ray), least = 0.05 * length(ray);
    along = abs(along) < least ? (along < 0.0 ? -least : least) : along;
    vec2 steps[2];
    for (int k = 0; k < 2; k++) {
      vec3 step_across = k == 0 ? params.right.xyz : params.up.xyz;
      vec3 moved = depth * (step_across - ray * (dot(n, step_across) / along));
      vec3 inside = vec3(dot(rows[0].xyz, moved), dot(rows[1].xyz, moved), dot(rows[2].xyz, moved));
      steps[k] = turned(chosen(inside, axis));
    }
    vec2 reach = params.half_footprint * sqrt(steps[0] * steps[0] + steps[1] * steps[1]);
    vec2 at = turned(chosen(local, axis));
#else
    vec2 origin = vec2(0.0);
#  ifdef OBJECT
    origin = texelFetch(anchors, table_texel(4u * uint(which)), 0).xy;
#  endif
    vec2 place = params.first + vec2(pixel);
#ifdef PLACES
    place += texelFetch(offsets, pixel, 0).xy;
#endif
    vec2 at = turned(place - origin);
    vec2 reach = vec2(params.half_footprint * length(params.turn));
#endif
    paper = 1.0 - fade * coverage(at, reach, 0.5 * s);
  }
  imageStore(result, pixel, vec4(paper));
}
