// Where a ray is inside a bounded medium: spans.rs. `spans` holds the depths of its surface, ascending, infinite where
// there are no more; an odd number of them means that the ray begins inside.
//   params.spans  layers, and how many of them lie side by side; width and height of one
const int MOST_CROSSINGS = 16;
float crossings[MOST_CROSSINGS];

// How many crossings the pixel's ray has; they are in `crossings`, metres along it.
int read_crossings(ivec2 pixel, float per_depth)
{
  ivec2 size = ivec2(params.spans.zw);
  int columns = int(params.spans.y), count = 0;
  for (int layer = 0; layer < int(params.spans.x); layer++) {
    float here = texelFetch(spans, pixel + size * ivec2(layer % columns, layer / columns), 0).r;
    if (here > 1e37) {
      break;
    }
    crossings[count] = here * per_depth;
    count++;
  }
  return count;
}
