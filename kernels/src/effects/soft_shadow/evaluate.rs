//! One light over many shading points: what is decided early, what is uncertain.

use super::choose::{Chosen, Maps};
use super::doubt::Around;
use super::interpolate::{Grid, thinned};
use super::light::{Bits, Light, Seen};
use super::open::Open;
use super::points::Points;
use super::region::{Search, unit};
use super::tile::{self, Candidates};
use super::{area, fast, plain};
use crate::cancel::CancelFlag;
use crate::simd::{Simd, Work, dispatch};
use pyo3::PyResult;
use rayon::prelude::*;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Method {
    Bitmask,
    PlainBitmask,
    Area,
}

#[derive(Clone, Copy, Debug)]
pub struct Settings {
    pub method: Method,
    pub max_samples: usize,
    /// Points where the map is not to be believed are found, and not evaluated: rays will be. Those in the light's tables
    /// always are.
    pub leave_uncertain: bool,
    /// The same of points at hard edges alone.
    pub leave_edges: bool,
    /// Of an image, every so many-th point each way is evaluated, others only where that does not tell them.
    pub spacing: usize,
}

/// Rows of an image that a thread takes at a time, and columns and rows that share their candidates.
const TILE: usize = 8;
const _: () = assert!(TILE * TILE == tile::MOST_POINTS);

/// A point's uncertainty: the maps answer; rays are to; and are to for what no map knows (`CloseCasters`).
const SURE: u8 = 0;
const UNSURE: u8 = 1;
const CLOSE: u8 = 2;

/// Points that a thread takes at a time if they are no image.
const CHUNK: usize = 512;

/// Visibility and uncertainty of every point.
pub fn evaluate(
    maps: &Maps<'_>,
    points: Points<'_>,
    settings: Settings,
    cancel: &CancelFlag,
) -> PyResult<(Vec<f32>, Vec<u8>)> {
    let is_image = points.width < points.position.len();
    if settings.spacing == 1 || settings.method != Method::Bitmask || !is_image {
        return evaluate_with(maps, points, None, settings, cancel);
    }
    let thin = |items| thinned(items, points.width, settings.spacing);
    let (position, geometric, shading) = (
        thin(points.position),
        thin(points.geometric_normal),
        thin(points.shading_normal),
    );
    let columns = points.width.div_ceil(settings.spacing);
    let coarse = Points {
        position: &position,
        geometric_normal: &geometric,
        shading_normal: &shading,
        width: columns,
    };
    let (visibility, uncertain) = evaluate_with(maps, coarse, None, settings, cancel)?;
    let grid = Grid {
        spacing: settings.spacing,
        columns,
        visibility,
        uncertain,
    };
    evaluate_with(maps, points, Some(&grid), settings, cancel)
}

fn evaluate_with(
    maps: &Maps<'_>,
    points: Points<'_>,
    grid: Option<&Grid>,
    settings: Settings,
    cancel: &CancelFlag,
) -> PyResult<(Vec<f32>, Vec<u8>)> {
    let scene = Scene {
        maps,
        points,
        grid,
        settings,
        see_alike: maps.see_alike(),
    };
    let count = points.position.len();
    let mut visibility = vec![1.0f32; count];
    let mut uncertain = vec![0u8; count];
    let (chunk, width) = if points.width < count {
        (TILE * points.width.max(1), points.width.max(1))
    } else {
        (CHUNK, CHUNK)
    };
    let chunks = visibility
        .par_chunks_mut(chunk)
        .zip(uncertain.par_chunks_mut(chunk));
    chunks.enumerate().for_each(|(number, (visibility, uncertain))| {
        if !cancel.is_set() {
            dispatch(Chunk {
                scene: &scene,
                start: number * chunk,
                width,
                visibility,
                uncertain,
            });
        }
    });
    cancel.check()?;
    Ok((visibility, uncertain))
}

/// Some rows of points, which one thread evaluates.
struct Chunk<'a> {
    scene: &'a Scene<'a>,
    start: usize,
    width: usize,
    visibility: &'a mut [f32],
    uncertain: &'a mut [u8],
}

