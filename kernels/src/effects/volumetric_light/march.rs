//! A jittered march through the same maps, to compare the walk with.

use super::map::LightMap;
use super::rays::Ray;
use super::scene::{Scene, Span, turn};
use super::source::Seen;

impl Scene<'_> {
    /// The share of the source that a point sees.
    fn lit_share(&self, point: [f64; 3]) -> f64 {
        let lit = |maps: &&Vec<&LightMap>| {
            maps.iter().all(|map| {
                let vector = std::array::from_fn(|i| point[i] - map.view.eye[i]);
                map.lights(map.coordinates(vector)).unwrap_or(true)
            })
        };
        self.maps.iter().filter(lit).count() as f64 / self.maps.len() as f64
    }
}

/// So many steps from `from` to `to`, each looked up in the maps at one random place.
pub fn march(
    scene: &Scene,
    pixel: &mut [f32; 3],
    ray: &Ray,
    seen: &Seen,
    span: Span,
    [from, to]: [f64; 2],
    steps: usize,
) {
    let thinnest = scene
        .medium
        .extinction
        .iter()
        .fold(f64::INFINITY, |a, &b| a.min(b));
    let to = to.min(from + 20.0 / thinnest);
    let step = (to - from) / steps as f64;
    let bits = (ray.direction[0].to_bits() ^ ray.direction[1].to_bits().rotate_left(17))
        .wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let jitter = (bits >> 40) as f64 / (1u64 << 24) as f64;
    for i in 0..steps {
        let t = from + step * (i as f64 + jitter);
        let point = std::array::from_fn(|k| ray.origin[k] + t * ray.direction[k]);
        let share = scene.lit_share(point);
        if share == 0.0 {
            continue;
        }
        let mut metres = span.before + (t - span.from);
        let (mut value, (ahead, behind)) = (step * share, turn(&scene.source, ray));
        let mut phase = (ahead, behind, 0.0);
        if !scene.source.distant {
            let tau = t - seen.closest;
            let (distance, s) = (seen.distance(tau), seen.sum(tau));
            metres += distance;
            let (falloff, filled) = scene.source.falloff(distance);
            phase = (0.5 * s / distance, 1.0 - 0.5 * s / distance, filled);
            value *= falloff * seen.intensity(&scene.source.profile, tau, distance, filled);
        }
        value *= scene.medium.phase(phase.0, phase.1, phase.2);
        for (c, sum) in pixel.iter_mut().enumerate() {
            let arrives = (-scene.medium.extinction[c] * metres).exp();
            *sum += (value * scene.medium.scattering[c] * arrives) as f32;
        }
    }
}
