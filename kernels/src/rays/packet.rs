//! A packet of rays, and its test against a box.

use super::lanes::{LANES, Lanes, any, max, min};

/// Boxes are widened by this share of the coordinates' magnitude: the triangle test may be off by a few units
/// in the last place, and must not be turned away by a box that is not.
pub const WIDENING: f32 = 1.0 / (1 << 21) as f32;

/// `t_max` of a ray that hit something, and of a lane without a ray.
pub const HIT: f32 = -1.0;
pub const IDLE: f32 = -2.0;

/// Directions need not be unit; `t` counts in their lengths.
#[derive(Clone, Copy)]
pub struct Packet {
    pub origin: [Lanes; 3],
    pub direction: [Lanes; 3],
    /// Where each ray ends so far; below zero: nothing to trace in this lane.
    pub t_max: Lanes,
    inverse: [Lanes; 3],
    /// `WIDENING` of the origins' magnitude; also the height below which an origin counts as on a surface.
    pub slack: f32,
    /// Whether most rays go towards negative x, y, z: the order in which children are visited.
    backward: [bool; 3],
}

impl Packet {
    pub const EMPTY: Packet = Packet {
        origin: [[0.0; LANES]; 3],
        direction: [[0.0; LANES], [0.0; LANES], [1.0; LANES]],
        t_max: [IDLE; LANES],
        inverse: [[0.0; LANES]; 3],
        slack: 0.0,
        backward: [false; 3],
    };

    /// Rays of one origin, prepared.
    #[inline(always)]
    pub fn shared(origin: [f32; 3], direction: [Lanes; 3], t_max: Lanes) -> Self {
        let mut packet = Packet {
            origin: origin.map(|x| [x; LANES]),
            direction,
            t_max,
            ..Packet::EMPTY
        };
        packet.prepare();
        packet
    }

    #[inline(always)]
    pub fn set(&mut self, lane: usize, origin: [f32; 3], direction: [f32; 3], t_max: f32) {
        for axis in 0..3 {
            self.origin[axis][lane] = origin[axis];
            self.direction[axis][lane] = direction[axis];
        }
        self.t_max[lane] = t_max;
    }

    /// Fills in what follows from origins and directions; to be called before tracing.
    #[inline(always)]
    pub fn prepare(&mut self) {
        let mut magnitude = 0.0;
        for axis in 0..3 {
            let mut sum = 0.0;
            for lane in 0..LANES {
                let d = self.direction[axis][lane];
                // A zero would give infinity, and 0 * infinity is NaN; t is still exact enough to compare.
                let tiny = if d < 0.0 { -1e-18 } else { 1e-18 };
                self.inverse[axis][lane] = 1.0 / if d.abs() < 1e-18 { tiny } else { d };
                sum += d;
                magnitude = max(magnitude, self.origin[axis][lane].abs());
            }
            self.backward[axis] = sum < 0.0;
        }
        self.slack = WIDENING * magnitude;
    }

    #[inline(always)]
    pub fn goes_backward(&self, axis: u32) -> bool {
        self.backward[axis as usize]
    }

    #[inline(always)]
    pub fn is_busy(&self) -> bool {
        let mut busy = [false; LANES];
        for lane in 0..LANES {
            busy[lane] = self.t_max[lane] >= 0.0;
        }
        any(&busy)
    }

    /// Whether any ray meets the box. `SHARED`: all origins are lane 0's.
    #[inline(always)]
    pub fn meets<const SHARED: bool>(&self, low: &[f32; 3], high: &[f32; 3]) -> bool {
        let (mut near, mut far) = ([0.0; LANES], self.t_max);
        for axis in 0..3 {
            let (low, high) = (low[axis] - self.slack, high[axis] + self.slack);
            let (shared_low, shared_high) = (low - self.origin[axis][0], high - self.origin[axis][0]);
            for lane in 0..LANES {
                let inverse = self.inverse[axis][lane];
                let (a, b) = if SHARED {
                    (shared_low * inverse, shared_high * inverse)
                } else {
                    let origin = self.origin[axis][lane];
                    ((low - origin) * inverse, (high - origin) * inverse)
                };
                near[lane] = max(near[lane], min(a, b));
                far[lane] = min(far[lane], max(a, b));
            }
        }
        let mut hit = [false; LANES];
        for lane in 0..LANES {
            hit[lane] = near[lane] <= far[lane];
        }
        any(&hit)
    }
}