impl Work for Chunk<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        if self.scene.settings.method != Method::Bitmask {
            for (i, (share, doubt)) in self.visibility.iter_mut().zip(self.uncertain).enumerate() {
                (*share, *doubt) = self.scene.plainly(self.start + i);
            }
            return;
        }
        let rows = self.visibility.len().div_ceil(self.width);
        // As many points where there is but one row.
        let columns = TILE * TILE / rows.clamp(1, TILE);
        let mut candidates = Candidates::default();
        let mut open: Vec<Vec<Open>> = self.scene.maps.list.iter().map(|_| Vec::new()).collect();
        for left in (0..self.width).step_by(columns) {
            let right = (left + columns).min(self.width);
            for row in 0..rows {
                for place in row * self.width + left..(row * self.width + right).min(self.visibility.len()) {
                    self.start(simd, place, &mut open);
                }
            }
            self.finish(simd, &mut open, &mut candidates);
        }
    }
}

impl Chunk<'_> {
    /// Decides a point, or adds it to the list of the first map that it reads.
    #[inline(always)]
    fn start<S: Simd>(&mut self, simd: S, place: usize, open: &mut [Vec<Open>]) {
        let point = self.start + place;
        if let Some(grid) = self.scene.grid
            && let Some(found) = grid.found(&self.scene.points, point)
        {
            (self.visibility[place], self.uncertain[place]) = found;
            return;
        }
        match self.scene.start(simd, point) {
            Start::Done(share, doubt) => {
                (self.visibility[place], self.uncertain[place]) = (share, doubt);
            }
            Start::Open(seen, map, hidden) => {
                let read = self.scene.maps.to_read(map);
                let alike = self.scene.see_alike || map == read.start;
                let seen = if alike {
                    Some(seen)
                } else {
                    self.scene.see(point, &self.scene.maps.list[read.start].light)
                };
                if let Some(seen) = seen {
                    open[read.start].push(self.scene.open(seen, read.start, read.end, hidden, place));
                }
            }
        }
    }

    /// Reads the maps for the open points of a tile, smallest window first.
    #[inline(always)]
    fn finish<S: Simd>(&mut self, simd: S, open: &mut [Vec<Open>], candidates: &mut Candidates) {
        for (number, served) in self.scene.maps.list.iter().enumerate() {
            let (done, rest) = open.split_at_mut(number + 1);
            let points = &mut done[number];
            tile::hide(simd, served, self.scene.maps.refinements, points, candidates);
            let maps = &self.scene.maps.list;
            let end = points.first().map_or(0, |point| point.maps_end);
            let matters = |&next: &usize| {
                !self.scene.see_alike
                    || !tile::is_left_to_inner(&maps[next], self.scene.settings.max_samples, points)
            };
            let next = (number + 1..end).find(matters);
            for point in points.drain(..) {
                let next = next.filter(|_| point.hidden != [u32::MAX; 8]);
                if let Some(next) = next
                    && let served = &maps[next]
                    && let Some(seen) = if self.scene.see_alike {
                        Some(point.seen)
                    } else {
                        self.scene.see(self.start + point.place, &served.light)
                    }
                {
                    let more = self
                        .scene
                        .open(seen, next, point.maps_end, point.hidden, point.place);
                    rest[next - number - 1].push(more);
                } else {
                    self.visibility[point.place] = tile::resolve(simd.widest(), &served.light, &point);
                }
            }
        }
    }
}

/// What is known of a point before its map is read.
enum Start {
    Done(f32, u8),
    /// As the map that it chose sees it, that map, samples hidden already.
    Open(Seen, usize, Bits),
}

struct Scene<'a> {
    maps: &'a Maps<'a>,
    points: Points<'a>,
    grid: Option<&'a Grid>,
    settings: Settings,
    see_alike: bool,
}

