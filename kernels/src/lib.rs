//! CPU twins of Strata's effect steps, called from `addon/devices/cpu.py` and from nowhere else.
//!
//! One module an effect step. Every entry validates its arrays at the border, releases the GIL while it
//! works, gives the same bits whatever the number of threads, and polls a [`cancel::CancelFlag`] per tile.

pub mod cancel;
pub mod composite;
mod distance;
pub mod emitter;
pub mod geometry;
pub mod irradiance;
pub mod raster;
pub mod rays;
pub mod rows;
mod simd;
pub mod soft_shadow;
pub mod toon;
mod topology;
pub mod triangulate;
pub mod vector;
pub mod view;
pub mod volumetric_light;

use pyo3::prelude::*;

/// A panic reaches Python as an exception and is told there in one line (`addon/core/errors.py`); Rust prints
/// its own account only where tracebacks are asked for.
fn quieten_panics() {
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if std::env::var_os("STRATA_TRACEBACK").is_some_and(|path| !path.is_empty()) {
            print(panic);
        }
    }));
}

#[pymodule]
fn strata_kernels(module: &Bound<'_, PyModule>) -> PyResult<()> {
    quieten_panics();
    cancel::register(module)?;
    composite::register(module)?;
    geometry::register(module)?;
    irradiance::register(module)?;
    raster::register(module)?;
    emitter::register(module)?;
    rays::register(module)?;
    triangulate::register(module)?;
    rows::register(module)?;
    soft_shadow::register(module)?;
    volumetric_light::register(module)?;
    toon::register(module)?;
    Ok(())
}
