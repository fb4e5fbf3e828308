//! Which of a light's maps serve a point.

use super::light::{Light, Seen};
use super::prepare::PreparedMap;
use super::region::Search;
use crate::emitter::{Emitter, EmitterKind};
use crate::view::View;

/// Left, right, bottom, top of a window; empty where left is not below right.
pub type Window<T> = [T; 4];

/// Holds nothing.
pub const NOWHERE: Window<f64> = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];

/// A window relative to a place in it.
pub fn from_point(window: &Window<f64>, [x, y]: [f64; 2]) -> Window<f32> {
    let [left, right, bottom, top] = *window;
    [left - x, right - x, bottom - y, top - y].map(|side| side as f32)
}

/// For each place in a map's window, rows from the bottom, whether casters close to the light and beside the
/// window may hide a part of it from there.
#[derive(Clone, Copy)]
pub struct Beside<'a> {
    pub columns: usize,
    pub cells: &'a [u8],
}

impl Beside<'_> {
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

/// One map of a light.
pub struct Served<'a> {
    pub light: Light,
    pub map: &'a PreparedMap,
    /// The next smaller window of nested ones, in this map's coordinates: texels within are that map's matter.
    pub inner: Window<f64>,
    beside: Option<Beside<'a>>,
}

/// How a light's maps share the work.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Sharing {
    /// There is but one.
    Alone,
    /// One eye and one direction, each window around the one before: a point reads them all.
    Nested,
    /// Faces of a cube: a point reads one.
    Faces,
}

pub struct Maps<'a> {
    /// Smallest window first.
    pub list: Vec<Served<'a>>,
    /// For points that no map serves.
    unmapped: Vec<Light>,
    sharing: Sharing,
    pub refinements: usize,
}

/// A point in one view of the light.
pub struct Chosen<'a> {
    pub light: &'a Light,
    pub seen: Seen,
    pub map: Option<usize>,
    /// The map holds all that can hide the light, as far as it knows.
    whole: bool,
}

impl Chosen<'_> {
    /// Whether what can hide the light may lie beyond the border of the one map that is read.
    pub fn is_cut_off(&self, maps: &Maps) -> bool {
        let Some(map) = self.map else { return false };
        let served = &maps.list[map];
        let beside = |beside: Beside| beside.holds(&served.map.view.window, &self.seen);
        !self.whole || served.beside.is_some_and(beside)
    }
}

impl<'a> Maps<'a> {
    /// `maps`: smallest window first; `beside`: one for each map, or none; `eye`: what points are relative to.
    pub fn new(
        emitter: &Emitter,
        maps: &[&'a PreparedMap],
        beside: &[Beside<'a>],
        eye: [f64; 3],
        refinements: usize,
    ) -> Self {
        let light = |view: &View| Light::new(emitter, view, eye);
        let is_nested = maps
            .windows(2)
            .all(|pair| share_axes(&pair[0].view, &pair[1].view));
        let sharing = match maps.len() {
            0 | 1 => Sharing::Alone,
            _ if is_nested => Sharing::Nested,
            _ => Sharing::Faces,
        };
        let served = |(number, &map): (usize, &&'a PreparedMap)| Served {
            light: light(&map.view),
            map,
            inner: if sharing == Sharing::Nested && number > 0 {
                seen_from(&map.view, &maps[number - 1].view)
            } else {
                NOWHERE
            },
            beside: beside.get(number).copied(),
        };
        Maps {
            list: maps.iter().enumerate().map(served).collect(),
            unmapped: default_views(emitter).iter().map(light).collect(),
            sharing,
            refinements,
        }
    }

    /// Whether all maps see a point alike, having one eye and one direction.
    pub fn see_alike(&self) -> bool {
        let first = self.list.first();
        let alike = |served: &Served| first.is_some_and(|first| served.map.view.eye == first.map.view.eye);
        self.sharing != Sharing::Faces && self.list.iter().all(alike)
    }

    /// The maps that a point which chose `map` has to read.
    pub fn to_read(&self, map: usize) -> std::ops::Range<usize> {
        match self.sharing {
            Sharing::Nested => 0..self.list.len(),
            _ => map..map + 1,
        }
    }

    /// Of nested maps the smallest that holds the point; of faces the first that holds all texels that can hide
    /// the light; else the last that holds the point; else the last that the point can be seen in.
    pub fn choose(&self, see: impl Fn(&Light) -> Option<Seen>) -> Option<Chosen<'_>> {
        let (mut best, mut best_rank) = (None, 0);
        for (number, Served { light, map, .. }) in self.list.iter().enumerate() {
            let Some(seen) = see(light) else { continue };
            let [left, right, bottom, top] = map.view.window;
            let (x, y) = (seen.window_x, seen.window_y);
            let holds_point = left <= x && x <= right && bottom <= y && y <= top;
            let whole = match self.sharing {
                Sharing::Alone => true,
                Sharing::Nested => holds_point,
                Sharing::Faces => {
                    let search = Search::new(map, &seen, self.refinements);
                    holds_point && search.is_none_or(|search| search.is_inside())
                }
            };
            let rank = 1 + i32::from(holds_point) + i32::from(whole);
            if rank >= best_rank {
                best_rank = rank;
                best = Some(Chosen {
                    light,
                    seen,
                    map: Some(number),
                    whole: whole || self.sharing == Sharing::Nested,
                });
            }
            if whole {
                break;
            }
        }
        best.or_else(|| {
            // Of the six axes the one nearest to the point's direction: the largest depth.
            let seen = self
                .unmapped
                .iter()
                .filter_map(|light| Some((light, see(light)?)));
            let (light, seen) = seen.max_by(|a, b| a.1.base[2].total_cmp(&b.1.base[2]))?;
            let (map, whole) = (None, true);
            Some(Chosen {
                light,
                seen,
                map,
                whole,
            })
        })
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
