//! Minima over ever larger squares of a depth map.

/// One level: its width, its height, its values row by row.
pub type Level = (usize, usize, Vec<f32>);

/// Halves a level, rounding its size up: texel (x, y) is the minimum of the texels (2x, 2y) to
/// (2x + 1, 2y + 1) that exist, so a texel's minimum is never missed at an odd size's end.
fn halve(width: usize, height: usize, below: &[f32]) -> Level {
    let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
    let mut level = Vec::with_capacity(half_width * half_height);
    for y in 0..half_height {
        let row = |y: usize| &below[y * width..(y + 1) * width];
        let (low, high) = (row(2 * y), row((2 * y + 1).min(height - 1)));
        level.extend((0..half_width).map(|x| {
            let (left, right) = (2 * x, (2 * x + 1).min(width - 1));
            low[left].min(low[right]).min(high[left].min(high[right]))
        }));
    }
    (half_width, half_height, level)
}

/// Levels 1, 2, ... of a map, down to a single texel.
pub fn min_pyramid(width: usize, height: usize, map: &[f32]) -> Vec<Level> {
    let mut levels: Vec<Level> = Vec::new();
    let (mut w, mut h) = (width, height);
    while w > 1 || h > 1 {
        let below = levels.last().map_or(map, |(_, _, values)| values);
        let level = halve(w, h, below);
        (w, h) = (level.0, level.1);
        levels.push(level);
    }
    levels
}
