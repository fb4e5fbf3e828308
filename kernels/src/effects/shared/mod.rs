//! Steps of no one effect.

mod composite;
mod irradiance;
mod material;

use pyo3::prelude::*;

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    composite::register(module)?;
    irradiance::register(module)?;
    material::register(module)
}
