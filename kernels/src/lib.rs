//! CPU twins of Strata's effect steps, called from `addon/devices/cpu.py` and from nowhere else.
//!
//! Ranks from below: the files of this folder and `simd`; `geometry` and `emitter`; `raster` and `rays`; `effects`, a folder
//! each. No module uses one that uses it (tests/kernels/test_kernel_ranks.py).
//!
//! Every entry validates its arrays at the border, releases the GIL while it works, gives the same bits whatever the
//! number of threads, and polls a [`cancel::CancelFlag`] per tile.

mod cancel;
mod effects;
mod emitter;
mod geometry;
mod random;
mod raster;
mod rays;
mod simd;
mod surface;
mod vector;
mod view;

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
    geometry::register(module)?;
    emitter::register(module)?;
    raster::register(module)?;
    rays::register(module)?;
    effects::register(module)
}
