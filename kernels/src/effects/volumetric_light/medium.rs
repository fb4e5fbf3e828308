//! A homogeneous medium, and how it turns light aside.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::f64::consts::PI;

pub const PACKED_LENGTH: usize = 7;

/// Coefficients per metre for red, green, blue; `extinction` is scattering plus absorption.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    pub scattering: [f64; 3],
    pub extinction: [f64; 3],
    pub anisotropy: f64,
}

/// Extinctions that differ by no more than this are integrated over the same nodes.
const TOGETHER: f64 = 4.0;

impl Medium {
    /// Reads `Medium.packed()`: scattering, extinction, anisotropy.
    pub fn from_packed(v: &[f64]) -> PyResult<Self> {
        let fine = v.len() == PACKED_LENGTH
            && v.iter().all(|x| x.is_finite())
            && (0..3).all(|c| v[c] >= 0.0 && v[c + 3] >= v[c])
            && v[6].abs() < 1.0;
        if !fine {
            return Err(PyValueError::new_err(
                "a medium is 7 finite numbers: scattering, extinction (no less), anisotropy between -1 and 1",
            ));
        }
        Ok(Medium {
            scattering: [v[0], v[1], v[2]],
            extinction: [v[3], v[4], v[5]],
            anisotropy: v[6],
        })
    }

    /// The channels in groups whose extinctions are much alike.
    pub fn groups(&self) -> Vec<Vec<usize>> {
        let channels: Vec<usize> = (0..3).filter(|&c| self.scattering[c] > 0.0).collect();
        let low = channels
            .iter()
            .map(|&c| self.extinction[c])
            .fold(f64::INFINITY, f64::min);
        let high = channels.iter().map(|&c| self.extinction[c]).fold(0.0, f64::max);
        if channels.is_empty() {
            Vec::new()
        } else if high <= TOGETHER * low {
            vec![channels]
        } else {
            channels.into_iter().map(|c| vec![c]).collect()
        }
    }

    /// Henyey and Greenstein's share of light scattered by an angle, per steradian. Both are cosines' distances
    /// to 1 and to -1, so that sharp peaks keep their digits: `ahead` = (1 - cos) / 2, `behind` = (1 + cos) / 2.
    ///
    /// `filled`: of a light with a size, 1 - cos of the half angle that it fills. The mean over those directions has
    /// g (1 - filled / 2) as its mean cosine, and is taken as Henyey and Greenstein's with that one.
    pub fn phase(&self, ahead: f64, behind: f64, filled: f64) -> f64 {
        let g = self.anisotropy.abs();
        let missing = (1.0 - g) + 0.5 * g * filled;
        let turned = if self.anisotropy >= 0.0 { ahead } else { behind };
        let square = missing * missing + 4.0 * (1.0 - missing) * turned;
        missing * (2.0 - missing) / (4.0 * PI * square * square.sqrt())
    }
}
