//! What is the work of one effect, a folder each as in `addon/effects`, and what effects share.

mod shared;
mod soft_shadow;
mod toon;
mod volumetric_light;

use pyo3::prelude::*;

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    shared::register(module)?;
    soft_shadow::register(module)?;
    toon::register(module)?;
    volumetric_light::register(module)
}
