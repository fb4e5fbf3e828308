//! A bounded medium: where camera rays are inside it, and how far light has come through it.

use super::map::LightMap;
use crate::view::View;

/// The stretches of a ray between entries and exits: `depths` ascending, infinite where there are no more. An odd
/// number of them means that the ray begins inside.
pub fn inside(depths: impl Iterator<Item = f32>, near: f64, end: f64, spans: &mut Vec<(f64, f64)>) {
    spans.clear();
    let crossings: Vec<f64> = depths.map(f64::from).take_while(|d| d.is_finite()).collect();
    let mut from = (crossings.len() % 2 == 1).then_some(near);
    for crossing in crossings {
        match from.take() {
            None => from = Some(crossing),
            Some(start) => {
                let (start, stop) = (start.max(near), crossing.min(end));
                if start < stop {
                    spans.push((start, stop));
                }
            }
        }
    }
}

/// Entries and exits of the medium from a light, for the way that light has come.
pub struct MediumMap {
    pub map: LightMap,
    layers: usize,
    width: usize,
    height: usize,
    depths: Vec<f32>,
    /// The only stretch inside at each texel; NaN where there are several.
    single: Vec<[f32; 2]>,
    /// Whether every texel begins inside and leaves the medium once: then what lies inside has nothing else before it.
    pub begins_inside: bool,
}

impl MediumMap {
    /// `depths` (layers, height, width); `map` the same view, for its coordinates.
    pub fn new(map: LightMap, layers: usize, width: usize, height: usize, depths: Vec<f32>) -> MediumMap {
        let plane = width * height;
        let at = |layer: usize, texel: usize| {
            if layer < layers {
                depths[layer * plane + texel]
            } else {
                f32::INFINITY
            }
        };
        let single: Vec<[f32; 2]> = (0..plane)
            .map(
                |texel| match [0, 1, 2].map(|layer| at(layer, texel).is_finite()) {
                    [false, ..] => [0.0, 0.0],
                    [true, false, _] => [0.0, at(0, texel)],
                    [true, true, false] => [at(0, texel), at(1, texel)],
                    _ => [f32::NAN; 2],
                },
            )
            .collect();
        let once = |texel: usize| at(0, texel).is_finite() && !at(1, texel).is_finite();
        MediumMap {
            begins_inside: !map.view.orthographic && (0..plane).all(once),
            map,
            layers,
            width,
            height,
            depths,
            single,
        }
    }

    pub fn view(&self) -> &View {
        &self.map.view
    }

    /// Depth inside the medium from the eye to `depth` at a texel.
    fn within(&self, x: usize, y: usize, depth: f32) -> f32 {
        let [from, to] = self.single[y * self.width + x];
        if !from.is_nan() {
            return (depth.min(to) - from).max(0.0);
        }
        let at = |layer: usize| self.depths[(layer * self.height + y) * self.width + x];
        let count = (0..self.layers)
            .take_while(|&layer| at(layer).is_finite())
            .count();
        let mut inside = count % 2 == 1;
        let (mut sum, mut last) = (0.0, 0.0f32);
        for layer in 0..count {
            let next = at(layer);
            if inside {
                sum += next.min(depth) - last.min(depth);
            }
            inside = !inside;
            last = next;
        }
        sum
    }

    /// Metres of medium between the light and a point in the map's coordinates; None outside the window.
    pub fn travelled(&self, p: [f64; 3]) -> Option<f64> {
        let view = self.view();
        let [left, right, bottom, top] = view.window;
        if !view.orthographic && p[2] <= 0.0 {
            return None;
        }
        let flat = if view.orthographic { 1.0 } else { p[2] };
        let (u, v) = (p[0] / flat, p[1] / flat);
        if !(left..=right).contains(&u) || !(bottom..=top).contains(&v) {
            return None;
        }
        let x = (u - left) / (right - left) * self.width as f64 - 0.5;
        let y = (v - bottom) / (top - bottom) * self.height as f64 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let depth = p[2] as f32;
        let sample = |dx: f64, dy: f64| {
            let x = (x0 + dx).clamp(0.0, (self.width - 1) as f64) as usize;
            let y = (y0 + dy).clamp(0.0, (self.height - 1) as f64) as usize;
            f64::from(self.within(x, y, depth))
        };
        let (fx, fy) = (x - x0, y - y0);
        let low = sample(0.0, 0.0) * (1.0 - fx) + sample(1.0, 0.0) * fx;
        let high = sample(0.0, 1.0) * (1.0 - fx) + sample(1.0, 1.0) * fx;
        let slant = if view.orthographic {
            1.0
        } else {
            (1.0 + u * u + v * v).sqrt()
        };
        Some((low * (1.0 - fy) + high * fy) * slant)
    }
}
