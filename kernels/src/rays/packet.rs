//! Sixteen rays that are traced together.

use crate::simd::{LANES, Lanes};

/// Boxes are widened by this share of the coordinates' magnitude: the triangle test may be off by a few units
/// in the last place, and must not be turned away by a box that is not.
pub const WIDENING: f32 = 1.0 / (1 << 21) as f32;

/// Directions need not be unit; `t` counts in their lengths.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Packet {
    pub origin: [Lanes; 3],
    pub direction: [Lanes; 3],
    pub t_max: Lanes,
    /// Rays that were set, and those of them that hit something, one bit a lane.
    pub set: u32,
    pub hit: u32,
    /// 1 / direction.
    pub inverse: [Lanes; 3],
    /// Per axis, the rays that go down it.
    pub backward: [u32; 3],
    /// `WIDENING` of the origins' magnitude; also the height below which an origin counts as on a surface.
    pub slack: f32,
    /// Largest component of any direction.
    pub longest_direction: f32,
    /// Whether all rays start where the first one does.
    pub shared: bool,
}

impl Packet {
    pub const EMPTY: Packet = Packet {
        origin: [[0.0; LANES]; 3],
        direction: [[0.0; LANES]; 3],
        t_max: [0.0; LANES],
        set: 0,
        hit: 0,
        inverse: [[0.0; LANES]; 3],
        backward: [0; 3],
        slack: 0.0,
        longest_direction: 0.0,
        shared: false,
    };

    /// The rays `set` of one origin, prepared. Directions of the others must be numbers.
    #[inline(always)]
    pub fn of_one_origin(origin: [f32; 3], direction: [Lanes; 3], t_max: Lanes, set: u32) -> Self {
        let mut packet = Packet {
            origin: origin.map(|x| [x; LANES]),
            direction,
            t_max,
            set,
            ..Packet::EMPTY
        };
        packet.prepare();
        packet
    }

    #[inline(always)]
    pub fn add(&mut self, lane: usize, origin: [f32; 3], direction: [f32; 3], t_max: f32) {
        for axis in 0..3 {
            self.origin[axis][lane] = origin[axis];
            self.direction[axis][lane] = direction[axis];
        }
        self.t_max[lane] = t_max;
        self.set |= 1 << lane;
    }

    /// Fills in what follows from origins and directions; to be called before tracing.
    #[inline(always)]
    pub fn prepare(&mut self) {
        let first = self.set.trailing_zeros() as usize % LANES;
        let (mut magnitude, mut longest) = (0.0, 0.0);
        self.shared = true;
        for axis in 0..3 {
            let mut same = true;
            for lane in 0..LANES {
                let d = self.direction[axis][lane];
                // Zeros would give infinity, and 0 * infinity is NaN; 1e18 is as good as infinite to any scene.
                let tiny = if d < 0.0 { -1e-18 } else { 1e-18 };
                self.inverse[axis][lane] = 1.0 / if d.abs() < 1e-18 { tiny } else { d };
                longest = if d.abs() > longest { d.abs() } else { longest };
                let o = self.origin[axis][lane];
                magnitude = if o.abs() > magnitude { o.abs() } else { magnitude };
                same &= (o == self.origin[axis][first]) | (self.set >> lane & 1 == 0);
            }
            self.shared &= same;
            let mut backward = 0;
            for lane in 0..LANES {
                backward |= u32::from(self.direction[axis][lane] < 0.0) << lane;
            }
            self.backward[axis] = backward;
        }
        self.slack = WIDENING * magnitude;
        self.longest_direction = longest;
    }

    #[inline(always)]
    pub fn origin_of(&self, lane: usize) -> [f32; 3] {
        [self.origin[0][lane], self.origin[1][lane], self.origin[2][lane]]
    }
}

/// The lanes of a mask, lowest first.
#[inline(always)]
pub fn lanes_of(mask: u32) -> LanesOf {
    LanesOf(mask)
}

pub struct LanesOf(u32);

impl Iterator for LanesOf {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        if self.0 == 0 {
            return None;
        }
        let lane = self.0.trailing_zeros() as usize;
        self.0 &= self.0 - 1;
        Some(lane % LANES)
    }
}
