//! Geometry as Python fills it.

use super::distance::distance;
use super::mesh::{Data, Instance, Material, Mesh, Opacity, Sides};
use super::triangulate::{checked_corners, triangulate};
use crate::vector::{cross, dot, unit};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Arc, OnceLock};

/// Filled by `add_*`, then read by every kernel.
#[pyclass]
#[derive(Default)]
pub struct Geometry {
    data: Arc<Data>,
}

impl Geometry {
    pub fn data(&self) -> Arc<Data> {
        self.data.clone()
    }

    fn edit(&mut self) -> PyResult<&mut Data> {
        Arc::get_mut(&mut self.data)
            .ok_or_else(|| PyValueError::new_err("geometry cannot change while a kernel uses it"))
    }
}

fn rows<const N: usize>(array: &PyReadonlyArray2<'_, f32>, what: &str) -> PyResult<Vec<[f32; N]>> {
    if array.shape()[1] != N {
        return Err(PyValueError::new_err(format!(
            "{what} has {} columns, not {N}",
            array.shape()[1]
        )));
    }
    Ok(array.as_slice()?.as_chunks::<N>().0.to_vec())
}

/// A mesh for any number of geometries: a scene of which one object changes triangulates that one again.
#[pyclass(name = "Mesh", frozen)]
pub struct SharedMesh {
    mesh: Arc<Mesh>,
}

#[pymethods]
impl SharedMesh {
    /// Polygons. `positions` (V, 3) f32 in object space; `corner_vertices` (C,) i32; `face_starts` (F + 1,) i32;
    /// `corner_normals` (C, 3) f32 or None for a flat mesh; `corner_uvs` (C, 2) f32 or None; `face_slots` (F,)
    /// i32 or None; `corner_opacity` (C,) f32 and `corner_colours` (C, 3) f32, what opacities and colours that are by
    /// corner are multiplied by, or None.
    /// Raises ValueError on indices out of range; faces with a vertex that is not finite are dropped.
    #[new]
    #[pyo3(signature = (positions, corner_vertices, face_starts, corner_normals=None, corner_uvs=None, face_slots=None,
        corner_opacity=None, corner_colours=None))]
    pub fn new(
        positions: PyReadonlyArray2<'_, f32>,
        corner_vertices: PyReadonlyArray1<'_, i32>,
        face_starts: PyReadonlyArray1<'_, i32>,
        corner_normals: Option<PyReadonlyArray2<'_, f32>>,
        corner_uvs: Option<PyReadonlyArray2<'_, f32>>,
        face_slots: Option<PyReadonlyArray1<'_, i32>>,
        corner_opacity: Option<PyReadonlyArray1<'_, f32>>,
        corner_colours: Option<PyReadonlyArray2<'_, f32>>,
    ) -> PyResult<Self> {
        let positions: Vec<[f32; 3]> = rows(&positions, "positions")?;
        let corner_vertices = checked_corners(corner_vertices.as_slice()?, positions.len())?;
        let (triangles, faces) = triangulate(&positions, &corner_vertices, face_starts.as_slice()?)
            .map_err(PyValueError::new_err)?;
        let corner_normals = corner_normals.map_or(Ok(Vec::new()), |a| rows::<3>(&a, "corner_normals"))?;
        let corner_uvs = corner_uvs.map_or(Ok(Vec::new()), |a| rows::<2>(&a, "corner_uvs"))?;
        let corner_opacity = corner_opacity.map_or(Ok(Vec::new()), |a| a.as_slice().map(<[f32]>::to_vec))?;
        let corner_colours = corner_colours.map_or(Ok(Vec::new()), |a| rows::<3>(&a, "corner_colours"))?;
        for (what, length) in [
            ("corner_normals", corner_normals.len()),
            ("corner_uvs", corner_uvs.len()),
            ("corner_opacity", corner_opacity.len()),
            ("corner_colours", corner_colours.len()),
        ] {
            if length != 0 && length != corner_vertices.len() {
                return Err(PyValueError::new_err(format!("{what} needs one row a corner")));
            }
        }
        let triangle_slots = match face_slots {
            None => Vec::new(),
            Some(slots) => {
                let slots = slots.as_slice()?;
                if slots.len() + 1 != face_starts.len() {
                    return Err(PyValueError::new_err("face_slots needs one entry a face"));
                }
                faces
                    .iter()
                    .map(|&face| slots[face as usize].max(0) as u32)
                    .collect()
            }
        };
        let mesh = Arc::new(Mesh {
            positions,
            corner_vertices,
            triangles,
            corner_normals,
            corner_uvs,
            corner_opacity,
            corner_colours,
            triangle_slots,
            topology: OnceLock::new(),
        });
        Ok(SharedMesh { mesh })
    }

    /// Metres in the world from `point` (three numbers) to the triangles, placed by `matrix` (4, 4) f64 object to world;
    /// `most` where none is nearer. Raises ValueError if the matrix is not finite.
    pub fn distance(
        &self,
        py: Python<'_>,
        matrix: PyReadonlyArray2<'_, f64>,
        point: [f64; 3],
        most: f64,
    ) -> PyResult<f64> {
        let rows = finite_rows(&matrix)?;
        Ok(py.detach(|| distance(&self.mesh, &rows, point, most)))
    }
}

/// An opacity for any number of materials and geometries.
#[pyclass(name = "Opacity", frozen)]
pub struct SharedOpacity {
    opacity: Arc<Opacity>,
}

