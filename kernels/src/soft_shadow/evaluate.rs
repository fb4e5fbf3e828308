//! One light over many shading points: which map a point uses, what is decided early, what is uncertain.

use super::doubt::near_contact;
use super::light::{Light, Seen};
use super::plain::Bits;
use super::prepare::PreparedMap;
use super::region::{Search, unit};
use super::simd::{Vector, Work, run_widest};
use super::tile::{self, Candidates, Open};
use super::{area, fast, plain};
use crate::cancel::CancelFlag;
use crate::emitter::{Emitter, EmitterKind};
use crate::view::View;
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
    pub refinements: usize,
    /// Uncertain points are not evaluated: rays will be.
    pub leave_uncertain: bool,
}

/// Shading points as the surface step makes them, row by row.
#[derive(Clone, Copy)]
pub struct Points<'a> {
    pub position: &'a [[f32; 3]],
    pub geometric_normal: &'a [[f32; 3]],
    pub shading_normal: &'a [[f32; 3]],
    /// Points in a row; all of them if they are no image.
    pub width: usize,
}

struct Scene<'a> {
    /// Smallest window first.
    maps: Vec<(Light, &'a PreparedMap)>,
    /// For points that no map serves.
    unmapped: Vec<Light>,
    /// The maps are cube faces, so that beyond a map's border there may be more.
    in_faces: bool,
    settings: Settings,
}

/// A point in one view of the light.
struct Chosen<'a> {
    light: &'a Light,
    seen: Seen,
    map: Option<usize>,
    /// The map holds all that can hide the light.
    whole: bool,
}

/// Rows of an image that a thread takes at a time, and columns and rows that share their candidates.
const TILE: usize = 8;

/// Points that a thread takes at a time if they are no image.
const CHUNK: usize = 512;

/// Visibility and uncertainty of every point.
pub fn evaluate(
    emitter: &Emitter,
    maps: &[&PreparedMap],
    eye: [f64; 3],
    points: Points<'_>,
    settings: Settings,
    cancel: &CancelFlag,
) -> PyResult<(Vec<f32>, Vec<u8>)> {
    let light = |view: &View| Light::new(emitter, view, eye);
    let scene = Scene {
        maps: maps.iter().map(|&map| (light(&map.view), map)).collect(),
        unmapped: default_views(emitter).iter().map(light).collect(),
        in_faces: maps.len() > 1 && matches!(emitter.kind, EmitterKind::Sphere | EmitterKind::FacingDisk),
        settings,
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
            run_widest(Chunk {
                scene: &scene,
                points: &points,
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
    points: &'a Points<'a>,
    start: usize,
    width: usize,
    visibility: &'a mut [f32],
    uncertain: &'a mut [u8],
}

impl Work for Chunk<'_> {
    #[inline(always)]
    fn run<V: Vector>(self, vector: V) {
        if self.scene.settings.method != Method::Bitmask {
            for (i, (share, doubt)) in self.visibility.iter_mut().zip(self.uncertain).enumerate() {
                (*share, *doubt) = self.scene.plainly(self.points, self.start + i);
            }
            return;
        }
        let rows = self.visibility.len().div_ceil(self.width);
        // As many points where there is but one row.
        let columns = TILE * TILE / rows.clamp(1, TILE);
        let mut candidates = Candidates::default();
        // One list for each map, and one for points that no map serves.
        let mut open: Vec<Vec<Open>> = (0..=self.scene.maps.len()).map(|_| Vec::new()).collect();
        for left in (0..self.width).step_by(columns) {
            let right = (left + columns).min(self.width);
            for row in 0..rows {
                for place in row * self.width + left..(row * self.width + right).min(self.visibility.len()) {
                    match self.scene.start(vector, self.points, self.start + place) {
                        Start::Done(share, doubt) => {
                            (self.visibility[place], self.uncertain[place]) = (share, u8::from(doubt));
                        }
                        Start::Open(chosen, hidden, doubt) => {
                            self.uncertain[place] = u8::from(doubt);
                            let list = chosen.map.unwrap_or(self.scene.maps.len());
                            open[list].push(Open {
                                unit: unit(
                                    &chosen.seen,
                                    self.scene.settings.max_samples,
                                    list_map(self.scene, list),
                                ),
                                seen: chosen.seen,
                                hidden,
                                place,
                            });
                        }
                    }
                }
            }
            for (list, points) in open.iter_mut().enumerate() {
                if let Some((light, map)) = self.scene.maps.get(list) {
                    tile::hide(
                        vector,
                        map,
                        self.scene.settings.refinements,
                        points,
                        &mut candidates,
                    );
                    for point in points.iter() {
                        self.visibility[point.place] = tile::resolve(vector, light, point);
                    }
                }
                points.clear();
            }
        }
    }
}

fn list_map<'a>(scene: &Scene<'a>, list: usize) -> Option<&'a PreparedMap> {
    scene.maps.get(list).map(|(_, map)| *map)
}

