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

use super::lanes::{LANES, Lanes, Simd};
use super::packet::Packet;

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
    /// Whether its material clips by alpha.
    pub cutout: bool,
}

impl Triangle {
    /// None if it has no area or reaches beyond what float32 products hold.
    pub fn new(corners: [[f64; 3]; 3], instance: u32, triangle: u32, cutout: bool) -> Option<Self> {
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
            cutout,
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
    /// Lanes whose material clips by alpha.
    pub cutouts: u32,
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
            cutouts: 0,
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
            block.cutouts |= u32::from(triangle.cutout) << lane;
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
    pub fn seen_from<S: Simd>(&self, simd: S, origin: [f32; 3], packet: &Packet) -> Seen<S> {
        let load = |v: &[Lanes; 3]| [simd.load(&v[0]), simd.load(&v[1]), simd.load(&v[2])];
        let o = [
            simd.splat(origin[0]),
            simd.splat(origin[1]),
            simd.splat(origin[2]),
        ];
        let (v0, v1, v2) = (
            load(&self.corners[0]),
            load(&self.corners[1]),
            load(&self.corners[2]),
        );
        let (a, b, c) = (sub(simd, v0, o), sub(simd, v1, o), sub(simd, v2, o));
        let normal = load(&self.normal);
        let height = dot(simd, a, normal);
        let (x, y, z) = (magnitude(simd, a), magnitude(simd, b), magnitude(simd, c));
        let reach = simd.max(x, simd.max(y, z));
        let tolerance = simd.add(simd.mul(simd.splat(ON_PLANE), reach), simd.splat(packet.slack));
        let unit = simd.splat(ON_EDGE * packet.longest_direction);
        Seen {
            edges: [
                cross(simd, sub(simd, v1, v0), add(simd, a, b)),
                cross(simd, sub(simd, v2, v1), add(simd, b, c)),
                cross(simd, sub(simd, v0, v2), add(simd, c, a)),
            ],
            normal,
            height,
            above: simd.less(tolerance, size(simd, height)),
            rounding: simd.mul(simd.mul(unit, simd.load(&self.longest_edge)), reach),
        }
    }
}

/// A block as seen from an origin.
#[derive(Clone, Copy)]
pub struct Seen<S: Simd> {
    edges: [[S::Float; 3]; 3],
    normal: [S::Float; 3],
    /// Of the triangle's plane over the origin, along the normal.
    height: S::Float,
    above: S::Mask,
    rounding: S::Float,
}

/// Where a ray hits the triangles that it hits.
pub struct Hits<S: Simd> {
    /// One bit a triangle.
    pub hit: u32,
    pub t: S::Float,
    /// Unnormalised barycentric weights of corners 2, 0 and 1.
    pub weights: [S::Float; 3],
}

impl<S: Simd> Seen<S> {
    #[inline(always)]
    pub fn intersect(&self, simd: S, direction: [f32; 3], t_max: f32) -> Hits<S> {
        let zero = simd.splat(0.0);
        let d = [
            simd.splat(direction[0]),
            simd.splat(direction[1]),
            simd.splat(direction[2]),
        ];
        let u = dot(simd, d, self.edges[0]);
        let v = dot(simd, d, self.edges[1]);
        let w = dot(simd, d, self.edges[2]);
        let least = simd.min(u, simd.min(v, w));
        let most = simd.max(u, simd.max(v, w));
        let inside = simd.or(
            simd.less_equal(simd.sub(zero, self.rounding), least),
            simd.less_equal(most, self.rounding),
        );
        let t = simd.div(self.height, dot(simd, d, self.normal));
        // Infinite t, for a ray along the plane, is not below any t_max; NaN needs a height of zero.
        let ahead = simd.and(simd.less(zero, t), simd.less(t, simd.splat(t_max)));
        Hits {
            hit: simd.bits(simd.and(simd.and(inside, self.above), ahead)),
            t,
            weights: [u, v, w],
        }
    }
}

#[inline(always)]
fn size<S: Simd>(simd: S, a: S::Float) -> S::Float {
    simd.max(a, simd.sub(simd.splat(0.0), a))
}

#[inline(always)]
fn magnitude<S: Simd>(simd: S, a: [S::Float; 3]) -> S::Float {
    simd.max(size(simd, a[0]), simd.max(size(simd, a[1]), size(simd, a[2])))
}

#[inline(always)]
fn add<S: Simd>(simd: S, a: [S::Float; 3], b: [S::Float; 3]) -> [S::Float; 3] {
    [simd.add(a[0], b[0]), simd.add(a[1], b[1]), simd.add(a[2], b[2])]
}

#[inline(always)]
fn sub<S: Simd>(simd: S, a: [S::Float; 3], b: [S::Float; 3]) -> [S::Float; 3] {
    [simd.sub(a[0], b[0]), simd.sub(a[1], b[1]), simd.sub(a[2], b[2])]
}

#[inline(always)]
fn dot<S: Simd>(simd: S, a: [S::Float; 3], b: [S::Float; 3]) -> S::Float {
    let first = simd.add(simd.mul(a[0], b[0]), simd.mul(a[1], b[1]));
    simd.add(first, simd.mul(a[2], b[2]))
}

#[inline(always)]
fn cross<S: Simd>(simd: S, a: [S::Float; 3], b: [S::Float; 3]) -> [S::Float; 3] {
    [
        simd.sub(simd.mul(a[1], b[2]), simd.mul(a[2], b[1])),
        simd.sub(simd.mul(a[2], b[0]), simd.mul(a[0], b[2])),
        simd.sub(simd.mul(a[0], b[1]), simd.mul(a[1], b[0])),
    ]
}