#[pymethods]
impl SharedOpacity {
    /// `value`, or `texels` (height, width) f32, row 0 at the bottom; times the mesh's `corner_opacity` if
    /// `by_corner`; with a `threshold` above 0 it is 1 where all that is at least the threshold, else 0.
    #[new]
    #[pyo3(signature = (value=1.0, texels=None, by_corner=false, threshold=0.0))]
    pub fn new(
        value: f32,
        texels: Option<PyReadonlyArray2<'_, f32>>,
        by_corner: bool,
        threshold: f32,
    ) -> PyResult<Self> {
        let (texels, height, width) = match texels {
            None => (Vec::new(), 0, 0),
            Some(t) => (t.as_slice()?.to_vec(), t.shape()[0], t.shape()[1]),
        };
        let opacity = Opacity {
            value,
            texels,
            width,
            height,
            by_corner,
            threshold,
        };
        Ok(SharedOpacity {
            opacity: Arc::new(opacity),
        })
    }
}

/// Whether a matrix turns triangles' winding round.
fn is_mirrored(rows: &[[f64; 4]; 3]) -> bool {
    let [a, b, c] = rows.map(|[x, y, z, _]| [x, y, z]);
    // Each axis by itself made to length 1: the determinant of a large or small matrix might overflow.
    let [a, b, c] = [a, b, c].map(|v| unit(v).unwrap_or([0.0; 3]));
    dot(cross(a, b), c) < 0.0
}

/// The first three rows of a matrix (4, 4).
fn finite_rows(matrix: &PyReadonlyArray2<'_, f64>) -> PyResult<[[f64; 4]; 3]> {
    let m = matrix.as_slice()?;
    if m.len() != 16 || m.iter().any(|x| !x.is_finite()) {
        return Err(PyValueError::new_err("an instance's matrix is 4 x 4 and finite"));
    }
    Ok([0, 4, 8].map(|i| [m[i], m[i + 1], m[i + 2], m[i + 3]]))
}

#[pymethods]
impl Geometry {
    #[new]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds polygons, as `Mesh` takes them, and returns the mesh's index.
    #[pyo3(signature = (positions, corner_vertices, face_starts, corner_normals=None, corner_uvs=None, face_slots=None,
        corner_opacity=None, corner_colours=None))]
    pub fn add_mesh(
        &mut self,
        positions: PyReadonlyArray2<'_, f32>,
        corner_vertices: PyReadonlyArray1<'_, i32>,
        face_starts: PyReadonlyArray1<'_, i32>,
        corner_normals: Option<PyReadonlyArray2<'_, f32>>,
        corner_uvs: Option<PyReadonlyArray2<'_, f32>>,
        face_slots: Option<PyReadonlyArray1<'_, i32>>,
        corner_opacity: Option<PyReadonlyArray1<'_, f32>>,
        corner_colours: Option<PyReadonlyArray2<'_, f32>>,
    ) -> PyResult<usize> {
        self.add_shared_mesh(&SharedMesh::new(
            positions,
            corner_vertices,
            face_starts,
            corner_normals,
            corner_uvs,
            face_slots,
            corner_opacity,
            corner_colours,
        )?)
    }

    /// Adds a mesh that other geometry may hold too, and returns its index.
    pub fn add_shared_mesh(&mut self, mesh: &SharedMesh) -> PyResult<usize> {
        let data = self.edit()?;
        data.meshes.push(mesh.mesh.clone());
        Ok(data.meshes.len() - 1)
    }

    /// Adds a material and returns its index: opacities of its front and its back, that cameras see and that
    /// cast shadows. None: whole.
    #[pyo3(signature = (seen=None, casts=None))]
    pub fn add_material(
        &mut self,
        seen: Option<[PyRef<'_, SharedOpacity>; 2]>,
        casts: Option<[PyRef<'_, SharedOpacity>; 2]>,
    ) -> PyResult<usize> {
        let data = self.edit()?;
        let sides = |given: Option<[PyRef<'_, SharedOpacity>; 2]>| -> Sides {
            given.map_or_else(
                || std::array::from_fn(|_| Arc::new(Opacity::WHOLE)),
                |sides| sides.map(|side| side.opacity.clone()),
            )
        };
        data.materials.push(Material {
            seen: sides(seen),
            casts: sides(casts),
        });
        Ok(data.materials.len() - 1)
    }

    /// Adds an instance and returns its index. `matrix` (4, 4) f64 object to world; `slot_materials` the
    /// materials of the slots, at least one. Raises ValueError if the matrix is not finite.
    pub fn add_instance(
        &mut self,
        mesh: usize,
        matrix: PyReadonlyArray2<'_, f64>,
        object_id: i32,
        slot_materials: Vec<u32>,
    ) -> PyResult<usize> {
        let matrix = finite_rows(&matrix)?;
        let data = self.edit()?;
        if mesh >= data.meshes.len() {
            return Err(PyValueError::new_err(format!("no mesh {mesh}")));
        }
        if slot_materials.is_empty() || slot_materials.iter().any(|&s| s as usize >= data.materials.len()) {
            return Err(PyValueError::new_err(
                "slot_materials names a material that was not added",
            ));
        }
        data.instances.push(Instance {
            mesh,
            matrix,
            is_mirrored: is_mirrored(&matrix),
            object_id,
            slot_materials,
        });
        Ok(data.instances.len() - 1)
    }

    /// Triangles over all instances.
    pub fn triangle_count(&self) -> usize {
        self.data
            .instances
            .iter()
            .map(|i| self.data.meshes[i.mesh].triangles.len())
            .sum()
    }

    pub fn instance_count(&self) -> usize {
        self.data.instances.len()
    }
}
