//! A binary tree of boxes, built by obvhs and walked by whole packets.
//!
//! Why binary: a packet of sixteen fills the vector registers with rays, so a wide node has nothing left to
//! fill; and why our own walk: obvhs' boxes are not widened for rounding and it drops boxes that end within
//! t = 1e-4.

use super::lanes::{LANES, Simd};
use super::packet::{Packet, WIDENING};
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::{Boundable, BvhBuildParams};
use std::ops::Range;
use std::time::Duration;

/// Reference to a leaf: this bit, the index of its first primitive, and in the low bits their count.
const LEAF: u32 = 1 << 31;
const COUNT_BITS: u32 = 4;
const MAX_LEAF: u32 = 4;
/// What a leaf's reference can index.
pub const MAX_PRIMITIVES: usize = 1 << (31 - COUNT_BITS);

#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Node {
    low: [[f32; 3]; 2],
    high: [[f32; 3]; 2],
    children: [u32; 2],
    /// Axis along which the children lie farthest apart.
    axis: u32,
    /// The child that comes first along that axis.
    lower: u32,
}

pub struct Bvh {
    nodes: Vec<Node>,
    depth: usize,
    pub bounds: ([f32; 3], [f32; 3]),
}

/// Bounds of one primitive.
#[derive(Clone, Copy)]
pub struct Bounds(pub [f32; 3], pub [f32; 3]);

impl Boundable for Bounds {
    fn aabb(&self) -> Aabb {
        Aabb::new(self.0.into(), self.1.into())
    }
}

fn widened(aabb: &Aabb) -> ([f32; 3], [f32; 3]) {
    let (low, high): ([f32; 3], [f32; 3]) = (aabb.min.into(), aabb.max.into());
    let most = low.iter().chain(&high).fold(0.0, |m: f32, x| m.max(x.abs()));
    let margin = WIDENING * most;
    (low.map(|x| x - margin), high.map(|x| x + margin))
}

/// What a walk does with a leaf. A trait and not a closure, because it must be compiled with the walk (see
/// [`super::lanes::dispatch`]), and closures cannot be told to.
pub trait Leaf {
    fn visit<S: Simd>(&mut self, simd: S, packet: &mut Packet, primitives: Range<usize>);
}

impl Bvh {
    /// Returns the tree and the order in which it wants its primitives (indices into `primitives`).
    pub fn build(primitives: &[Bounds]) -> (Self, Vec<u32>) {
        if primitives.is_empty() {
            return (
                Bvh {
                    nodes: Vec::new(),
                    depth: 0,
                    bounds: ([0.0; 3], [0.0; 3]),
                },
                Vec::new(),
            );
        }
        let parameters = BvhBuildParams {
            max_prims_per_leaf: MAX_LEAF,
            ..BvhBuildParams::medium_build()
        };
        let tree = build_bvh2(primitives, parameters, &mut Duration::default());
        let reference = |index: usize, slots: &mut Vec<(usize, usize)>, depth: usize| {
            let node = &tree.nodes[index];
            if node.is_leaf() {
                LEAF | node.first_index << COUNT_BITS | node.prim_count
            } else {
                slots.push((node.first_index as usize, depth));
                slots.len() as u32 - 1
            }
        };
        // Breadth first: `slots` are obvhs' pairs of siblings, in the order of our nodes.
        let mut slots = Vec::new();
        let mut nodes = Vec::new();
        let mut depth = 1;
        if tree.nodes[0].is_leaf() {
            let leaf = reference(0, &mut slots, 0);
            let (low, high) = widened(tree.nodes[0].aabb());
            // Twice the same child: one leaf is all there is.
            nodes.push(Node {
                low: [low; 2],
                high: [high; 2],
                children: [leaf; 2],
                axis: 0,
                lower: 0,
            });
        } else {
            reference(0, &mut slots, 1);
        }
        while nodes.len() < slots.len() {
            let (pair, level) = slots[nodes.len()];
            depth = depth.max(level);
            let boxes = [pair, pair + 1].map(|i| widened(tree.nodes[i].aabb()));
            let apart = |axis: usize| {
                let middle = boxes.map(|(low, high)| low[axis] + high[axis]);
                middle[1] - middle[0]
            };
            let axis = (0..3)
                .max_by(|&a, &b| apart(a).abs().total_cmp(&apart(b).abs()))
                .unwrap_or(0);
            nodes.push(Node {
                low: boxes.map(|b| b.0),
                high: boxes.map(|b| b.1),
                children: [pair, pair + 1].map(|i| reference(i, &mut slots, level + 1)),
                axis: axis as u32,
                lower: u32::from(apart(axis) < 0.0),
            });
        }
        let bounds = widened(tree.nodes[0].aabb());
        (Bvh { nodes, depth, bounds }, tree.primitive_indices)
    }

    /// Visits every leaf that some busy ray of the packet may meet, nearer ones first as far as the order
    /// along an axis tells, until no ray is busy. `stack` is scratch.
    #[inline(always)]
    pub fn walk<S: Simd, const SHARED: bool>(
        &self,
        simd: S,
        packet: &mut Packet,
        stack: &mut Vec<u32>,
        leaf: &mut impl Leaf,
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let floor = stack.len();
        stack.reserve(self.depth + 1);
        let mut next = 0;
        loop {
            if next & LEAF == 0 {
                let node = &self.nodes[next as usize];
                let first = packet.meets::<S, SHARED>(simd, &node.low[0], &node.high[0]);
                let second = packet.meets::<S, SHARED>(simd, &node.low[1], &node.high[1]);
                match (first, second) {
                    (true, true) => {
                        let near = (node.lower ^ u32::from(packet.goes_backward(node.axis))) as usize & 1;
                        stack.push(node.children[1 - near]);
                        next = node.children[near];
                        continue;
                    }
                    (true, false) => {
                        next = node.children[0];
                        continue;
                    }
                    (false, true) => {
                        next = node.children[1];
                        continue;
                    }
                    (false, false) => {}
                }
            } else {
                let first = ((next & !LEAF) >> COUNT_BITS) as usize;
                let count = (next & ((1 << COUNT_BITS) - 1)) as usize;
                leaf.visit(simd, packet, first..first + count);
                if packet.busy(simd) == 0 {
                    stack.truncate(floor);
                    return;
                }
            }
            if stack.len() == floor {
                return;
            }
            match stack.pop() {
                Some(reference) => next = reference,
                None => return,
            }
        }
    }
}

/// What the nearest hit of each ray was.
#[derive(Clone, Copy)]
pub struct Nearest {
    pub instance: [u32; LANES],
    pub triangle: [u32; LANES],
}

impl Nearest {
    pub const NONE: Nearest = Nearest {
        instance: [u32::MAX; LANES],
        triangle: [u32::MAX; LANES],
    };
}
