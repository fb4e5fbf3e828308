//! A light reduced to what shadows need. Twin of `addon/core/emitter.py`.

mod cone;
mod python;
mod sample;
mod shape;

pub use python::register;
pub use sample::{Samples, on_disk};
pub use shape::{Emitter, EmitterKind};
