//! The bitmask method, as fast as the processor allows; so far the plain one.

pub use super::plain::backproject;
