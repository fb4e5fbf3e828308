//! Points between evaluated ones: where surface and shadow are smooth, visibility is interpolated.

use super::points::Points;

/// Widest range of the visibilities that are interpolated between.
const WIDEST: f32 = 0.1;

/// Every `spacing`-th point of every `spacing`-th row of an image, packed, with what was found there.
pub struct Grid {
    pub spacing: usize,
    pub columns: usize,
    pub visibility: Vec<f32>,
    pub uncertain: Vec<u8>,
}

/// Every `spacing`-th of the rows of `width` and of each row's items.
pub fn thinned(items: &[[f32; 3]], width: usize, spacing: usize) -> Vec<[f32; 3]> {
    let rows = items.chunks(width).step_by(spacing);
    rows.flat_map(|row| row.iter().step_by(spacing).copied())
        .collect()
}

impl Grid {
    /// What was found at a point, if it is one of the grid's.
    pub fn found(&self, points: &Points<'_>, point: usize) -> Option<(f32, u8)> {
        let (x, y) = (point % points.width, point / points.width);
        if !x.is_multiple_of(self.spacing) || !y.is_multiple_of(self.spacing) {
            return None;
        }
        let place = y / self.spacing * self.columns + x / self.spacing;
        Some((self.visibility[place], self.uncertain[place]))
    }

    /// The visibility of a point from the corners of its cell of the grid, if all of them are certain, on one smooth
    /// surface with it, and about as bright.
    pub fn interpolated(&self, points: &Points<'_>, point: usize) -> Option<f32> {
        let (x, y) = (point % points.width, point / points.width);
        let (column, row) = (x / self.spacing, y / self.spacing);
        let share = |at: usize| (at % self.spacing) as f32 / self.spacing as f32;
        let (across, along) = (share(x), share(y));
        // On a line of the grid two of the corners do not count.
        let (right, above) = (usize::from(across > 0.0), usize::from(along > 0.0));
        let (mut low, mut high, mut sum) = (f32::INFINITY, f32::NEG_INFINITY, 0.0);
        for i in 0..=above {
            for j in 0..=right {
                let (x, y) = ((column + j) * self.spacing, (row + i) * self.spacing);
                let corner = y * points.width + x;
                if x >= points.width
                    || corner >= points.position.len()
                    || !points.on_one_surface(point, corner)
                {
                    return None;
                }
                let place = (row + i) * self.columns + column + j;
                if self.uncertain[place] != 0 {
                    return None;
                }
                let value = self.visibility[place];
                (low, high) = (low.min(value), high.max(value));
                let part = |far: usize, share: f32| if far == 1 { share } else { 1.0 - share };
                sum += part(j, across) * part(i, along) * value;
            }
        }
        (high - low <= WIDEST).then_some(sum)
    }
}
