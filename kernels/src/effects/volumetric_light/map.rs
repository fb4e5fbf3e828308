//! A light's depth map, and the stretches of a ray that it lights.
//!
//! The ray is a straight line across the map, and along that line "nearness" (1 / depth, or -depth from a
//! sun) is linear too: a texel lights what is nearer than its own depth. Above the texels lie the lowest and
//! highest nearness of ever larger squares, so that a stretch that is all lit or all dark is one look.

use super::rays::Ray;
use crate::cancel::CancelFlag;
use crate::view::View;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

struct Level {
    width: usize,
    /// Lowest and highest nearness.
    texels: Vec<[f32; 2]>,
}

pub struct LightMap {
    pub view: View,
    width: usize,
    height: usize,
    levels: Vec<Level>,
}

fn halve(below: &Level, height: usize) -> (Level, usize) {
    let (width, rows) = (below.width.div_ceil(2), height.div_ceil(2));
    let mut texels = vec![[0.0; 2]; width * rows];
    texels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let line = |y: usize| &below.texels[y.min(height - 1) * below.width..][..below.width];
        let (low, high) = (line(2 * y), line(2 * y + 1));
        for (x, texel) in row.iter_mut().enumerate() {
            let (left, right) = (2 * x, (2 * x + 1).min(below.width - 1));
            let four = [low[left], low[right], high[left], high[right]];
            texel[0] = four.iter().fold(f32::INFINITY, |m, t| m.min(t[0]));
            texel[1] = four.iter().fold(f32::NEG_INFINITY, |m, t| m.max(t[1]));
        }
    });
    (Level { width, texels }, rows)
}

/// A stretch of a ray inside the map's window: metres from the ray's origin.
#[derive(Clone, Copy, Debug)]
pub struct Inside {
    pub from: f64,
    pub to: f64,
}

impl LightMap {
    /// `depths` (height, width) along the view's forward axis, infinite where nothing is.
    pub fn new(
        view: View,
        width: usize,
        height: usize,
        depths: &[f32],
        cancel: &CancelFlag,
    ) -> PyResult<Self> {
        if width == 0 || height == 0 {
            return Err(PyValueError::new_err("an empty map lights nothing"));
        }
        let nearness = |&depth: &f32| {
            let near = if view.orthographic { -depth } else { 1.0 / depth };
            [near, near]
        };
        let texels = depths.par_iter().map(nearness).collect();
        let mut levels = vec![Level { width, texels }];
        let mut rows = height;
        while levels[levels.len() - 1].width > 1 || rows > 1 {
            cancel.check()?;
            let (level, fewer) = halve(&levels[levels.len() - 1], rows);
            levels.push(level);
            rows = fewer;
        }
        Ok(LightMap {
            view,
            width,
            height,
            levels,
        })
    }

    /// The map's coordinates of a world point relative to its eye: right, up, forward.
    pub fn coordinates(&self, vector: [f64; 3]) -> [f64; 3] {
        let axis = |a: [f64; 3]| a[0] * vector[0] + a[1] * vector[1] + a[2] * vector[2];
        [axis(self.view.right), axis(self.view.up), axis(self.view.forward)]
    }

    /// The part of the ray from `from` to `to` that lies in the window, if any; `origin` relative to the map's
    /// eye and `direction` in the map's axes.
    pub fn inside(&self, origin: [f64; 3], direction: [f64; 3], from: f64, to: f64) -> Option<Inside> {
        let (mut from, mut to) = (from, to);
        let mut clip = |value: f64, slope: f64| {
            // Keeps where value + t slope >= 0.
            if slope > 0.0 {
                from = from.max(-value / slope);
            } else if slope < 0.0 {
                to = to.min(-value / slope);
            } else if value < 0.0 {
                to = f64::NEG_INFINITY;
            }
        };
        let [x, y, z] = origin;
        let [dx, dy, dz] = direction;
        let [left, right, bottom, top] = self.view.window;
        if self.view.orthographic {
            clip(x - left, dx);
            clip(right - x, -dx);
            clip(y - bottom, dy);
            clip(top - y, -dy);
        } else {
            clip(z - self.view.near, dz);
            clip(x - left * z, dx - left * dz);
            clip(right * z - x, right * dz - dx);
            clip(y - bottom * z, dy - bottom * dz);
            clip(top * z - y, top * dz - dy);
        }
        (from < to).then_some(Inside { from, to })
    }

