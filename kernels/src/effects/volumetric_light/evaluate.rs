//! Light scattered towards the eye along every ray of a lattice.

use super::integral::{self, Everywhere, Travelled, gauss_legendre};
use super::lanes::{Batch, OpenRow, Setup};
use super::map::lit_stretches;
use super::march::march;
use super::medium::Medium;
use super::rays::Ray;
use super::scene::{Method, Scene, Span, turn};
use super::source::{Profile, Seen, Source};
use super::spans;
use crate::cancel::CancelFlag;
use crate::simd::dispatch;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Nothing that casts shadows is further away, metres.
const FAR: f64 = 1e9;

impl Scene<'_> {
    /// (height * width) in-scattered radiance per unit of intensity or irradiance; `depth` along the view's axis.
    pub fn evaluate(&self, depth: &[f32], width: usize, cancel: &CancelFlag) -> PyResult<Vec<[f32; 3]>> {
        let mut image = vec![[0.0f32; 3]; depth.len()];
        let setup = Setup::new(&self.medium, &self.source, self.order);
        let looked_up = self.bounded.as_ref().is_some_and(|b| !b.surrounds_light());
        let open = self.offsets.is_none()
            && self.unshadowed()
            && self.bounded.is_none()
            && !self.lattice.orthographic
            && self.source.profile == Profile::Uniform
            && matches!(self.method, Method::Walk);
        image
            .par_chunks_mut(width)
            .zip(depth.par_chunks(width))
            .enumerate()
            .try_for_each(|(y, (row, depths))| {
                cancel.check()?;
                if open {
                    dispatch(OpenRow {
                        setup: &setup,
                        lattice: &self.lattice,
                        source: &self.source,
                        y,
                        depths,
                        image: row,
                    });
                    return Ok(());
                }
                let mut work = Row {
                    scene: self,
                    setup: &setup,
                    batch: Batch::default(),
                    spans: Vec::new(),
                    ends: Vec::new(),
                    nodes: gauss_legendre(self.order),
                    looked_up,
                };
                for (x, &depth_here) in depths.iter().enumerate() {
                    let bounded = self.bounded.as_ref().map(|b| {
                        let plane = depth.len();
                        (0..b.layers).map(move |layer| b.depths[layer * plane + y * width + x])
                    });
                    let [across, along] = self
                        .offsets
                        .map_or([0.0; 2], |each| each[y * width + x].map(f64::from));
                    let ray = self.lattice.ray([x as f64 + across, y as f64 + along]);
                    work.ray(row, x, &ray, depth_here, bounded);
                }
                work.batch.finish(&setup, row);
                PyResult::Ok(())
            })?;
        Ok(image)
    }

    /// Metres of medium that light has come through to a point.
    fn light_travelled(&self, point: [f64; 3]) -> f64 {
        let bounded = self.bounded.as_ref().expect("only bounded media ask");
        for map in &bounded.maps {
            let vector = std::array::from_fn(|i| point[i] - map.view().eye[i]);
            if let Some(metres) = map.travelled(map.map.coordinates(vector)) {
                return metres;
            }
        }
        0.0
    }

    fn unshadowed(&self) -> bool {
        self.maps.iter().all(Vec::is_empty)
    }
}

struct Row<'a> {
    scene: &'a Scene<'a>,
    setup: &'a Setup,
    batch: Batch,
    spans: Vec<(f64, f64)>,
    /// Places along the ray where points of the source begin (1) or cease (-1) to light it.
    ends: Vec<(f64, i32)>,
    nodes: Vec<(f64, f64)>,
    /// Whether the way that light has come through the medium has to be looked up.
    looked_up: bool,
}

