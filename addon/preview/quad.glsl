// Two triangles over `params.place`, which is left, bottom, right, top in clip space.

void main()
{
  int corner = gl_VertexID < 3 ? gl_VertexID : 6 - gl_VertexID;
  at = vec2(float(corner & 1), float(corner >> 1));
  gl_Position = vec4(mix(params.place.xy, params.place.zw, at), 0.0, 1.0);
}
