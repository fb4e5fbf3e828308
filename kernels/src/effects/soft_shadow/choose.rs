//! Which of a light's maps serve a point.

use super::light::{Light, Seen};
use super::prepare::PreparedMap;
use super::region::Search;
use super::window::{NOWHERE, Window};
use crate::emitter::{Emitter, EmitterKind};
use crate::view::View;
use std::ops::Range;

/// For each place in a map's window, rows from the bottom, whether casters so close to the light that no map knows them
/// may hide a part of it from there.
#[derive(Clone, Copy)]
pub struct CloseCasters<'a> {
    pub columns: usize,
    pub cells: &'a [u8],
}

impl CloseCasters<'_> {
    fn holds(&self, window: &Window<f64>, seen: &Seen) -> bool {
        let rows = self.cells.len() / self.columns;
        // Saturates, and a NaN is the first.
        let cell = |at: f64, low: f64, high: f64, count: usize| {
            (((at - low) / (high - low) * count as f64) as usize).min(count - 1)
        };
        let column = cell(seen.window_x, window[0], window[1], self.columns);
        let row = cell(seen.window_y, window[2], window[3], rows);
        self.cells[row * self.columns + column] != 0
    }
}

/// Slope up to which points belong to a cube's face: 45 degrees and what rounding may make of it (`FACE_TANGENT` of views.py).
const FACE: f64 = 1.02;

/// Slope up to which a face's or a spot's widest map knows what may hide the light (`WIDEST_TANGENT` of views.py).
const WIDEST: f64 = 15.0;

/// One map of a light.
pub struct Served<'a> {
    pub light: Light,
    pub map: &'a PreparedMap,
    /// The next smaller window of nested ones, in this map's coordinates: texels within are that map's matter.
    pub inner: Window<f64>,
    close_casters: Option<CloseCasters<'a>>,
    /// It and the nested windows that share its eye and direction: a point that chose one reads them all.
    nest: Range<usize>,
}

pub struct Maps<'a> {
    /// Nests of windows, each of one eye and direction, the smallest window first: one, or some of the six faces of a cube.
    pub list: Vec<Served<'a>>,
    /// For points that no map serves.
    unmapped: Vec<Light>,
    is_round: bool,
    pub refinements: usize,
}

/// A point in one view of the light.
pub struct Chosen<'a> {
    pub light: &'a Light,
    pub seen: Seen,
    pub map: Option<usize>,
}

impl Chosen<'_> {
    /// Whether what is close to the light is known to hide a part of it where none of the maps that are read looks.
    pub fn has_close_casters(&self, maps: &Maps) -> bool {
        let Some(map) = self.map else { return false };
        let served = &maps.list[map];
        let close_casters =
            |close_casters: CloseCasters| close_casters.holds(&served.map.view.window, &self.seen);
        served.close_casters.is_some_and(close_casters)
    }

    /// Whether what can hide the light may lie beyond the slopes that the maps look at, where no table says so better.
    pub fn is_cut_off(&self, maps: &Maps) -> bool {
        let unknown = |map: &usize| maps.list[*map].close_casters.is_none();
        let nest = |map: usize| &maps.list[map].nest;
        let map = self.map.filter(unknown);
        map.is_some_and(|map| !maps.know_all(nest(map), &self.seen))
    }
}

