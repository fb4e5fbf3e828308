//! Parts of the plane that a view looks through.

/// Left, right, bottom, top of a window; empty where left is not below right.
pub type Window<T> = [T; 4];

/// Holds nothing.
pub const NOWHERE: Window<f64> = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];

/// A window relative to a place in it.
pub fn from_point(window: &Window<f64>, [x, y]: [f64; 2]) -> Window<f32> {
    let [left, right, bottom, top] = *window;
    [left - x, right - x, bottom - y, top - y].map(|side| side as f32)
}
