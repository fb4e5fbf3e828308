//! Toon shading: light on a ramp, halftone dots, and outlines by inverted hulls.

mod dots;
mod edges;
mod facing;
mod halftone;
mod hull;
mod image;
mod outline;
mod ramp;
mod shade;

use pyo3::prelude::*;

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(facing::toon_facing, module)?)?;
    module.add_function(wrap_pyfunction!(shade::toon_shade, module)?)?;
    module.add_function(wrap_pyfunction!(halftone::toon_halftone, module)?)?;
    module.add_function(wrap_pyfunction!(hull::toon_hull, module)?)?;
    module.add_function(wrap_pyfunction!(edges::toon_edges, module)?)?;
    module.add_function(wrap_pyfunction!(outline::toon_outline, module)?)
}
