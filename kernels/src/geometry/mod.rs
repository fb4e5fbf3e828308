//! Geometry as the kernels hold it: object-local float32 meshes and float64 instance matrices.
//!
//! Matrices are composed per eye in float64 and only then rounded, so that 1e7 m away is exact.

mod distance;
mod mesh;
mod python;
mod rows;
mod topology;
mod triangulate;

pub use mesh::{Data, Instance, Material, Mesh, Opacity, Sides};
pub use python::Geometry;
pub use topology::{Edge, Topology};

use pyo3::prelude::*;

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<python::SharedMesh>()?;
    module.add_class::<python::SharedOpacity>()?;
    module.add_class::<Geometry>()?;
    triangulate::register(module)?;
    rows::register(module)
}