impl Scene<'_> {
    fn see(&self, point: usize, light: &Light) -> Option<Seen> {
        light.see(
            self.points.position[point],
            self.points.geometric_normal[point],
            self.points.shading_normal[point],
        )
    }

    fn open(&self, seen: Seen, map: usize, maps_end: usize, hidden: Bits, place: usize) -> Open {
        Open {
            unit: unit(&seen, self.settings.max_samples, self.maps.list[map].map),
            seen,
            hidden,
            maps_end,
            place,
        }
    }

    #[inline(always)]
    fn start<S: Simd>(&self, simd: S, point: usize) -> Start {
        let Some(chosen) = self.maps.choose(|light| self.see(point, light)) else {
            return Start::Done(1.0, SURE);
        };
        let seen = &chosen.seen;
        if !chosen.light.reaches(seen) {
            return Start::Done(1.0, SURE);
        }
        let (lowest, highest) = seen.height_range(seen.geometric_normal);
        let doubt = self.doubt(&chosen, lowest, highest);
        if doubt != SURE {
            return Start::Done(1.0, doubt);
        }
        if let Some(share) = self.grid.and_then(|grid| grid.interpolated(&self.points, point)) {
            return Start::Done(share, SURE);
        }
        let mut hidden = Bits::default();
        if lowest <= 0.0 {
            hidden = fast::horizon(simd.widest(), seen);
        }
        if highest > 0.0
            && let Some(map) = chosen.map
        {
            Start::Open(chosen.seen, map, hidden)
        } else if lowest <= 0.0 {
            Start::Done(fast::resolve(simd.widest(), chosen.light, seen, &hidden), SURE)
        } else {
            Start::Done(1.0, SURE)
        }
    }

    /// Whether rays are to come and know better than the map. `lowest` and `highest`: the light's samples above the geometric
    /// horizon.
    fn doubt(&self, chosen: &Chosen<'_>, lowest: f32, highest: f32) -> u8 {
        let readable = highest > 0.0;
        if readable && chosen.has_close_casters(self.maps) {
            return CLOSE;
        }
        let around = |map: usize| Around::of(self.maps.list[map].map, &chosen.seen);
        let unsure = |map: usize| {
            lowest <= 0.0 || chosen.is_cut_off(self.maps) || {
                let around = around(map);
                around.near_contact || around.at_hard_edge
            }
        };
        let readable = chosen.map.filter(|_| readable);
        let doubtful = if self.settings.leave_uncertain {
            chosen.seen.too_close || readable.is_some_and(unsure)
        } else {
            self.settings.leave_edges && readable.is_some_and(|map| around(map).at_hard_edge)
        };
        if doubtful { UNSURE } else { SURE }
    }

    /// A point by the plain twin of the bitmask or by the sum of areas.
    fn plainly(&self, point: usize) -> (f32, u8) {
        let Settings {
            method, max_samples, ..
        } = self.settings;
        let Some(chosen) = self.maps.choose(|light| self.see(point, light)) else {
            return (1.0, 0);
        };
        let read = chosen.map.map_or(0..0, |map| self.maps.to_read(map));
        // Each map that the point reads, and the point as that map's view sees it.
        let reads = || {
            let list = self.maps.list[read.clone()].iter();
            list.filter_map(|served| Some((served, self.see(point, &served.light)?)))
        };
        let refinements = self.maps.refinements;
        if method == Method::Area {
            let hidden: f32 = reads()
                .filter_map(|(served, seen)| {
                    let region = Search::new(served.map, &seen, refinements)?.whole(max_samples)?;
                    Some(area::hidden(served, &seen, &region))
                })
                .sum();
            return ((1.0 - hidden).max(0.0), 0);
        }
        let seen = &chosen.seen;
        if !chosen.light.reaches(seen) {
            return (1.0, 0);
        }
        let (lowest, highest) = seen.height_range(seen.geometric_normal);
        let doubt = self.doubt(&chosen, lowest, highest);
        if doubt != SURE {
            return (1.0, doubt);
        }
        let mut hidden = if lowest <= 0.0 {
            plain::horizon(seen)
        } else {
            Bits::default()
        };
        if highest > 0.0 {
            for (served, seen) in reads() {
                let search = Search::new(served.map, &seen, refinements);
                let regions = search.map(|search| search.bands(max_samples));
                for region in regions.unwrap_or_default().as_slice() {
                    plain::backproject(served, &seen, region, &mut hidden);
                }
            }
        }
        (plain::resolve(chosen.light, seen, &hidden), 0)
    }
}
