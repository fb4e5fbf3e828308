//! One light over many shading points: which map a point uses, what is decided early, what is uncertain.

use super::light::{Light, Seen};
use super::prepare::PreparedMap;
use super::region::Search;
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
}

/// Shading points as the surface step makes them.
#[derive(Clone, Copy)]
pub struct Points<'a> {
    pub position: &'a [[f32; 3]],
    pub geometric_normal: &'a [[f32; 3]],
    pub shading_normal: &'a [[f32; 3]],
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

/// A point in one view of the light, and what may hide the light there.
struct Chosen<'a> {
    light: &'a Light,
    seen: Seen,
    search: Option<(&'a PreparedMap, Search<'a>)>,
}

/// Points a thread takes at a time.
const TILE: usize = 1024;

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
    let mut visibility = vec![1.0f32; points.position.len()];
    let mut uncertain = vec![0u8; points.position.len()];
    let tiles = visibility
        .par_chunks_mut(TILE)
        .zip(uncertain.par_chunks_mut(TILE));
    tiles.enumerate().for_each(|(tile, (visibility, uncertain))| {
        if cancel.is_set() {
            return;
        }
        for (i, (share, doubt)) in visibility.iter_mut().zip(uncertain).enumerate() {
            let result = scene.visibility(&points, tile * TILE + i);
            (*share, *doubt) = (result.0, u8::from(result.1));
        }
    });
    cancel.check()?;
    Ok((visibility, uncertain))
}

impl Scene<'_> {
    fn visibility(&self, points: &Points<'_>, i: usize) -> (f32, bool) {
        let Some(Chosen { light, seen, search }) = self.choose(points, i) else {
            return (1.0, false);
        };
        if self.settings.method == Method::Area {
            let share = search.and_then(|(map, search)| {
                let (region, _) = search.whole(self.settings.max_samples)?;
                Some(area::visibility(map, &seen, &region))
            });
            return (share.unwrap_or(1.0), false);
        }
        // Written so that a NaN in a normal reads as no light.
        let receives_light = seen.height_range(seen.shading_normal).1 > 0.0;
        if !receives_light {
            return (1.0, false);
        }
        let (lowest, highest) = seen.height_range(seen.geometric_normal);
        let at_horizon = lowest <= 0.0;
        if !at_horizon && search.is_none() {
            return (1.0, seen.too_close);
        }
        let mut hidden = plain::Bits::default();
        if at_horizon {
            hidden = plain::horizon(&seen);
        }
        let mut uncertain = seen.too_close;
        if highest > 0.0
            && let Some((map, search)) = &search
        {
            let regions = search.bands(self.settings.max_samples);
            uncertain |= at_horizon || (self.in_faces && regions.clipped);
            for region in regions.as_slice() {
                match self.settings.method {
                    Method::PlainBitmask => plain::backproject(map, &seen, region, &mut hidden),
                    _ => fast::backproject(map, &seen, region, &mut hidden),
                }
            }
        }
        if hidden == plain::Bits::default() {
            return (1.0, uncertain);
        }
        (plain::resolve(light, &seen, &hidden), uncertain)
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
        let (mut best, mut best_rank) = (None, 0);
        for (light, map) in &self.maps {
            let Some(seen) = see(light) else { continue };
            let [left, right, bottom, top] = map.view.window;
            let (x, y) = (seen.window_x, seen.window_y);
            let holds_point = left <= x && x <= right && bottom <= y && y <= top;
            let search = Search::new(map, &seen, self.settings.refinements);
            let whole = holds_point && search.as_ref().is_none_or(|search| search.is_inside());
            let rank = 1 + i32::from(holds_point) + i32::from(whole);
            if rank >= best_rank {
                best_rank = rank;
                let search = search.map(|search| (*map, search));
                best = Some(Chosen { light, seen, search });
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
            Some(Chosen {
                light,
                seen,
                search: None,
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
