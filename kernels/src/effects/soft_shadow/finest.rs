//! Level 0 of a map: rise and slope of every texel that was rasterised.

use super::level::{BLOCK, BLOCK_TEXELS, EMPTY, Level, Line, pack_tilt};
use crate::simd::{Simd, Work, dispatch};

/// `depths` (layers, height, width), metres, ascending, infinite where empty.
pub fn finest(depths: &[f32], [layers, height, width]: [usize; 3], orthographic: bool) -> Level {
    let source = Source {
        depths,
        layers,
        width,
        height,
        orthographic,
    };
    Level::filled(width, height, layers, |first_row, lines| {
        dispatch(Rows {
            source: &source,
            first_row,
            lines,
        })
    })
}

/// The map as it was rasterised.
struct Source<'a> {
    depths: &'a [f32],
    layers: usize,
    width: usize,
    height: usize,
    orthographic: bool,
}

/// Rows of texels that make a line of blocks, of every layer.
struct Rows<'a, 'b> {
    source: &'a Source<'a>,
    first_row: usize,
    lines: &'a mut [Line<'b>],
}

impl Work for Rows<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Source {
            depths,
            layers,
            width,
            height,
            orthographic,
        } = *self.source;
        // The rows and those around them, with nothing beyond the map's sides: an infinite depth is never closest.
        let (stride, rows) = (width + 2, BLOCK + 2);
        let mut padded = vec![f32::INFINITY; layers * rows * stride];
        for layer in 0..layers {
            for y in self.first_row.max(1) - 1..(self.first_row + BLOCK + 1).min(height) {
                let to = (layer * rows + y + 1 - self.first_row) * stride + 1;
                let from = (layer * height + y) * width;
                padded[to..to + width].copy_from_slice(&depths[from..from + width]);
            }
        }
        let nothing = vec![f32::INFINITY; stride];
        // Texels from column `shift` - 1 on of a row; `layer` is one more than the layer's number.
        let row_of = |layer: usize, row: usize, shift: usize| {
            let row = match layer.checked_sub(1) {
                Some(layer) if layer < layers => {
                    &padded[(layer * rows + row) * stride..(layer * rows + row + 1) * stride]
                }
                _ => &nothing,
            };
            &row[shift..shift + width]
        };
        let mut rise = vec![0.0; width];
        let mut slopes = [vec![0.0; width], vec![0.0; width]];
        for (layer, line) in self.lines.iter_mut().enumerate() {
            let layer = layer + 1;
            for y in 0..BLOCK.min(height - self.first_row) {
                let depth = row_of(layer, y + 1, 1);
                let behind = row_of(layer + 1, y + 1, 1);
                let three = |row: usize, shift: usize| {
                    [layer - 1, layer, layer + 1].map(|layer| row_of(layer, row, shift))
                };
                slope(
                    depth,
                    behind,
                    three(y + 1, 0),
                    three(y + 1, 2),
                    orthographic,
                    &mut slopes[0],
                );
                slope(
                    depth,
                    behind,
                    three(y, 1),
                    three(y + 2, 1),
                    orthographic,
                    &mut slopes[1],
                );
                for (rise, &depth) in rise.iter_mut().zip(depth) {
                    let holds = depth.abs() < f32::INFINITY && (depth > 0.0 || orthographic);
                    *rise = if holds {
                        rise_of(depth, orthographic)
                    } else {
                        EMPTY
                    };
                }
                for (block, first) in (0..width).step_by(BLOCK).enumerate() {
                    let end = (first + BLOCK).min(width);
                    let at = block * BLOCK_TEXELS + y * BLOCK;
                    line.rise[at..at + end - first].copy_from_slice(&rise[first..end]);
                    for (tilt, column) in line.tilt[at..at + end - first].iter_mut().zip(first..end) {
                        let packed = pack_tilt(slopes[0][column], slopes[1][column]);
                        *tilt = if rise[column] == EMPTY { 0 } else { packed };
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn rise_of(depth: f32, orthographic: bool) -> f32 {
    if orthographic { -depth } else { 1.0 / depth }
}

/// Slope of each texel's surface along an axis: of the neighbours `before` and `after` it and of their layers, the
/// one closest in depth is taken to be the same surface, unless the texel's own next layer, `behind`, is closer
/// (a thin wire).
#[inline(always)]
fn slope(
    depth: &[f32],
    behind: &[f32],
    before: [&[f32]; 3],
    after: [&[f32]; 3],
    orthographic: bool,
    slopes: &mut [f32],
) {
    let width = depth.len();
    let (behind, slopes) = (&behind[..width], &mut slopes[..width]);
    let (before, after) = (before.map(|row| &row[..width]), after.map(|row| &row[..width]));
    for i in 0..width {
        let own = depth[i];
        let (mut closest, mut there, mut sign) = (behind[i] - own, own, 1.0);
        let mut consider = |other: f32, side: f32| {
            let distance = (other - own).abs();
            let is_closer = distance < closest;
            closest = if is_closer { distance } else { closest };
            there = if is_closer { other } else { there };
            sign = if is_closer { side } else { sign };
        };
        consider(before[0][i], -1.0);
        consider(before[1][i], -1.0);
        consider(before[2][i], -1.0);
        consider(after[0][i], 1.0);
        consider(after[1][i], 1.0);
        consider(after[2][i], 1.0);
        slopes[i] = sign * (rise_of(there, orthographic) - rise_of(own, orthographic));
    }
}