    /// Calls `lit` with every stretch of the ray that no texel shadows, in order; `inside` as [`Self::inside`]
    /// gave it, and finite.
    pub fn walk(
        &self,
        origin: [f64; 3],
        direction: [f64; 3],
        inside: Inside,
        lit: &mut impl FnMut(f64, f64),
    ) {
        let [left, right, bottom, top] = self.view.window;
        let scale = [
            self.width as f64 / (right - left),
            self.height as f64 / (top - bottom),
        ];
        let length = inside.to - inside.from;
        // Where the ray enters and leaves, in texels, with its depth.
        let at = |t: f64| {
            let p: [f64; 3] = std::array::from_fn(|i| origin[i] + t * direction[i]);
            let flat = if self.view.orthographic { 1.0 } else { p[2] };
            (
                [(p[0] / flat - left) * scale[0], (p[1] / flat - bottom) * scale[1]],
                p[2],
            )
        };
        let (start, depth0) = at(inside.from);
        let (end, depth1) = at(inside.to);
        let (near0, near1) = if self.view.orthographic {
            (-depth0, -depth1)
        } else {
            (1.0 / depth0, 1.0 / depth1)
        };
        // Metres along the ray at a share of the line across the map.
        let metres = |share: f64| {
            if self.view.orthographic {
                inside.from + length * share
            } else {
                inside.from + length * (share * near1 / (near0 + share * (near1 - near0)))
            }
        };
        let rise = near1 - near0;
        let mut line = Line::new(start, end, [self.width, self.height]);
        let mut level = (self.levels.len() - 1).min(5);
        line.coarsen(level);
        let mut share = 0.0;
        let mut since = None;
        loop {
            let node = &self.levels[level];
            let [low, high] = node.texels[line.cell[1] * node.width + line.cell[0]].map(f64::from);
            let (exit, axis) = line.exit(level);
            let exit = exit.clamp(share, 1.0);
            let (a, b) = (near0 + rise * share, near0 + rise * exit);
            let all_lit = a.min(b) >= high;
            if !all_lit && a.max(b) >= low && level > 0 {
                level -= 1;
                line.refine(level, share);
                continue;
            }
            if all_lit {
                since.get_or_insert(share);
            } else if a.max(b) < low {
                if let Some(from) = since.take() {
                    lit(metres(from), metres(share));
                }
            } else {
                // The ray crosses the texel's depth inside the texel.
                let crossing = ((high - near0) / rise).clamp(share, exit);
                if rise > 0.0 {
                    if let Some(from) = since.take() {
                        lit(metres(from), metres(share));
                    }
                    since = Some(crossing);
                } else {
                    lit(metres(since.take().unwrap_or(share)), metres(crossing));
                }
            }
            share = exit;
            if exit >= 1.0 || !line.step(axis, level) {
                break;
            }
            // Up again where a larger square begins.
            if level + 1 < self.levels.len() && line.enters(axis, level) {
                level += 1;
                line.cell = [line.cell[0] / 2, line.cell[1] / 2];
            }
        }
        if let Some(from) = since {
            lit(metres(from), inside.to);
        }
    }

    /// Whether a point, in the map's coordinates, is lit; None outside the window.
    pub fn lights(&self, p: [f64; 3]) -> Option<bool> {
        let [left, right, bottom, top] = self.view.window;
        if !self.view.orthographic && p[2] <= self.view.near {
            return None;
        }
        let flat = if self.view.orthographic { 1.0 } else { p[2] };
        let (u, v) = (
            (p[0] / flat - left) / (right - left),
            (p[1] / flat - bottom) / (top - bottom),
        );
        if !(0.0..1.0).contains(&u) || !(0.0..1.0).contains(&v) {
            return None;
        }
        let (x, y) = (
            (u * self.width as f64) as usize,
            (v * self.height as f64) as usize,
        );
        let near = if self.view.orthographic { -p[2] } else { 1.0 / p[2] };
        Some(near >= f64::from(self.levels[0].texels[y * self.width + x][0]))
    }
}

