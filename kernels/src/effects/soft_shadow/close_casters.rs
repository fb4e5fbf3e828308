//! How much of a round light is hidden, seen from some direction, by what its maps do not know.

use rayon::prelude::*;

/// Cells across the light, one a bit of a row.
const GRID: usize = 16;

/// How far the light is looked at from, in its radii: what is close to it hides other parts of it from close by.
const FROM: [f32; 2] = [f32::INFINITY, 4.0];

/// Of each of the directions `towards` (unit, from the light's centre) the greatest share of the light that some of
/// `places` (in radii from there, on surfaces, a cell's width apart at most) hide and none of those that are `known`.
pub fn unknown_shares(places: &[[f32; 3]], known: &[bool], towards: &[[f32; 3]]) -> Vec<f32> {
    let disk = disk();
    let cells = disk.iter().map(|row| row.count_ones()).sum::<u32>() as f32;
    let share = |direction: &[f32; 3]| {
        let (right, up) = across(*direction);
        FROM.map(|from| {
            let mut hidden = [[0u16; GRID]; 2];
            for (place, &is_known) in places.iter().zip(known) {
                let along = dot(place, direction);
                if !(0.0..0.9 * from).contains(&along) {
                    continue;
                }
                let nearer = 1.0 / (1.0 - along / from);
                let [x, y] = [right, up].map(|axis| cell(dot(place, &axis) * nearer));
                if x < GRID && y < GRID {
                    hidden[is_known as usize][y] |= 1 << x;
                }
            }
            let [unknown, known] = hidden;
            let rows = unknown.iter().zip(known).zip(disk);
            rows.map(|((&unknown, known), disk)| (unknown & !known & disk).count_ones())
                .sum::<u32>() as f32
                / cells
        })
    };
    let greatest = |direction| share(direction).into_iter().fold(0.0, f32::max);
    towards.par_iter().map(greatest).collect()
}

/// The cell of a place across the light, beyond the grid if it is beside the light.
fn cell(at: f32) -> usize {
    // Saturates: below zero it is 0, which is beside the light too.
    (((at + 1.0) * (0.5 * GRID as f32) + 1.0) as usize).wrapping_sub(1)
}

/// Cells whose middles are on the light.
fn disk() -> [u16; GRID] {
    let at = |i: usize| (i as f32 + 0.5) / (0.5 * GRID as f32) - 1.0;
    std::array::from_fn(|y| (0..GRID).fold(0, |row, x| row | ((at(x).hypot(at(y)) < 1.0) as u16) << x))
}

/// Two directions at right angles to a unit vector and to each other.
fn across(direction: [f32; 3]) -> ([f32; 3], [f32; 3]) {
    let [x, y, z] = direction;
    let right = if z.abs() < 0.9 {
        let length = x.hypot(y);
        [-y / length, x / length, 0.0]
    } else {
        let length = y.hypot(z);
        [0.0, -z / length, y / length]
    };
    let [a, b, c] = right;
    (right, [y * c - z * b, z * a - x * c, x * b - y * a])
}

fn dot(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    /// Places on the square of `half` radii at a height, close together.
    fn plate(half: f32, height: f32) -> Vec<[f32; 3]> {
        let at = |i: usize| (i as f32 / 40.0 - 1.0) * half;
        (0..81 * 81).map(|i| [at(i % 81), at(i / 81), height]).collect()
    }

    #[test]
    fn a_plate_hides_what_is_behind_it() {
        let (below, above) = ([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]);
        let places = plate(1.5, -0.5);
        let shares = unknown_shares(&places, &vec![false; places.len()], &[below, above]);
        assert_eq!(shares, [1.0, 0.0]);
        let known = unknown_shares(&places, &vec![true; places.len()], &[below]);
        assert_eq!(known, [0.0]);
    }

    #[test]
    fn what_is_known_to_be_hidden_counts_no_more() {
        let (small, large) = (plate(0.5, -0.5), plate(1.5, -0.2));
        let places: Vec<_> = small.iter().chain(&large).copied().collect();
        let known: Vec<_> = (0..places.len()).map(|i| i < small.len()).collect();
        let [share] = unknown_shares(&places, &known, &[[0.0, 0.0, -1.0]])[..] else {
            unreachable!()
        };
        // A square of a side of 1 of a disk of 3.14; from close by 8/7 of that.
        assert!((share - (1.0 - 1.0 / PI)).abs() < 0.05, "{share}");
        let aside = unknown_shares(&small, &vec![false; small.len()], &[[0.8, 0.0, -0.6]]);
        // Seen at a slant.
        assert!((aside[0] - 0.6 / PI).abs() < 0.09, "{}", aside[0]);
    }
}
