//! What view rays and the texels of a chart see, in double precision. It shares no interpolation with the rasteriser,
//! which it checks: weights of corners are worked out here (Möller and Trumbore).

use super::accel::{Accel, Rays};
use super::arguments::{CHUNK, Flag, bytes, in_parallel, three, triples};
use super::bvh::Met;
use super::lift;
use super::packet::Packet;
use crate::geometry::{Data, Geometry, Instance, Mesh};
use crate::simd::{LANES, dispatch};
use crate::surface::{Images, Row};
use crate::vector::{Vec3, add, cross, dot, length, scale, sub};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

/// A triangle of an instance, world axes.
struct Facet<'a> {
    indices: [usize; 2],
    instance: &'a Instance,
    mesh: &'a Mesh,
    linear: [Vec3; 3],
    /// The corners, relative to an origin.
    points: [Vec3; 3],
    /// Unit normal by the winding; 0 where the triangle has no area.
    winding: Vec3,
}

impl<'a> Facet<'a> {
    fn new(data: &'a Data, origin: Vec3, index: usize, triangle: usize) -> Self {
        let instance = &data.instances[index];
        let mesh = data.meshes[instance.mesh].as_ref();
        let [a, b, c] = instance.matrix;
        let linear = [[a[0], a[1], a[2]], [b[0], b[1], b[2]], [c[0], c[1], c[2]]];
        let offset = sub([a[3], b[3], c[3]], origin);
        let [first, second, third] = doubled(mesh.triangle_positions(triangle));
        let place = |point| add(applied(&linear, point), offset);
        let points = [place(first), place(second), place(third)];
        let winding = unit(cross(sub(points[1], points[0]), sub(points[2], points[0])));
        Facet {
            indices: [index, triangle],
            instance,
            mesh,
            linear,
            points,
            winding,
        }
    }

    /// Weights of the corners where a ray meets the plane.
    fn weights_along(&self, origin: Vec3, direction: Vec3) -> Vec3 {
        let [a, b, c] = self.points;
        let (first, second) = (sub(b, a), sub(c, a));
        let across = cross(direction, second);
        let inverse = 1.0 / dot(first, across);
        let start = sub(origin, a);
        inside(
            dot(start, across) * inverse,
            dot(direction, cross(start, first)) * inverse,
        )
    }

    /// Weights of the corners at a place of the UV map.
    fn weights_at(&self, place: [f64; 2]) -> Vec3 {
        let [a, b, c] = self.of_corners(&self.mesh.corner_uvs);
        let from_first = |[x, y]: [f64; 2]| [x - a[0], y - a[1]];
        let (first, second, place) = (from_first(b), from_first(c), from_first(place));
        let area = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
        let whole = area(first, second);
        inside(area(place, second) / whole, area(first, place) / whole)
    }

    fn of_corners<const N: usize>(&self, values: &[[f32; N]]) -> [[f64; N]; 3] {
        let [a, b, c] = self.mesh.triangles[self.indices[1]];
        doubled([values[a as usize], values[b as usize], values[c as usize]])
    }

    /// Writes what is at these weights, with normals turned by `turn`, 1 or -1; depths are along `forward`, 0 if None.
    fn fill(&self, row: &mut Row, at: usize, weights: Vec3, turn: f64, forward: Option<Vec3>) {
        let [index, triangle] = self.indices;
        let ids = [
            (&mut row.instance, index as i32),
            (&mut row.triangle, triangle as i32),
            (&mut row.object_id, self.instance.object_id),
        ];
        for (ids, id) in ids {
            if let Some(ids) = ids {
                ids[at] = id;
            }
        }
        if let Some(materials) = &mut row.material {
            materials[at] = self.instance.material(self.mesh.slot(triangle)) as i32;
        }
        let position = mix(self.points, weights);
        if let Some(positions) = &mut row.position {
            positions[at] = rounded(position);
        }
        if let Some(depths) = &mut row.depth {
            depths[at] = forward.map_or(0.0, |forward| dot(position, forward)) as f32;
        }
        if let Some(normals) = &mut row.geometric_normal {
            normals[at] = rounded(scale(self.winding, turn));
        }
        if let Some(normals) = &mut row.shading_normal {
            let mut normal = self.winding;
            if !self.mesh.corner_normals.is_empty() {
                let local = mix(self.of_corners(&self.mesh.corner_normals), weights);
                // Rows of cofactors: what a linear map does to normals, and so to the winding.
                let [x, y, z] = self.linear;
                normal = unit(applied(&[cross(y, z), cross(z, x), cross(x, y)], local));
            }
            normals[at] = rounded(scale(normal, turn));
        }
        if let Some(lifts) = &mut row.terminator_lift
            && !self.mesh.corner_normals.is_empty()
        {
            let normals = self.of_corners(&self.mesh.corner_normals);
            let normal = applied(&self.linear, mix(normals, weights));
            let is_outside = dot(normal, scale(self.winding, turn)) > 0.0;
            let corners = doubled(self.mesh.triangle_positions(triangle));
            let side = if is_outside { 1.0 } else { -1.0 };
            let height = lift::height(corners, normals, weights, side);
            lifts[at] = rounded(scale(normal, height));
        }
        if let Some(uvs) = &mut row.uv
            && !self.mesh.corner_uvs.is_empty()
        {
            uvs[at] = rounded(mix(self.of_corners(&self.mesh.corner_uvs), weights));
        }
        if let Some(colours) = &mut row.corner_colour {
            colours[at] = if self.mesh.corner_colours.is_empty() {
                [1.0; 3]
            } else {
                rounded(mix(self.of_corners(&self.mesh.corner_colours), weights))
            };
        }
    }
}