impl Row<'_> {
    fn ray(
        &mut self,
        row: &mut [[f32; 3]],
        pixel: usize,
        ray: &Ray,
        depth: f32,
        bounded: Option<impl Iterator<Item = f32>>,
    ) {
        let scene = self.scene;
        let near = scene.lattice.near * ray.per_depth;
        let end = f64::from(depth) * ray.per_depth;
        if depth.is_nan() || end <= near {
            return;
        }
        let seen = Seen::new(
            &scene.source,
            std::array::from_fn(|i| ray.origin[i] - scene.source.position[i]),
            ray.direction,
        );
        let Some(depths) = bounded else {
            let span = Span {
                pixel,
                from: near,
                before: 0.0,
            };
            return self.span(row, ray, &seen, span, end);
        };
        let mut spans = std::mem::take(&mut self.spans);
        let scaled = depths.map(|d| d * ray.per_depth as f32);
        spans::inside(scaled, near, end, &mut spans);
        let mut before = 0.0;
        for &(from, to) in &spans {
            let span = Span { pixel, from, before };
            self.span(row, ray, &seen, span, to);
            before += to - from;
        }
        self.spans = spans;
    }

    /// A stretch inside the medium, from `span.from` to `end`.
    fn span(&mut self, row: &mut [[f32; 3]], ray: &Ray, seen: &Seen, span: Span, end: f64) {
        let source = &self.scene.source;
        if source.distant {
            return self.piece(row, ray, seen, span, span.from, end);
        }
        let closest = seen.closest;
        seen.pieces(source, span.from - closest, end - closest, |from, to| {
            self.piece(row, ray, seen, span, from + closest, to + closest);
        });
    }

    /// A stretch on which the source's profile is smooth.
    fn piece(&mut self, row: &mut [[f32; 3]], ray: &Ray, seen: &Seen, span: Span, from: f64, to: f64) {
        if let Method::March(steps) = self.scene.method {
            return march(
                self.scene,
                &mut row[span.pixel],
                ray,
                seen,
                span,
                [from, to],
                steps,
            );
        }
        if self.scene.unshadowed() {
            return self.stretch(row, ray, seen, span, from, to, 1.0);
        }
        let to = to.min(FAR);
        if let [maps] = &self.scene.maps[..] {
            return lit_stretches(maps, ray, from, to, |start, stop| {
                self.stretch(row, ray, seen, span, start, stop, 1.0);
            });
        }
        // The source's points see different stretches: between any two of their ends a share of them sees all.
        let mut ends = std::mem::take(&mut self.ends);
        ends.clear();
        for maps in &self.scene.maps {
            lit_stretches(maps, ray, from, to, |start, stop| {
                ends.extend([(start, 1), (stop, -1)]);
            });
        }
        ends.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let per_point = 1.0 / self.scene.maps.len() as f64;
        let mut seeing = 0;
        for (i, &(start, change)) in ends.iter().enumerate() {
            seeing += change;
            if seeing > 0 {
                let stop = ends[i + 1].0;
                self.stretch(row, ray, seen, span, start, stop, per_point * f64::from(seeing));
            }
        }
        self.ends = ends;
    }

    /// A stretch that `share` of the source lights.
    fn stretch(
        &mut self,
        row: &mut [[f32; 3]],
        ray: &Ray,
        seen: &Seen,
        span: Span,
        from: f64,
        to: f64,
        share: f64,
    ) {
        if to <= from {
            return;
        }
        let scene = self.scene;
        let before = span.before + (from - span.from);
        let tau = from - seen.closest;
        if self.looked_up {
            let sum = self.bounded(ray, seen, before, from, to);
            for c in 0..3 {
                row[span.pixel][c] += (share * sum[c]) as f32;
            }
        } else if scene.source.distant {
            let (ahead, behind) = turn(&scene.source, ray);
            let sum = integral::distant(&scene.medium, ahead, behind, before, before + (to - from));
            for c in 0..3 {
                row[span.pixel][c] += (share * sum[c]) as f32;
            }
        } else if let Method::Table(table) = &scene.method {
            table.add(&mut row[span.pixel], seen, from, to, share as f32);
        } else {
            let travelled = before + seen.distance(tau);
            let weight = share as f32;
            self.batch.push(
                self.setup,
                row,
                span.pixel,
                seen,
                tau,
                to - from,
                travelled,
                weight,
            );
        }
    }

    /// In a bounded medium the way that light has come is looked up at every node.
    fn bounded(&self, ray: &Ray, seen: &Seen, before: f64, from: f64, to: f64) -> [f64; 3] {
        let scene = self.scene;
        let path = |t: f64| {
            let point = std::array::from_fn(|i| ray.origin[i] + t * ray.direction[i]);
            before + (t - from) + scene.light_travelled(point)
        };
        if !scene.source.distant {
            let way = Looked {
                path: &path,
                closest: seen.closest,
                start: path(from),
            };
            let (start, end) = (from - seen.closest, to - seen.closest);
            return integral::near(&scene.medium, &scene.source, seen, start, end, &way);
        }
        let (ahead, behind) = turn(&scene.source, ray);
        let phase = scene.medium.phase(ahead, behind, 0.0);
        let thickest = scene.medium.extinction.iter().fold(0.0f64, |a, &b| a.max(b));
        let panels = (thickest * (to - from) / 3.0).ceil().clamp(1.0, 64.0);
        let step = (to - from) / panels;
        let mut sum = [0.0; 3];
        for panel in 0..panels as usize {
            for &(place, weight) in &self.nodes {
                let metres = path(from + step * (panel as f64 + place));
                for (c, sum) in sum.iter_mut().enumerate() {
                    *sum += weight * step * (-scene.medium.extinction[c] * metres).exp();
                }
            }
        }
        std::array::from_fn(|c| sum[c] * phase * scene.medium.scattering[c])
    }
}

/// The way through a bounded medium, looked up.
struct Looked<'a, F: Fn(f64) -> f64> {
    path: &'a F,
    closest: f64,
    start: f64,
}

impl<F: Fn(f64) -> f64> Travelled for Looked<'_, F> {
    fn start(&self) -> f64 {
        self.start
    }
    fn beyond(&self, tau: f64, _change_of_s: f64) -> f64 {
        (self.path)(tau + self.closest) - self.start
    }
    fn opaque(&self) -> f64 {
        // Of light from outside s grows faster than what it goes through.
        100.0
    }
}

/// One stretch by itself, in double precision: for tests.
pub fn one(
    medium: &Medium,
    source: &Source,
    origin: [f64; 3],
    direction: [f64; 3],
    from: f64,
    to: f64,
) -> [f64; 3] {
    let seen = Seen::new(
        source,
        std::array::from_fn(|i| origin[i] - source.position[i]),
        direction,
    );
    if source.distant {
        let ray = Ray {
            origin,
            direction,
            per_depth: 1.0,
        };
        let (ahead, behind) = turn(source, &ray);
        return integral::distant(medium, ahead, behind, from, to);
    }
    let mut sum = [0.0; 3];
    seen.pieces(source, from - seen.closest, to - seen.closest, |start, end| {
        let start_of_way = start + seen.closest + seen.distance(start);
        let part = integral::near(
            medium,
            source,
            &seen,
            start,
            end,
            &Everywhere { start: start_of_way },
        );
        for c in 0..3 {
            sum[c] += part[c];
        }
    });
    sum
}
