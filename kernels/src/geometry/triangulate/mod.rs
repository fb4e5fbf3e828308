//! Polygons to triangles, as Blender splits them.

mod ears;

use ears::Ears;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use std::ops::Range;

/// Corners of each triangle, and each triangle's polygon.
pub type Triangles = (Vec<[u32; 3]>, Vec<u32>);

/// Polygons split by one task.
const CHUNK: usize = 16384;

/// The polygons of a mesh.
struct Polygons<'a> {
    positions: &'a [[f32; 3]],
    corner_vertices: &'a [u32],
    face_starts: &'a [i32],
    all_finite: bool,
}

impl Polygons<'_> {
    fn corners(&self, face: usize) -> Range<usize> {
        self.face_starts[face] as usize..self.face_starts[face + 1] as usize
    }

    fn position(&self, corner: usize) -> [f32; 3] {
        self.positions[self.corner_vertices[corner] as usize]
    }

    /// Triangles that a polygon becomes: none where it is no polygon or has a vertex that is not finite.
    fn triangle_count(&self, face: usize) -> usize {
        let corners = self.corners(face);
        let finite = |corner| self.position(corner).iter().all(|x| x.is_finite());
        if self.all_finite || corners.clone().all(finite) {
            corners.len().saturating_sub(2)
        } else {
            0
        }
    }

    /// Writes a polygon's triangles; there are as many as [`Self::triangle_count`] says.
    fn split(&self, face: usize, ears: &mut Ears, triangles: &mut [[u32; 3]]) {
        let range = self.corners(face);
        let first = range.start as u32;
        match triangles {
            [] => {}
            [only] => *only = [first, first + 1, first + 2],
            [one, other] => {
                if is_flipped([0, 1, 2, 3].map(|i| self.position(range.start + i))) {
                    *one = [first, first + 1, first + 3];
                    *other = [first + 1, first + 2, first + 3];
                } else {
                    *one = [first, first + 1, first + 2];
                    *other = [first, first + 2, first + 3];
                }
            }
            many => {
                ears.clip(range.map(|corner| self.position(corner)), many);
                many.iter_mut().flatten().for_each(|corner| *corner += first);
            }
        }
    }
}

/// Whether a quad's corners 1 and 3 lie on the same side of the diagonal 0-2, so that splitting along it
/// would fold the quad over: Blender then takes the other diagonal. In single precision, as there.
fn is_flipped([a, b, c, d]: [[f32; 3]; 4]) -> bool {
    let sub = |p: [f32; 3], q: [f32; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let cross = |p: [f32; 3], q: [f32; 3]| {
        [
            p[1] * q[2] - p[2] * q[1],
            p[2] * q[0] - p[0] * q[2],
            p[0] * q[1] - p[1] * q[0],
        ]
    };
    let diagonal = sub(c, a);
    let (one, other) = (cross(sub(b, a), diagonal), cross(sub(d, a), diagonal));
    one[0] * other[0] + one[1] * other[1] + one[2] * other[2] > 0.0
}

/// Splits polygons into triangles: quads as Blender does, larger ones by clipping ears in the plane of
/// their Newell normal. A polygon of n corners becomes n - 2 triangles, some without area where the
/// polygon is degenerate; one with a vertex that is not finite becomes none.
pub fn triangulate(
    positions: &[[f32; 3]],
    corner_vertices: &[u32],
    face_starts: &[i32],
) -> Result<Triangles, &'static str> {
    let (Some(&first), Some(&last)) = (face_starts.first(), face_starts.last()) else {
        return Err("face_starts needs an entry a face and one more");
    };
    let ascending = face_starts.par_windows(2).all(|pair| pair[0] <= pair[1]);
    if first < 0 || last as usize > corner_vertices.len() || !ascending {
        return Err("face_starts points outside corner_vertices");
    }
    let polygons = Polygons {
        positions,
        corner_vertices,
        face_starts,
        all_finite: positions.par_iter().all(|p| p.iter().all(|x| x.is_finite())),
    };
    let face_count = face_starts.len() - 1;
    let chunks: Vec<Range<usize>> = (0..face_count)
        .step_by(CHUNK)
        .map(|start| start..face_count.min(start + CHUNK))
        .collect();
    let counts: Vec<usize> = chunks
        .par_iter()
        .map(|faces| faces.clone().map(|face| polygons.triangle_count(face)).sum())
        .collect();
    let total = counts.iter().sum();
    let (mut triangles, mut faces) = (vec![[0; 3]; total], vec![0; total]);
    let (mut triangles_left, mut faces_left) = (&mut triangles[..], &mut faces[..]);
    let mut parts = Vec::with_capacity(chunks.len());
    for (range, &count) in chunks.into_iter().zip(&counts) {
        parts.push((
            range,
            triangles_left.split_off_mut(..count).unwrap_or_default(),
            faces_left.split_off_mut(..count).unwrap_or_default(),
        ));
    }
    parts.into_par_iter().for_each(|(range, triangles, faces)| {
        let (mut ears, mut done) = (Ears::default(), 0);
        for face in range {
            let end = done + polygons.triangle_count(face);
            polygons.split(face, &mut ears, &mut triangles[done..end]);
            faces[done..end].fill(face as u32);
            done = end;
        }
    });
    Ok((triangles, faces))
}

/// Vertices of the corners, checked.
pub fn checked_corners(corners: &[i32], vertex_count: usize) -> PyResult<Vec<u32>> {
    if corners.par_iter().any(|&v| v < 0 || v as usize >= vertex_count) {
        return Err(PyValueError::new_err("corner_vertices points outside positions"));
    }
    Ok(corners.iter().map(|&v| v as u32).collect())
}

type TriangleArrays<'py> = (Bound<'py, PyArray2<i32>>, Bound<'py, PyArray1<i32>>);

/// Splits a mesh's polygons as `Geometry.add_mesh` does: `positions` (V, 3) f32, `corner_vertices` (C,) i32,
/// `face_starts` (F + 1,) i32. Returns the corners of each triangle (T, 3) i32 and its polygon (T,) i32, in the
/// polygons' order. Polygons with a vertex that is not finite are dropped. Raises ValueError on indices out of range.
#[pyfunction]
#[pyo3(name = "triangulate")]
fn triangulate_arrays<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'py, f32>,
    corner_vertices: PyReadonlyArray1<'py, i32>,
    face_starts: PyReadonlyArray1<'py, i32>,
) -> PyResult<TriangleArrays<'py>> {
    if positions.shape()[1] != 3 {
        return Err(PyValueError::new_err("positions has not 3 columns"));
    }
    let positions = positions.as_slice()?.as_chunks::<3>().0;
    let (corners, starts) = (corner_vertices.as_slice()?, face_starts.as_slice()?);
    let (triangles, faces) = py.detach(|| {
        let corners = checked_corners(corners, positions.len())?;
        triangulate(positions, &corners, starts).map_err(PyValueError::new_err)
    })?;
    let count = faces.len();
    // Indices came in as i32, so they are not negative here either.
    let triangles: Vec<i32> = triangles
        .into_flattened()
        .into_iter()
        .map(u32::cast_signed)
        .collect();
    let faces: Vec<i32> = faces.into_iter().map(u32::cast_signed).collect();
    Ok((
        PyArray1::from_vec(py, triangles).reshape([count, 3])?,
        PyArray1::from_vec(py, faces),
    ))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(triangulate_arrays, module)?)
}
