// What a map's texels hold where nothing is: a depth beyond all.
const float LARGEST_DEPTH = 1e37;