/// Weights of three corners from those of the second and the third, kept inside: hits are found in single precision,
/// and the triangle of a texel to 1/256 of it.
fn inside(u: f64, v: f64) -> Vec3 {
    let kept = |w: f64| if w.is_finite() { w.max(0.0) } else { 0.0 };
    let (w, u, v) = (kept(1.0 - u - v), kept(u), kept(v));
    let sum = w + u + v;
    if sum == 0.0 {
        return [1.0 / 3.0; 3];
    }
    [w / sum, u / sum, v / sum]
}

// Loops, since arrays' own `map` is not inlined here and takes most of the time.

#[inline(always)]
fn mix<const N: usize>(corners: [[f64; N]; 3], weights: Vec3) -> [f64; N] {
    let mut result = [0.0; N];
    for k in 0..N {
        result[k] = weights[0] * corners[0][k] + weights[1] * corners[1][k] + weights[2] * corners[2][k];
    }
    result
}

#[inline(always)]
fn doubled<const N: usize>(corners: [[f32; N]; 3]) -> [[f64; N]; 3] {
    let mut result = [[0.0; N]; 3];
    for corner in 0..3 {
        for k in 0..N {
            result[corner][k] = corners[corner][k].into();
        }
    }
    result
}

#[inline(always)]
fn rounded<const N: usize>(vector: [f64; N]) -> [f32; N] {
    let mut result = [0.0; N];
    for k in 0..N {
        result[k] = vector[k] as f32;
    }
    result
}

#[inline(always)]
fn applied(rows: &[Vec3; 3], vector: Vec3) -> Vec3 {
    [dot(rows[0], vector), dot(rows[1], vector), dot(rows[2], vector)]
}

#[inline(always)]
fn unit([x, y, z]: Vec3) -> Vec3 {
    let length = length([x, y, z]).max(1e-300);
    [x / length, y / length, z / length]
}

/// The surfaces that rays see first: a dict of the `attributes` asked for, as `raster_surface` has them, (N,) or
/// (N, channels). Normals face against the ray; positions are relative to the eye that `accel` is relative to.
///
/// `visible` (instances,) u8 or None; `origins` (N, 3) f64 relative to that eye and `directions` (N, 3) f64; `between`,
/// the first and the last parameter along a direction that are looked at; depths are metres along `forward`.
/// Hits are found in float32, as `Accel.nearest` does. `draws` (N, 4) u32, seed, sample, column and row, decides as the
/// rasteriser does for that sample of that pixel which of what is partly opaque is there; None: by chance. Raises ValueError on bad input, Cancelled when `cancel` is set.
#[pyfunction]
#[pyo3(signature = (accel, visible, origins, directions, between, forward, attributes, draws=None,
    cancel=None))]
