//! The ray-triangle test.
//!
//! A ray is inside where the signs of its Plücker products with the three edges agree, as in Embree's robust
//! mode. The product of an edge (v0, v1) as seen from the origin, direction . ((v1 - v0) x (a0 + a1)), changes
//! exactly its sign when the ends are swapped, in floating point too, so that of two triangles that share an
//! edge at least one is hit: no light leaks between neighbours. Where many meet in a vertex, rounded signs may
//! contradict each other, so products within rounding of zero count as inside. (Möller and Trumbore's test has
//! no such bond between neighbours; Woop, Benthin and Wald's has, but needs an axis per ray, which a packet
//! does not share.)
//!
//! A ray cannot hit a triangle whose plane its origin lies in. Origins are rounded, so "in" means a height
//! within rounding: some units in the last place of the distances involved. This is what keeps a surface from
//! shadowing itself, however large its triangles.

use super::lanes::{Lanes, Simd};
use super::packet::Packet;

const ON_PLANE: f32 = 1.0 / (1 << 20) as f32;
/// Of direction * edge * distance: bounds the rounding of their product (some twelve roundings of 2^-24).
const ON_EDGE: f32 = 1.0 / (1 << 20) as f32;

pub const HAS_CUTOUT: u32 = 1;

#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Triangle {
    pub corners: [[f32; 3]; 3],
    /// Unit, from float64: a sliver's edges in float32 would not give it.
    pub normal: [f32; 3],
    pub longest_edge: f32,
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
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
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
            longest_edge: [(0, 1), (1, 2), (2, 0)]
                .map(|(i, j)| magnitude(sub(corners32[i], corners32[j])))
                .into_iter()
                .fold(0.0, max),
            instance,
            triangle,
            flags,
        })
    }

    /// Which rays hit before their `t_max`, one bit a lane; stores into `hits` what follows for those that do.
    #[inline(always)]
    pub fn intersect<S: Simd, const SHARED: bool>(&self, simd: S, packet: &Packet, hits: &mut Hits) -> u32 {
        let d = [0, 1, 2].map(|axis| simd.load(&packet.direction[axis]));
        let [v0, v1, v2] = self.corners;
        let zero = simd.splat(0.0);
        let (u, v, w, height, rounding);
        let unit = ON_EDGE * self.longest_edge * packet.longest_direction;
        if SHARED {
            let origin = [packet.origin[0][0], packet.origin[1][0], packet.origin[2][0]];
            let (a, b, c) = (sub(v0, origin), sub(v1, origin), sub(v2, origin));
            let above = dot(a, self.normal);
            let reach = max(magnitude(a), max(magnitude(b), magnitude(c)));
            if above.abs() <= ON_PLANE * reach + packet.slack {
                return 0;
            }
            height = simd.splat(above);
            rounding = simd.splat(unit * reach);
            u = dots(simd, d, cross(sub(v1, v0), add(a, b)).map(|x| simd.splat(x)));
            v = dots(simd, d, cross(sub(v2, v1), add(b, c)).map(|x| simd.splat(x)));
            w = dots(simd, d, cross(sub(v0, v2), add(c, a)).map(|x| simd.splat(x)));
        } else {
            let o = [0, 1, 2].map(|axis| simd.load(&packet.origin[axis]));
            let from = |v: [f32; 3]| [0, 1, 2].map(|axis| simd.sub(simd.splat(v[axis]), o[axis]));
            let (a, b, c) = (from(v0), from(v1), from(v2));
            u = dots(simd, d, edge(simd, sub(v1, v0), a, b));
            v = dots(simd, d, edge(simd, sub(v2, v1), b, c));
            w = dots(simd, d, edge(simd, sub(v0, v2), c, a));
            let above = dots(simd, a, self.normal.map(|x| simd.splat(x)));
            let size = |x| simd.max(x, simd.sub(zero, x));
            let mut reach = zero;
            for axis in 0..3 {
                reach = simd.max(
                    reach,
                    simd.max(size(a[axis]), simd.max(size(b[axis]), size(c[axis]))),
                );
            }
            let tolerance = simd.add(simd.mul(simd.splat(ON_PLANE), reach), simd.splat(packet.slack));
            rounding = simd.mul(simd.splat(unit), reach);
            height = simd.select(simd.less(tolerance, size(above)), above, zero);
        }
        let cosine = dots(simd, d, self.normal.map(|x| simd.splat(x)));
        let least = simd.min(u, simd.min(v, w));
        let most = simd.max(u, simd.max(v, w));
        let inside = simd.or(
            simd.less_equal(simd.sub(zero, rounding), least),
            simd.less_equal(most, rounding),
        );
        // 0 < height / cosine < t_max, without the division.
        let under = simd.less(height, zero);
        let up = simd.select(under, simd.sub(zero, height), height);
        let along = simd.select(under, simd.sub(zero, cosine), cosine);
        let end = simd.mul(simd.load(&packet.t_max), along);
        let ahead = simd.and(simd.less(zero, along), simd.less(zero, up));
        let hit = simd.bits(simd.and(simd.and(inside, ahead), simd.less(up, end)));
        if hit != 0 {
            simd.store(simd.div(up, along), &mut hits.t);
            simd.store(u, &mut hits.weights[0]);
            simd.store(v, &mut hits.weights[1]);
            simd.store(w, &mut hits.weights[2]);
        }
        hit
    }
}

/// Where the rays that hit a triangle hit it.
pub struct Hits {
    pub t: Lanes,
    /// Unnormalised barycentric weights of corners 2, 0 and 1.
    pub weights: [Lanes; 3],
}

#[inline(always)]
fn dots<S: Simd>(simd: S, a: [S::Float; 3], b: [S::Float; 3]) -> S::Float {
    simd.add(
        simd.add(simd.mul(a[0], b[0]), simd.mul(a[1], b[1])),
        simd.mul(a[2], b[2]),
    )
}

/// Edge normals as seen from each origin: edge x (start + end).
#[inline(always)]
fn edge<S: Simd>(simd: S, edge: [f32; 3], start: [S::Float; 3], end: [S::Float; 3]) -> [S::Float; 3] {
    let e = edge.map(|x| simd.splat(x));
    let s = [0, 1, 2].map(|axis| simd.add(start[axis], end[axis]));
    let part = |i: usize, j: usize| simd.sub(simd.mul(e[i], s[j]), simd.mul(e[j], s[i]));
    [part(1, 2), part(2, 0), part(0, 1)]
}
