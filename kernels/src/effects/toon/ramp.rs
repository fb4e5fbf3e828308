//! Colour ramps as piecewise cubics: addon/effects/toon/ramp_table.py makes them.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Numbers of a piece: where it starts, then its coefficients by power and channel.
const PIECE: usize = 17;

struct Piece {
    start: f32,
    coefficients: [[f32; 4]; 4],
}

pub struct Ramp {
    pieces: Vec<Piece>,
    clamps: bool,
}

impl Ramp {
    /// RGBA at a position.
    #[inline(always)]
    pub fn at(&self, position: f32) -> [f32; 4] {
        let mut piece = &self.pieces[0];
        for next in &self.pieces[1..] {
            if next.start > position {
                break;
            }
            piece = next;
        }
        let x = (position - piece.start).max(0.0);
        let c = &piece.coefficients;
        let value: [f32; 4] = std::array::from_fn(|k| c[0][k] + x * (c[1][k] + x * (c[2][k] + x * c[3][k])));
        if self.clamps {
            value.map(|v| v.clamp(0.0, 1.0))
        } else {
            value
        }
    }
}

/// Ramps from their packed pieces (P, 17), of which ramp r has those from `starts[r]` to `starts[r + 1]`.
pub fn ramps(
    pieces: &PyReadonlyArray2<'_, f32>,
    starts: &PyReadonlyArray1<'_, i32>,
    clamps: &PyReadonlyArray1<'_, u8>,
) -> PyResult<Vec<Ramp>> {
    let (starts, clamps) = (starts.as_slice()?, clamps.as_slice()?);
    let bad = || PyValueError::new_err("ramps have 17 numbers a piece, and each at least one piece");
    if pieces.shape()[1] != PIECE || starts.len() != clamps.len() + 1 || clamps.is_empty() {
        return Err(bad());
    }
    let rows = pieces.as_slice()?.as_chunks::<PIECE>().0;
    let of = |index: usize| {
        let (first, end) = (starts[index], starts[index + 1]);
        if first < 0 || end <= first || end as usize > rows.len() {
            return Err(bad());
        }
        let piece = |row: &[f32; PIECE]| Piece {
            start: row[0],
            coefficients: std::array::from_fn(|power| std::array::from_fn(|k| row[1 + 4 * power + k])),
        };
        Ok(Ramp {
            pieces: rows[first as usize..end as usize].iter().map(piece).collect(),
            clamps: clamps[index] != 0,
        })
    };
    (0..clamps.len()).map(of).collect()
}
