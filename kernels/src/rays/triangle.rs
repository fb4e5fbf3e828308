//! The ray-triangle test.
//!
//! A ray is inside where the signs of its Plücker products with the three edges agree, as in Embree's robust
//! mode. The product of an edge (v0, v1) as seen from the origin, direction . ((v1 - v0) x (a0 + a1)), changes
//! exactly its sign when the ends are swapped, in floating point too, so that of two triangles that share an
//! edge at least one is hit: no light leaks between neighbours. (Möller and Trumbore's test has no such bond
//! between neighbours; Woop, Benthin and Wald's has, but needs an axis per ray, which a packet does not share.)
//!
//! A ray cannot hit a triangle whose plane its origin lies in. Origins are rounded, so "in" means a height
//! within rounding: some units in the last place of the distances involved. This is what keeps a surface from
//! shadowing itself, however large its triangles.

use super::lanes::{LANES, Lanes, max, min};
use super::packet::Packet;

const ON_PLANE: f32 = 1.0 / (1 << 20) as f32;

pub const HAS_CUTOUT: u32 = 1;

#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Triangle {
    pub corners: [[f32; 3]; 3],
    /// Unit, from float64: a sliver's edges in float32 would not give it.
    pub normal: [f32; 3],
    pub instance: u32,
    pub triangle: u32,
    pub flags: u32,
}

#[inline(always)]
pub fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
pub fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn magnitude(a: [f32; 3]) -> f32 {
    max(a[0].abs(), max(a[1].abs(), a[2].abs()))
}

impl Triangle {
    /// None if it has no area or reaches beyond what float32 products hold.
    pub fn new(corners: [[f64; 3]; 3], instance: u32, triangle: u32, flags: u32) -> Option<Self> {
        const FARTHEST: f64 = 1e12; // metres
        let corners32 = corners.map(|c| c.map(|x| x as f32));
        // The normal of the corners as stored, so that plane and edges are of one triangle.
        let [a, b, c] = corners32.map(|c| c.map(f64::from));
        let (e, f) = (
            [b[0] - a[0], b[1] - a[1], b[2] - a[2]],
            [c[0] - a[0], c[1] - a[1], c[2] - a[2]],
        );
        let n = [
            e[1] * f[2] - e[2] * f[1],
            e[2] * f[0] - e[0] * f[2],
            e[0] * f[1] - e[1] * f[0],
        ];
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        let inside = corners.iter().flatten().all(|x| x.abs() <= FARTHEST); // false for NaN
        (inside && length > 1e-30).then(|| Triangle {
            corners: corners32,
            normal: n.map(|x| (x / length) as f32),
            instance,
            triangle,
            flags,
        })
    }

    /// Which rays hit before their `t_max`; None: none can. `weights` become the unnormalised barycentric
    /// weights of corners 2, 0 and 1.
    #[inline(always)]
    pub fn intersect<const SHARED: bool>(&self, packet: &Packet, weights: &mut [Lanes; 3]) -> Option<Hits> {
        let d = &packet.direction;
        let n = self.normal;
        let [v0, v1, v2] = self.corners;
        let mut hits = Hits {
            height: [0.0; LANES],
            cosine: [0.0; LANES],
            hit: [false; LANES],
        };
        dot_lanes(d, n, &mut hits.cosine);
        if SHARED {
            let origin = [packet.origin[0][0], packet.origin[1][0], packet.origin[2][0]];
            let (a, b, c) = (sub(v0, origin), sub(v1, origin), sub(v2, origin));
            let height = dot(a, n);
            let reach = max(magnitude(a), max(magnitude(b), magnitude(c)));
            if height.abs() <= ON_PLANE * reach + packet.slack {
                return None;
            }
            hits.height = [height; LANES];
            dot_lanes(d, cross(sub(v1, v0), add(a, b)), &mut weights[0]);
            dot_lanes(d, cross(sub(v2, v1), add(b, c)), &mut weights[1]);
            dot_lanes(d, cross(sub(v0, v2), add(c, a)), &mut weights[2]);
        } else {
            let o = &packet.origin;
            for lane in 0..LANES {
                let origin = [o[0][lane], o[1][lane], o[2][lane]];
                let direction = [d[0][lane], d[1][lane], d[2][lane]];
                let (a, b, c) = (sub(v0, origin), sub(v1, origin), sub(v2, origin));
                weights[0][lane] = dot(direction, cross(sub(v1, v0), add(a, b)));
                weights[1][lane] = dot(direction, cross(sub(v2, v1), add(b, c)));
                weights[2][lane] = dot(direction, cross(sub(v0, v2), add(c, a)));
                let height = dot(a, n);
                let reach = max(magnitude(a), max(magnitude(b), magnitude(c)));
                let on_plane = height.abs() <= ON_PLANE * reach + packet.slack;
                hits.height[lane] = if on_plane { 0.0 } else { height };
            }
        }
        for lane in 0..LANES {
            let (u, v, w) = (weights[0][lane], weights[1][lane], weights[2][lane]);
            let (least, most) = (min(u, min(v, w)), max(u, max(v, w)));
            let (height, cosine) = (hits.height[lane], hits.cosine[lane]);
            // 0 < height / cosine < t_max, without the division.
            let (up, along) = if height < 0.0 {
                (-height, -cosine)
            } else {
                (height, cosine)
            };
            let between = (up > 0.0) & (along > 0.0) & (up < packet.t_max[lane] * along);
            hits.hit[lane] = ((least >= 0.0) | (most <= 0.0)) & between;
        }
        Some(hits)
    }
}

/// What a triangle does to a packet.
pub struct Hits {
    /// Of the triangle's plane over each origin, and its slope to each ray: t is their quotient.
    pub height: Lanes,
    pub cosine: Lanes,
    pub hit: [bool; LANES],
}

#[inline(always)]
fn dot_lanes(d: &[Lanes; 3], n: [f32; 3], result: &mut Lanes) {
    for lane in 0..LANES {
        result[lane] = d[0][lane] * n[0] + d[1][lane] * n[1] + d[2][lane] * n[2];
    }
}
