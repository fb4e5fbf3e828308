//! The ray-triangle test, sixteen triangles at a time.
//!
//! A ray is inside where the signs of its Plücker products with the three edges agree, as in Embree's robust
//! mode. The product of an edge (v0, v1) as seen from the origin, direction . ((v1 - v0) x (a0 + a1)), changes
//! exactly its sign when the ends are swapped, in floating point too, so that of two triangles that share an
//! edge at least one is hit: no light leaks between neighbours. Where many meet in a vertex, rounded signs may
//! contradict each other, so products within rounding of zero count as inside. (Möller and Trumbore's test has
//! no such bond between neighbours; Woop, Benthin and Wald's has, but shears space for each ray, and then
//! rays of one origin have nothing to share.)
//!
//! A ray cannot hit a triangle whose plane its origin lies in. Origins are rounded, so "in" means a height
//! within rounding: some units in the last place of the distances involved. This is what keeps a surface from
//! shadowing itself, however large its triangles.

use super::packet::Packet;
use crate::simd::{LANES, Lanes, Vector};
use std::ops::{Add, Mul, Sub};

const ON_PLANE: f32 = 1.0 / (1 << 20) as f32;
/// Of direction * edge * distance: bounds the rounding of their product (some twelve roundings of 2^-24).
const ON_EDGE: f32 = 1.0 / (1 << 20) as f32;

#[derive(Clone, Copy)]
pub struct Triangle {
    pub corners: [[f32; 3]; 3],
    /// Unit, from float64: a sliver's edges in float32 would not give it.
    normal: [f32; 3],
    pub instance: u32,
    pub triangle: u32,
    /// Whether something may get through it.
    pub is_clear: bool,
}

impl Triangle {
    /// None if it has no area or reaches beyond what float32 products hold.
    pub fn new(corners: [[f64; 3]; 3], instance: u32, triangle: u32, is_clear: bool) -> Option<Self> {
        const FARTHEST: f64 = 1e12; // metres
        const SMALLEST: f64 = 1e-30; // square metres
        let rounded = corners.map(|c| c.map(|x| x as f32));
        // The normal of the corners as stored, so that plane and edges are of one triangle.
        let [a, b, c] = rounded.map(|c| c.map(f64::from));
        let edge = |to: [f64; 3]| [to[0] - a[0], to[1] - a[1], to[2] - a[2]];
        let (e, f) = (edge(b), edge(c));
        let n = [
            e[1] * f[2] - e[2] * f[1],
            e[2] * f[0] - e[0] * f[2],
            e[0] * f[1] - e[1] * f[0],
        ];
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        let inside = corners.iter().flatten().all(|x| x.abs() <= FARTHEST); // false for NaN
        (inside && length > SMALLEST).then(|| Triangle {
            corners: rounded,
            normal: n.map(|x| (x / length) as f32),
            instance,
            triangle,
            is_clear,
        })
    }
}

/// Up to sixteen triangles, one a lane. Empty lanes are points at the origin with no normal: height 0, no hit.
#[repr(C, align(64))]
pub struct Block {
    corners: [[Lanes; 3]; 3],
    normal: [Lanes; 3],
    longest_edge: Lanes,
    pub instances: [u32; LANES],
    pub triangles: [u32; LANES],
    /// Lanes that something may get through.
    pub clear: u32,
    /// The instance of all of them, if it is one.
    pub instance: Option<u32>,
}

impl Block {
    pub fn new(triangles: impl ExactSizeIterator<Item = Triangle>) -> Self {
        let mut block = Block {
            corners: [[[0.0; LANES]; 3]; 3],
            normal: [[0.0; LANES]; 3],
            longest_edge: [0.0; LANES],
            instances: [0; LANES],
            triangles: [0; LANES],
            clear: 0,
            instance: None,
        };
        let count = triangles.len();
        for (lane, triangle) in triangles.enumerate() {
            let [a, b, c] = triangle.corners;
            for axis in 0..3 {
                for corner in 0..3 {
                    block.corners[corner][axis][lane] = triangle.corners[corner][axis];
                }
                block.normal[axis][lane] = triangle.normal[axis];
                let sides = [a[axis] - b[axis], b[axis] - c[axis], c[axis] - a[axis]];
                let longest = sides.iter().fold(block.longest_edge[lane], |m, s| m.max(s.abs()));
                block.longest_edge[lane] = longest;
            }
            block.instances[lane] = triangle.instance;
            block.triangles[lane] = triangle.triangle;
            block.clear |= u32::from(triangle.is_clear) << lane;
        }
        let first = block.instances[0];
        block.instance = block.instances[..count]
            .iter()
            .all(|i| *i == first)
            .then_some(first);
        block
    }

