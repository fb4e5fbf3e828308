//! The source's method: a table of the antiderivative over distance along the ray and its angle to the light.
//!
//! As printed the table sums samples with both ends whole; here it is the trapezoid rule. Rows are
//! v = sqrt((1 + cos) / 2) with cos that between the ray and the direction away from the light, finest where
//! the ray looks straight at the light.

use super::medium::Medium;
use super::source::{Seen, Source};
use crate::vector::length;
use rayon::prelude::*;

const ALONG: usize = 256;
const ANGLES: usize = 512;

pub struct Table {
    /// Of every ray's origin from the source, metres.
    away: f64,
    reach: f64,
    sums: Vec<[f32; 3]>,
}

impl Table {
    /// For rays from `eye`, up to `reach` metres long, and a source that shines evenly; `near_plane` is no medium.
    pub fn new(medium: &Medium, source: &Source, eye: [f64; 3], reach: f64) -> Table {
        let away = length(std::array::from_fn(|i| eye[i] - source.position[i]));
        let mut sums = vec![[0.0; 3]; ALONG * ANGLES];
        sums.par_chunks_mut(ALONG).enumerate().for_each(|(row, sums)| {
            let v = row as f64 / (ANGLES - 1) as f64;
            let cosine = 2.0 * v * v - 1.0;
            let closest = -away * cosine;
            let height = away * (2.0 * v * (1.0 - v * v).max(0.0).sqrt());
            let value = |t: f64| {
                let tau = t - closest;
                let distance = height.hypot(tau).max(1e-9);
                let ahead = (0.5 * (1.0 + tau / distance)).clamp(0.0, 1.0);
                let (falloff, filled) = source.falloff(distance);
                let light = medium.phase(ahead, 1.0 - ahead, filled) * falloff;
                std::array::from_fn::<f64, 3, _>(|c| {
                    light * medium.scattering[c] * (-medium.extinction[c] * (t + distance)).exp()
                })
            };
            let step = reach / (ALONG - 1) as f64;
            let (mut total, mut last) = ([0.0; 3], value(0.0));
            for (i, sum) in sums.iter_mut().enumerate().skip(1) {
                let next = value(i as f64 * step);
                for c in 0..3 {
                    total[c] += 0.5 * step * (last[c] + next[c]);
                    sum[c] = total[c] as f32;
                }
                last = next;
            }
        });
        Table { away, reach, sums }
    }

    fn at(&self, t: f64, v: f64) -> [f32; 3] {
        let x = (t / self.reach).clamp(0.0, 1.0) * (ALONG - 1) as f64;
        let y = v.clamp(0.0, 1.0) * (ANGLES - 1) as f64;
        let (x0, y0) = ((x as usize).min(ALONG - 2), (y as usize).min(ANGLES - 2));
        let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let texel = |dx: usize, dy: usize| self.sums[(y0 + dy) * ALONG + x0 + dx];
        let (a, b, c, d) = (texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1));
        std::array::from_fn(|i| {
            (a[i] * (1.0 - fx) + b[i] * fx) * (1.0 - fy) + (c[i] * (1.0 - fx) + d[i] * fx) * fy
        })
    }

    /// Adds `share` of what is scattered between `from` and `to` metres along a ray.
    pub fn add(&self, pixel: &mut [f32; 3], seen: &Seen, from: f64, to: f64, share: f32) {
        let cosine = if self.away > 0.0 {
            -seen.closest / self.away
        } else {
            1.0
        };
        let v = (0.5 + 0.5 * cosine).max(0.0).sqrt();
        let (start, end) = (self.at(from, v), self.at(to, v));
        for c in 0..3 {
            pixel[c] += share * (end[c] - start[c]);
        }
    }
}
