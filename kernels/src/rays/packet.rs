//! A packet of rays, and its test against a box.

use super::lanes::{LANES, Lanes, Simd};

/// Boxes are widened by this share of the coordinates' magnitude: the triangle test may be off by a few units
/// in the last place, and must not be turned away by a box that is not.
pub const WIDENING: f32 = 1.0 / (1 << 21) as f32;

/// `t_max` of a ray that hit something, and of a lane without a ray.
pub const HIT: f32 = -1.0;
pub const IDLE: f32 = -2.0;

/// Directions need not be unit; `t` counts in their lengths.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Packet {
    pub origin: [Lanes; 3],
    pub direction: [Lanes; 3],
    /// Where each ray ends so far; below zero: nothing to trace in this lane.
    pub t_max: Lanes,
    inverse: [Lanes; 3],
    /// `WIDENING` of the origins' magnitude; also the height below which an origin counts as on a surface.
    pub slack: f32,
    /// Largest component of any direction.
    pub longest_direction: f32,
    /// Whether rays go towards negative x, y, z: the first one's decide the order in which children are visited.
    backward: [bool; 3],
    /// Whether all rays agree in that.
    aligned: bool,
}

impl Packet {
    pub const EMPTY: Packet = Packet {
        origin: [[0.0; LANES]; 3],
        direction: [[0.0; LANES], [0.0; LANES], [1.0; LANES]],
        t_max: [IDLE; LANES],
        inverse: [[0.0; LANES]; 3],
        slack: 0.0,
        longest_direction: 0.0,
        backward: [false; 3],
        aligned: false,
    };

    /// Rays of one origin, prepared.
    #[inline(always)]
    pub fn shared<S: Simd>(simd: S, origin: [f32; 3], direction: [Lanes; 3], t_max: Lanes) -> Self {
        let mut packet = Packet {
            origin: origin.map(|x| [x; LANES]),
            direction,
            t_max,
            ..Packet::EMPTY
        };
        packet.prepare(simd);
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
    pub fn prepare<S: Simd>(&mut self, simd: S) {
        let zero = simd.splat(0.0);
        let (tiny, minus_tiny) = (simd.splat(1e-18), simd.splat(-1e-18));
        let busy = self.busy(simd);
        let (mut magnitude, mut longest) = (zero, zero);
        self.aligned = true;
        for axis in 0..3 {
            // Zeros would give infinity, and 0 * infinity is NaN; 1e18 is as good as infinite to any scene.
            let d = simd.load(&self.direction[axis]);
            let negative = simd.less(d, zero);
            longest = simd.max(longest, simd.max(d, simd.sub(zero, d)));
            let away = simd.select(negative, simd.min(d, minus_tiny), simd.max(d, tiny));
            simd.store(simd.div(simd.splat(1.0), away), &mut self.inverse[axis]);
            let negative = simd.bits(negative) & busy;
            self.backward[axis] = negative & (busy & busy.wrapping_neg()) != 0;
            self.aligned &= negative == 0 || negative == busy;
            let o = simd.load(&self.origin[axis]);
            magnitude = simd.max(magnitude, simd.max(o, simd.sub(zero, o)));
        }
        let largest = |values: S::Float| {
            let mut lanes = [0.0; LANES];
            simd.store(values, &mut lanes);
            lanes.iter().fold(0.0, |m: f32, x| m.max(*x))
        };
        self.slack = WIDENING * largest(magnitude);
        self.longest_direction = largest(longest);
    }

    #[inline(always)]
    pub fn goes_backward(&self, axis: u32) -> bool {
        self.backward[axis as usize]
    }

    /// Lanes that still have something to find.
    #[inline(always)]
    pub fn busy<S: Simd>(&self, simd: S) -> u32 {
        simd.bits(simd.less_equal(simd.splat(0.0), simd.load(&self.t_max)))
    }

    /// Whether any ray meets the box. `SHARED`: all origins are lane 0's.
    #[inline(always)]
    pub fn meets<S: Simd, const SHARED: bool>(&self, simd: S, low: &[f32; 3], high: &[f32; 3]) -> bool {
        let (mut near, mut far) = (simd.splat(0.0), simd.load(&self.t_max));
        for axis in 0..3 {
            let (low, high) = (low[axis] - self.slack, high[axis] + self.slack);
            let inverse = simd.load(&self.inverse[axis]);
            let plane = |at: f32| {
                let distance = if SHARED {
                    simd.splat(at - self.origin[axis][0])
                } else {
                    simd.sub(simd.splat(at), simd.load(&self.origin[axis]))
                };
                simd.mul(distance, inverse)
            };
            if self.aligned {
                let (first, last) = if self.backward[axis] {
                    (high, low)
                } else {
                    (low, high)
                };
                near = simd.max(near, plane(first));
                far = simd.min(far, plane(last));
            } else {
                let (a, b) = (plane(low), plane(high));
                near = simd.max(near, simd.min(a, b));
                far = simd.min(far, simd.max(a, b));
            }
        }
        simd.any(simd.less_equal(near, far))
    }
}