/// What is known of a point before its map is read.
enum Start<'a> {
    Done(f32, bool),
    Open(Chosen<'a>, Bits, bool),
}

impl Scene<'_> {
    #[inline(always)]
    fn start<V: Vector>(&self, vector: V, points: &Points<'_>, i: usize) -> Start<'_> {
        let Some(chosen) = self.choose(points, i) else {
            return Start::Done(1.0, false);
        };
        let seen = &chosen.seen;
        // Written so that a NaN in a normal reads as no light.
        let receives_light = seen.height_range(seen.shading_normal).1 > 0.0;
        if !receives_light {
            return Start::Done(1.0, false);
        }
        let (lowest, highest) = seen.height_range(seen.geometric_normal);
        let mut hidden = Bits::default();
        if lowest <= 0.0 {
            hidden = fast::horizon(vector, seen);
        }
        let readable = chosen.map.is_some() && highest > 0.0;
        let doubt = self.doubts(&chosen, lowest, highest);
        if doubt && self.settings.leave_uncertain {
            Start::Done(1.0, true)
        } else if readable {
            Start::Open(chosen, hidden, doubt)
        } else if lowest <= 0.0 {
            Start::Done(fast::resolve(vector, chosen.light, seen, &hidden), doubt)
        } else {
            Start::Done(1.0, doubt)
        }
    }

    /// Whether rays know better than the map. `lowest` and `highest`: the light's samples above the geometric
    /// horizon.
    fn doubts(&self, chosen: &Chosen<'_>, lowest: f32, highest: f32) -> bool {
        let Some(map) = chosen.map else {
            return chosen.seen.too_close;
        };
        let cut_off = self.in_faces && !chosen.whole;
        let readable = highest > 0.0;
        let unsure = lowest <= 0.0 || cut_off || near_contact(self.maps[map].1, &chosen.seen);
        chosen.seen.too_close || readable && unsure
    }

    /// A point by the plain twin of the bitmask or by the sum of areas.
    fn plainly(&self, points: &Points<'_>, i: usize) -> (f32, u8) {
        let Settings {
            method,
            max_samples,
            refinements,
            ..
        } = self.settings;
        let Some(chosen) = self.choose(points, i) else {
            return (1.0, 0);
        };
        let seen = &chosen.seen;
        let map = chosen.map.map(|map| self.maps[map].1);
        let search = map.and_then(|map| Some((map, Search::new(map, seen, refinements)?)));
        if method == Method::Area {
            let share = search
                .and_then(|(map, search)| Some(area::visibility(map, seen, &search.whole(max_samples)?)));
            return (share.unwrap_or(1.0), 0);
        }
        let receives_light = seen.height_range(seen.shading_normal).1 > 0.0;
        if !receives_light {
            return (1.0, 0);
        }
        let (lowest, highest) = seen.height_range(seen.geometric_normal);
        let mut hidden = if lowest <= 0.0 {
            plain::horizon(seen)
        } else {
            Bits::default()
        };
        let doubt = self.doubts(&chosen, lowest, highest);
        if doubt && self.settings.leave_uncertain {
            return (1.0, 1);
        }
        if highest > 0.0
            && let Some((map, search)) = &search
        {
            for region in search.bands(max_samples).as_slice() {
                plain::backproject(map, seen, region, &mut hidden);
            }
        }
        (plain::resolve(chosen.light, seen, &hidden), u8::from(doubt))
    }

    /// The first map that holds all texels that can hide the light; else the last that holds the point; else
    /// the last that the point can be seen in.
    fn choose(&self, points: &Points<'_>, i: usize) -> Option<Chosen<'_>> {
        let see = |light: &Light| {
            light.see(
                points.position[i],
                points.geometric_normal[i],
                points.shading_normal[i],
            )
        };
        if let [(light, _)] = &self.maps[..]
            && let Some(seen) = see(light)
        {
            let (map, whole) = (Some(0), true);
            return Some(Chosen {
                light,
                seen,
                map,
                whole,
            });
        }
        let (mut best, mut best_rank) = (None, 0);
        for (number, (light, map)) in self.maps.iter().enumerate() {
            let Some(seen) = see(light) else { continue };
            let [left, right, bottom, top] = map.view.window;
            let (x, y) = (seen.window_x, seen.window_y);
            let holds_point = left <= x && x <= right && bottom <= y && y <= top;
            let search = Search::new(map, &seen, self.settings.refinements);
            let whole = holds_point && search.is_none_or(|search| search.is_inside());
            let rank = 1 + i32::from(holds_point) + i32::from(whole);
            if rank >= best_rank {
                best_rank = rank;
                let map = Some(number);
                best = Some(Chosen {
                    light,
                    seen,
                    map,
                    whole,
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
