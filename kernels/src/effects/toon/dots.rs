//! The area of round dots on a square grid of cells, exactly.

/// Cells across a footprint beyond which the mean over whole cells is as good.
const MOST_CELLS: f32 = 4.0;

/// Area of the disc of radius `r` about the origin within [0, x] x [0, y], signed as x * y is.
#[inline(always)]
fn corner_area(x: f32, y: f32, r: f32) -> f32 {
    let sign = x.signum() * y.signum();
    let (x, y) = (x.abs().min(r), y.abs().min(r));
    if x * x + y * y <= r * r {
        return sign * x * y;
    }
    // Up to `a` the circle is above y; from there on its own height counts.
    let a = (r * r - y * y).max(0.0).sqrt();
    let up_to =
        |x: f32| 0.5 * (x * (r * r - x * x).max(0.0).sqrt() + r * r * (x / r).clamp(-1.0, 1.0).asin());
    sign * (a * y + up_to(x) - up_to(a))
}

/// Area of the disc within a rectangle: left, right, bottom, top, relative to the disc's centre.
#[inline(always)]
fn disc_area([x0, x1, y0, y1]: [f32; 4], r: f32) -> f32 {
    // Most rectangles lie on one side of the circle: by their nearest and their farthest point.
    let (near_x, near_y) = (x0.max(-x1).max(0.0), y0.max(-y1).max(0.0));
    if near_x * near_x + near_y * near_y >= r * r {
        return 0.0;
    }
    let (far_x, far_y) = (x1.max(-x0), y1.max(-y0));
    if far_x * far_x + far_y * far_y <= r * r {
        return (x1 - x0) * (y1 - y0);
    }
    corner_area(x1, y1, r) - corner_area(x0, y1, r) - corner_area(x1, y0, r) + corner_area(x0, y0, r)
}

/// Share of a whole cell that a dot of radius `r` cells covers, cut off at the cell's border.
pub fn cell_coverage(r: f32) -> f32 {
    if r <= 0.5 {
        return std::f32::consts::PI * r * r;
    }
    if r >= std::f32::consts::FRAC_1_SQRT_2 {
        return 1.0;
    }
    // Four segments stand out of the cell.
    let half = (r * r - 0.25).sqrt();
    std::f32::consts::PI * r * r - 4.0 * (r * r * (0.5 / r).acos() - 0.5 * half)
}

/// Share of the rectangle `half` to both sides of `at` (in cells) that dots of radius `r` cover. Each dot is
/// in the middle of its cell and cut off at its border; since all are of one size, that is their union.
#[inline(always)]
pub fn coverage(at: [f32; 2], half: [f32; 2], r: f32) -> f32 {
    if r <= 0.0 {
        return 0.0;
    }
    if r >= std::f32::consts::FRAC_1_SQRT_2 {
        return 1.0;
    }
    let wide = 2.0 * half[0].max(half[1]);
    if wide.is_nan() || wide >= MOST_CELLS {
        return cell_coverage(r);
    }
    let half = half.map(|h| h.max(1e-4));
    let (low, high) = (
        [at[0] - half[0], at[1] - half[1]],
        [at[0] + half[0], at[1] + half[1]],
    );
    let mut area = 0.0;
    let mut row = low[1].floor();
    while row < high[1] {
        let mut column = low[0].floor();
        while column < high[0] {
            let part = [
                low[0].max(column) - column - 0.5,
                high[0].min(column + 1.0) - column - 0.5,
                low[1].max(row) - row - 0.5,
                high[1].min(row + 1.0) - row - 0.5,
            ];
            area += disc_area(part, r);
            column += 1.0;
        }
        row += 1.0;
    }
    (area / (4.0 * half[0] * half[1])).clamp(0.0, 1.0)
}
