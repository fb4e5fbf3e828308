//! [`near`](super::integral::near) for sixteen stretches of rays at once, in single precision.
//!
//! Same formulas, same panels; the nodes in double precision are its oracle (tests/effects/volumetric_light/test_airlight.py).

mod batch;
mod functions;
mod gather;
mod integrate;
mod light;
mod nearby;
mod open;
mod setup;

pub use batch::Batch;
pub use open::OpenRow;
pub use setup::Setup;
