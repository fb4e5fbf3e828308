//! Light scattered towards the eye along a stretch of a ray, in double precision.
//!
//! With D the distance to the light and tau that along the ray from the closest point, s = tau + D is what a
//! photon travels on its way to the eye, but for a constant. In s extinction is a plain exponential, and with
//! h the ray's distance from the light, D = (s + h^2 / s) / 2 and tau = (s - h^2 / s) / 2. Inverse square,
//! phase function and extinction change on the scales h, h q, 1 / extinction and the light's radius;
//! s = c sinh(y) with c the smallest of them is even below and logarithmic above, so that in y everything is
//! smooth at a scale of about 1, whatever the numbers. Gauss-Legendre panels in y do the rest.

use super::medium::Medium;
use super::source::{Profile, Seen, Source};

/// Widest panel in y, and most extinction over a panel.
pub const PANEL_WIDTH: f64 = 2.0;
pub const PANEL_DEPTH: f64 = 6.0;
/// Widest panel where the source's intensity varies along it too.
const SHAPED_WIDTH: f64 = 1.0;
/// Extinction after which nothing that follows counts.
const OPAQUE: f64 = 40.0;
const NODES: usize = 8;

/// Gauss and Legendre's nodes and weights on 0 to 1, by Newton's method.
pub fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let n = count as f64;
    (0..count)
        .map(|i| {
            let mut x = (std::f64::consts::PI * (n - i as f64 - 0.25) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut before, mut value) = (1.0, x);
                for k in 2..=count {
                    let k = k as f64;
                    (before, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
                }
                slope = n * (before - x * value) / (1.0 - x * x);
                let step = value / slope;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            (0.5 * (x + 1.0), 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// (1 - exp(-x)) / x.
pub fn mean_transmittance(x: f64) -> f64 {
    if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 }
}

/// Per unit of irradiance and per channel: a sun's light scattered between `from` and `to` metres from the eye;
/// `ahead` and `behind` as [`Medium::phase`] has them.
pub fn distant(medium: &Medium, ahead: f64, behind: f64, from: f64, to: f64) -> [f64; 3] {
    let phase = medium.phase(ahead, behind, 0.0);
    let reach = |extinction: f64| {
        // To the end of the world: what is left is all that is left.
        let mean = if to.is_finite() {
            (to - from) * mean_transmittance(extinction * (to - from))
        } else {
            1.0 / extinction
        };
        mean * (-extinction * from).exp()
    };
    let mut last = (f64::NAN, 0.0);
    std::array::from_fn(|c| {
        let (scattering, extinction) = (medium.scattering[c], medium.extinction[c]);
        if scattering == 0.0 || to <= from {
            return 0.0;
        }
        if extinction != last.0 {
            last = (extinction, reach(extinction));
        }
        phase * scattering * last.1
    })
}

/// What light has gone through before and until a point of the ray, in metres of medium; `beyond` says how much
/// more that is at `tau` than at the stretch's start, in terms of the change of s.
pub trait Travelled {
    fn start(&self) -> f64;
    fn beyond(&self, tau: f64, change_of_s: f64) -> f64;
    /// Extinction over the change of s that ends the integral.
    fn opaque(&self) -> f64;
}

/// In a medium that is everywhere.
pub struct Everywhere {
    pub start: f64,
}

impl Travelled for Everywhere {
    fn start(&self) -> f64 {
        self.start
    }
    fn beyond(&self, _tau: f64, change_of_s: f64) -> f64 {
        change_of_s
    }
    fn opaque(&self) -> f64 {
        OPAQUE
    }
}

/// A sharp peak is blurred by a light's size from further away than the light fills much: the way that is shorter,
/// of that on which it does.
pub fn blurring_scale(anisotropy: f64) -> f64 {
    if anisotropy > 0.5 {
        ((1.0 - anisotropy) / anisotropy).sqrt()
    } else {
        1.0
    }
}

/// The smallest scale of the integrand in s.
pub fn smallest_scale(source: &Source, seen: &Seen, anisotropy: f64, extinction: f64) -> f64 {
    let h = seen.height;
    let mut scale = h;
    if anisotropy > 0.0 {
        scale = scale.min(h * (1.0 - anisotropy) / (1.0 + anisotropy));
    }
    if extinction > 0.0 {
        scale = scale.min(1.0 / extinction);
    }
    if source.radius > 0.0 && h < source.radius {
        scale = scale.min(0.5 * h * h / source.radius * blurring_scale(anisotropy));
    }
    scale
}

/// Per unit of intensity and per channel: light scattered between `from` and `to` (tau) on a stretch where
/// the source's profile is smooth.
pub fn near(
    medium: &Medium,
    source: &Source,
    seen: &Seen,
    from: f64,
    to: f64,
    travelled: &impl Travelled,
) -> [f64; 3] {
    let mut result = [0.0; 3];
    let nodes = gauss_legendre(NODES);
    for group in medium.groups() {
        let low = group
            .iter()
            .map(|&c| medium.extinction[c])
            .fold(f64::INFINITY, f64::min);
        let high = group.iter().map(|&c| medium.extinction[c]).fold(0.0, f64::max);
        let (s0, d0) = (seen.sum(from), seen.distance(from));
        let longest = if low > 0.0 {
            travelled.opaque() / low
        } else {
            f64::INFINITY
        };
        let to = to.min(1e30);
        let change = (to - from) * ((s0 + seen.sum(to)) / (d0 + seen.distance(to)));
        let change = change.min(longest);
        if change.is_nan() || change <= 0.0 {
            continue;
        }
        let c = smallest_scale(source, seen, medium.anisotropy, high);
        let (a0, a1) = (s0 / c, (s0 + change) / c);
        let (cosh0, cosh1) = (1f64.hypot(a0), 1f64.hypot(a1));
        let width = ((change / c) * (a0 + a1) / (a1 * cosh0 + a0 * cosh1)).asinh();
        let widest = if source.profile == Profile::Uniform {
            PANEL_WIDTH
        } else {
            SHAPED_WIDTH
        };
        let panels = (width / widest).max(high * change / PANEL_DEPTH).ceil().max(1.0);
        let step = width / panels;
        for panel in 0..panels as usize {
            for &(place, weight) in &nodes {
                // sinh(y0 + d) - sinh(y0) = 2 sinh(d / 2) cosh(y0 + d / 2).
                let half = 0.5 * step * (panel as f64 + place);
                let (sinh, cosh) = (half.sinh(), half.cosh());
                let grown = 2.0 * c * sinh * (cosh0 * cosh + a0 * sinh);
                let s = s0 + grown;
                let mirrored = seen.height * (seen.height / s);
                let (tau, distance) = (0.5 * (s - mirrored), 0.5 * (s + mirrored));
                let sides = s + mirrored;
                let (falloff, filled) = source.falloff(distance);
                let value = medium.phase(s / sides, mirrored / sides, filled)
                    * falloff
                    * seen.intensity(&source.profile, tau, distance, filled)
                    * (distance / s)
                    * s.hypot(c)
                    * (weight * step);
                let path = travelled.beyond(tau, grown);
                for &channel in &group {
                    result[channel] += value * (-medium.extinction[channel] * path).exp();
                }
            }
        }
    }
    std::array::from_fn(|c| {
        result[c] * medium.scattering[c] * (-medium.extinction[c] * travelled.start()).exp()
    })
}