    /// What the rays of one origin have in common.
    #[inline(always)]
    pub fn seen_from<V: Vector>(&self, vector: V, origin: [f32; 3], packet: &Packet) -> Seen<V> {
        let load = |v: &[Lanes; 3]| [vector.load(&v[0]), vector.load(&v[1]), vector.load(&v[2])];
        let o = [
            vector.splat(origin[0]),
            vector.splat(origin[1]),
            vector.splat(origin[2]),
        ];
        let (v0, v1, v2) = (
            load(&self.corners[0]),
            load(&self.corners[1]),
            load(&self.corners[2]),
        );
        let (a, b, c) = (sub(v0, o), sub(v1, o), sub(v2, o));
        let normal = load(&self.normal);
        let height = dot(a, normal);
        let (x, y, z) = (magnitude(vector, a), magnitude(vector, b), magnitude(vector, c));
        let reach = vector.max(x, vector.max(y, z));
        let tolerance = vector.splat(ON_PLANE) * reach + vector.splat(packet.slack);
        let unit = vector.splat(ON_EDGE * packet.longest_direction);
        Seen {
            edges: [
                cross(sub(v1, v0), add(a, b)),
                cross(sub(v2, v1), add(b, c)),
                cross(sub(v0, v2), add(c, a)),
            ],
            normal,
            height,
            above: vector.less(tolerance, vector.abs(height)),
            rounding: unit * vector.load(&self.longest_edge) * reach,
        }
    }
}

/// A block as seen from an origin.
#[derive(Clone, Copy)]
pub struct Seen<V: Vector> {
    edges: [[V::Floats; 3]; 3],
    normal: [V::Floats; 3],
    /// Of the triangle's plane over the origin, along the normal.
    height: V::Floats,
    above: V::Mask,
    rounding: V::Floats,
}

/// Where a ray hits the triangles that it hits.
pub struct Hits<V: Vector> {
    /// One bit a triangle.
    pub hit: u32,
    pub t: V::Floats,
    /// Unnormalised barycentric weights of corners 2, 0 and 1.
    pub weights: [V::Floats; 3],
}

impl<V: Vector> Seen<V> {
    #[inline(always)]
    pub fn intersect(&self, vector: V, direction: [f32; 3], t_max: f32) -> Hits<V> {
        let zero = vector.splat(0.0);
        let d = [
            vector.splat(direction[0]),
            vector.splat(direction[1]),
            vector.splat(direction[2]),
        ];
        let u = dot(d, self.edges[0]);
        let v = dot(d, self.edges[1]);
        let w = dot(d, self.edges[2]);
        let least = vector.min(u, vector.min(v, w));
        let most = vector.max(u, vector.max(v, w));
        let inside = vector.or(
            vector.less_equal(zero - self.rounding, least),
            vector.less_equal(most, self.rounding),
        );
        let t = self.height / dot(d, self.normal);
        // Infinite t, for a ray along the plane, is not below any t_max; NaN needs a height of zero.
        let ahead = vector.and(vector.less(zero, t), vector.less(t, vector.splat(t_max)));
        Hits {
            hit: vector.bits(vector.and(vector.and(inside, self.above), ahead)),
            t,
            weights: [u, v, w],
        }
    }
}

#[inline(always)]
fn magnitude<V: Vector>(vector: V, a: [V::Floats; 3]) -> V::Floats {
    vector.max(vector.abs(a[0]), vector.max(vector.abs(a[1]), vector.abs(a[2])))
}

#[inline(always)]
fn add<F: Copy + Add<Output = F>>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn sub<F: Copy + Sub<Output = F>>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn dot<F: Copy + Add<Output = F> + Mul<Output = F>>(a: [F; 3], b: [F; 3]) -> F {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross<F: Copy + Sub<Output = F> + Mul<Output = F>>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