/// A line across a grid, and the square that it is in.
struct Line {
    start: [f64; 2],
    /// Share of the line that a texel takes along each axis; infinite along an axis that it does not move on.
    per_texel: [f64; 2],
    change: [f64; 2],
    size: [usize; 2],
    cell: [usize; 2],
}

impl Line {
    fn new(start: [f64; 2], end: [f64; 2], size: [usize; 2]) -> Line {
        let change = [end[0] - start[0], end[1] - start[1]];
        Line {
            start,
            per_texel: change.map(|c| 1.0 / c),
            change,
            size,
            cell: std::array::from_fn(|i| (start[i].max(0.0) as usize).min(size[i] - 1)),
        }
    }

    fn coarsen(&mut self, levels: usize) {
        self.cell = self.cell.map(|c| c >> levels);
    }

    /// The share of the line at which it leaves the square, and along which axis.
    fn exit(&self, level: usize) -> (f64, usize) {
        let share = |axis: usize| {
            if self.change[axis] == 0.0 {
                return f64::INFINITY;
            }
            let edge = (self.cell[axis] + usize::from(self.change[axis] > 0.0)) << level;
            (edge as f64 - self.start[axis]) * self.per_texel[axis]
        };
        let (x, y) = (share(0), share(1));
        if x <= y { (x, 0) } else { (y, 1) }
    }

    /// To the quarter of the square, a level up, that holds the line at `share`.
    fn refine(&mut self, level: usize, share: f64) {
        for axis in 0..2 {
            let first = self.cell[axis] * 2;
            let last = (self.size[axis] - 1) >> level;
            let place = self.start[axis] + share * self.change[axis];
            let half = ((first + 1) << level) as f64;
            // On the border the line is where it goes to.
            let beyond = if self.change[axis] < 0.0 {
                place > half
            } else {
                place >= half
            };
            self.cell[axis] = (first + usize::from(beyond)).min(last);
        }
    }

    /// To the next square; false at the grid's border.
    fn step(&mut self, axis: usize, level: usize) -> bool {
        if self.change[axis] > 0.0 {
            self.cell[axis] += 1;
            self.cell[axis] <= (self.size[axis] - 1) >> level
        } else {
            self.cell[axis] > 0 && {
                self.cell[axis] -= 1;
                true
            }
        }
    }

    /// Whether the last step entered another square of the next level.
    fn enters(&self, axis: usize, _level: usize) -> bool {
        (self.cell[axis] & 1) == usize::from(self.change[axis] < 0.0)
    }
}

/// A ray as one map sees it.
struct InMap<'a> {
    map: &'a LightMap,
    origin: [f64; 3],
    direction: [f64; 3],
}

/// Calls `stretch` with every stretch of a ray, from `from` to a finite `to`, that no map shadows, in order. Windows of
/// `maps` do not overlap; what none of them shows has nothing before it.
pub fn lit_stretches(maps: &[&LightMap], ray: &Ray, from: f64, to: f64, mut stretch: impl FnMut(f64, f64)) {
    let mut inside: Vec<(InMap, Inside)> = Vec::with_capacity(6);
    for &map in maps {
        let vector = std::array::from_fn(|i| ray.origin[i] - map.view.eye[i]);
        let seen = InMap {
            map,
            origin: map.coordinates(vector),
            direction: map.coordinates(ray.direction),
        };
        if let Some(part) = map.inside(seen.origin, seen.direction, from, to) {
            inside.push((seen, part));
        }
    }
    inside.sort_by(|a, b| a.1.from.total_cmp(&b.1.from));
    // Stretches that meet are one.
    let mut open: Option<(f64, f64)> = None;
    let mut lit = |start: f64, stop: f64| match &mut open {
        _ if stop <= start => {}
        Some((_, end)) if start <= *end => *end = end.max(stop),
        _ => {
            if let Some((start, stop)) = open.replace((start, stop)) {
                stretch(start, stop);
            }
        }
    };
    let mut reached = from;
    for (seen, mut part) in inside {
        if part.from > reached {
            lit(reached, part.from);
        }
        part.from = part.from.max(reached);
        if part.from < part.to {
            seen.map.walk(seen.origin, seen.direction, part, &mut lit);
            reached = part.to;
        }
    }
    if reached < to {
        lit(reached, to);
    }
    if let Some((start, stop)) = open {
        stretch(start, stop);
    }
}