pub fn rays_surface<'py>(
    py: Python<'py>,
    accel: PyRef<'py, Accel>,
    visible: Option<PyReadonlyArray1<'py, u8>>,
    origins: PyReadonlyArray2<'py, f64>,
    directions: PyReadonlyArray2<'py, f64>,
    between: (f64, f64),
    forward: [f64; 3],
    attributes: Vec<String>,
    draws: Option<PyReadonlyArray2<'py, u32>>,
    cancel: Flag<'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let scene = accel.scene.as_ref();
    let casters = bytes(&visible, scene.data.instances.len())?;
    let count = origins.shape()[0];
    let origins = triples(&origins, count, "origins")?;
    let directions = triples(&directions, count, "directions")?;
    if draws.as_ref().is_some_and(|draws| draws.shape() != [count, 4]) {
        return Err(PyValueError::new_err("draws is (N, 4)"));
    }
    let draws = match &draws {
        Some(draws) => Some(draws.as_slice()?.as_chunks::<4>().0),
        None => None,
    };
    let mut images = Images::wanted(&attributes, count)?;
    let room = vec![(between.1 - between.0) as f32; CHUNK];
    let cancel = cancel.map(|c| c.clone());
    py.detach(|| {
        let parts = images.parts(count, CHUNK).into_par_iter();
        in_parallel(parts, &cancel, |chunk, mut row| {
            let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(count);
            let draws = draws.map(|draws| &draws[range.clone()]);
            let (origins, directions) = (&origins[range.clone()], &directions[range]);
            let start = |(&o, &d): (&Vec3, &Vec3)| rounded(add(o, scale(d, between.0)));
            let starts: Vec<[f32; 3]> = origins.iter().zip(directions).map(start).collect();
            let towards: Vec<[f32; 3]> = directions.iter().map(|&d| rounded(d)).collect();
            let done = &mut |first: usize, _: &Packet, met: &Met| {
                for ray in first..(first + LANES).min(starts.len()) {
                    let (instance, triangle) = (met.instance[ray - first], met.triangle[ray - first]);
                    if instance == u32::MAX {
                        row.clear(ray..ray + 1);
                        continue;
                    }
                    let facet = Facet::new(&scene.data, scene.origin, instance as usize, triangle as usize);
                    let weights = facet.weights_along(origins[ray], directions[ray]);
                    let is_behind = dot(facet.winding, directions[ray]) > 0.0;
                    let turn = if is_behind { -1.0 } else { 1.0 };
                    facet.fill(&mut row, ray, weights, turn, Some(forward));
                }
            };
            dispatch(Rays::<true> {
                scene,
                casters,
                origins: &starts,
                directions: &towards,
                t_max: &room[..starts.len()],
                draws,
                done,
            });
        })
    })?;
    images.into_dict(py, &[count])
}

/// The surfaces at places of UV maps: a dict of the `attributes` asked for, (N,) or (N, channels). Positions are
/// relative to `origin` (3,) f64, normals face as the mesh does, depth is 0.
///
/// `instance` and `triangle` (N,) i32, of instances whose mesh has UVs, -1 where nothing is; `places` (N, 2) f64.
/// Raises ValueError on bad input, Cancelled when `cancel` is set.
#[pyfunction]
#[pyo3(signature = (geometry, instance, triangle, places, origin, attributes, cancel=None))]
pub fn chart_surface<'py>(
    py: Python<'py>,
    geometry: PyRef<'py, Geometry>,
    instance: PyReadonlyArray1<'py, i32>,
    triangle: PyReadonlyArray1<'py, i32>,
    places: PyReadonlyArray2<'py, f64>,
    origin: PyReadonlyArray1<'py, f64>,
    attributes: Vec<String>,
    cancel: Flag<'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let data = geometry.data();
    let (instance, triangle) = (instance.as_slice()?, triangle.as_slice()?);
    let count = instance.len();
    if triangle.len() != count || places.shape() != [count, 2] {
        return Err(PyValueError::new_err(
            "an instance has a triangle and a place (2,)",
        ));
    }
    let is_on_chart = |(&instance, &triangle): (&i32, &i32)| {
        instance < 0
            || data.instances.get(instance as usize).is_some_and(|instance| {
                let mesh = &data.meshes[instance.mesh];
                !mesh.corner_uvs.is_empty() && (triangle as usize) < mesh.triangles.len()
            })
    };
    if !instance.iter().zip(triangle).all(is_on_chart) {
        return Err(PyValueError::new_err(
            "instance and triangle name one that is not there",
        ));
    }
    let places = places.as_slice()?.as_chunks::<2>().0;
    let origin = three(&origin, "origin")?;
    let mut images = Images::wanted(&attributes, count)?;
    let cancel = cancel.map(|c| c.clone());
    py.detach(|| {
        let parts = images.parts(count, CHUNK).into_par_iter();
        in_parallel(parts, &cancel, |chunk, mut row| {
            let first = chunk * CHUNK;
            for point in first..(first + CHUNK).min(count) {
                let at = point - first;
                if instance[point] < 0 {
                    row.clear(at..at + 1);
                    continue;
                }
                let facet = Facet::new(&data, origin, instance[point] as usize, triangle[point] as usize);
                facet.fill(&mut row, at, facet.weights_at(places[point]), 1.0, None);
            }
        })
    })?;
    images.into_dict(py, &[count])
}