impl<'a> Maps<'a> {
    /// `maps`: nests of windows, the smallest first in each; `close_casters`: one for each map, or none; `eye`: what points are
    /// relative to.
    pub fn new(
        emitter: &Emitter,
        maps: &[&'a PreparedMap],
        close_casters: &[CloseCasters<'a>],
        eye: [f64; 3],
        refinements: usize,
    ) -> Self {
        let light = |view: &View| Light::new(emitter, view, eye);
        let nests = maps.chunk_by(|a, b| share_axes(&a.view, &b.view));
        let starts = nests.scan(0, |end, nest| {
            let start = *end;
            *end += nest.len();
            Some(start..*end)
        });
        let served = |(number, nest): (usize, Range<usize>)| Served {
            light: light(&maps[number].view),
            map: maps[number],
            inner: if number > nest.start {
                seen_from(&maps[number].view, &maps[number - 1].view)
            } else {
                NOWHERE
            },
            close_casters: close_casters.get(number).copied(),
            nest,
        };
        let in_nests = starts.flat_map(|nest| nest.clone().map(move |number| (number, nest.clone())));
        Maps {
            list: in_nests.map(served).collect(),
            unmapped: default_views(emitter).iter().map(light).collect(),
            is_round: matches!(emitter.kind, EmitterKind::Sphere | EmitterKind::FacingDisk),
            refinements,
        }
    }

    /// Whether the maps of each nest see a point alike, having one eye.
    pub fn see_alike(&self) -> bool {
        let alike = |served: &Served| served.map.view.eye == self.list[served.nest.start].map.view.eye;
        self.list.iter().all(alike)
    }

    /// The maps that a point which chose `map` has to read.
    pub fn to_read(&self, map: usize) -> Range<usize> {
        self.list[map].nest.clone()
    }

    /// Of faces the point's own; of its nested maps the smallest that holds the point, else the widest.
    pub fn choose(&self, see: impl Fn(&Light) -> Option<Seen>) -> Option<Chosen<'_>> {
        let mut nests = self.list.chunk_by(|a, b| a.nest == b.nest);
        let served = nests.find_map(|nest| {
            let seen = see(&nest.last()?.light)?;
            let is_alone = nest.len() == self.list.len();
            let is_own = is_alone || seen.window_x.abs().max(seen.window_y.abs()) <= FACE;
            is_own.then(|| self.smallest_of(&nest[0].nest, seen, &see))
        });
        served.or_else(|| {
            // Of the six axes the one nearest to the point's direction: the largest depth.
            let seen = self
                .unmapped
                .iter()
                .filter_map(|light| Some((light, see(light)?)));
            let (light, seen) = seen.max_by(|a, b| a.1.base[2].total_cmp(&b.1.base[2]))?;
            let map = None;
            Some(Chosen { light, seen, map })
        })
    }

    /// The smallest window that holds the point, which the widest sees as `widest`.
    fn smallest_of(
        &self,
        nest: &Range<usize>,
        widest: Seen,
        see: impl Fn(&Light) -> Option<Seen>,
    ) -> Chosen<'_> {
        let last = nest.end - 1;
        let holding = (nest.start..last).find_map(|number| {
            let served = &self.list[number];
            let seen = see(&served.light)?;
            let [left, right, bottom, top] = served.map.view.window;
            let (x, y) = (seen.window_x, seen.window_y);
            (left <= x && x <= right && bottom <= y && y <= top).then_some((number, seen))
        });
        let (number, seen) = holding.unwrap_or((last, widest));
        Chosen {
            light: &self.list[number].light,
            seen,
            map: Some(number),
        }
    }

    /// Whether all that can hide the light lies within the slopes that the nest's widest map looks at. A flat light's
    /// own plane ends what does, so that slopes beyond them hardly count.
    fn know_all(&self, nest: &Range<usize>, seen: &Seen) -> bool {
        !self.is_round
            || Search::new(self.list[nest.end - 1].map, seen, self.refinements)
                .is_none_or(|search| search.is_within(WIDEST))
    }
}

/// Whether window coordinates of the two differ by a shift at most, which only an orthographic eye may make.
fn share_axes(a: &View, b: &View) -> bool {
    let turned = a.right != b.right || a.up != b.up || a.forward != b.forward;
    !turned && a.orthographic == b.orthographic && (a.orthographic || a.eye == b.eye)
}

/// The window of `other` in the coordinates of `view`.
fn seen_from(view: &View, other: &View) -> Window<f64> {
    let mut window = other.window;
    if view.orthographic {
        for (axis, direction) in [view.right, view.up].iter().enumerate() {
            let shift: f64 = (0..3).map(|i| direction[i] * (other.eye[i] - view.eye[i])).sum();
            window[2 * axis] += shift;
            window[2 * axis + 1] += shift;
        }
    }
    window
}

/// Views to see a light in where it needs no map: its own axes, or the six axes of the world.
fn default_views(emitter: &Emitter) -> Vec<View> {
    let view = |right, up, forward| View {
        eye: emitter.centre,
        right,
        up,
        forward,
        window: [-1.0, 1.0, -1.0, 1.0],
        near: 0.0,
        far: 1.0,
        orthographic: emitter.kind == EmitterKind::DistantDisk,
    };
    if !matches!(emitter.kind, EmitterKind::Sphere | EmitterKind::FacingDisk) {
        return vec![view(emitter.right, emitter.up, emitter.forward)];
    }
    let unit = |axis: usize, length: f64| {
        let mut vector = [0.0; 3];
        vector[axis % 3] = length;
        vector
    };
    let faces = (0..3).flat_map(|axis| [(axis, -1.0), (axis, 1.0)]);
    faces
        .map(|(axis, sign)| view(unit(axis + 1, -sign), unit(axis + 2, 1.0), unit(axis, sign)))
        .collect()
}
