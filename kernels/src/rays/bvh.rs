//! A tree of boxes, sixteen to a node, made from the binary one that obvhs builds.
//!
//! One ray meets sixteen boxes at once, whatever its neighbours do, so that a packet whose rays part costs no
//! more than its rays alone; rays that stay together share the walk, the loads and, from one origin, the
//! planes' distances. obvhs' own walks are not used because they do not widen boxes for rounding and drop
//! boxes that end within t = 1e-4.

use super::packet::{Packet, WIDENING, lanes_of};
use crate::random::Draw;
use crate::simd::{LANES, Lanes, Vector};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::{Boundable, BvhBuildParams};
use std::ops::Range;
use std::time::Duration;

/// A child that is a leaf: this bit and its index.
const LEAF: u32 = 1 << 31;

#[repr(C, align(64))]
struct Node {
    /// Low and high planes of the children's boxes, by axis; empty slots are inside out.
    planes: [[Lanes; 2]; 3],
    children: [u32; LANES],
}

/// Of so many primitives a better tree takes longer than the rays of an image gain by it: of ten million a sixth
/// of the time that it takes to build, while rays are as fast within what can be measured.
const MANY: usize = 1 << 20;

const EMPTY_NODE: Node = Node {
    planes: [[[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]]; 3],
    children: [LEAF; LANES],
};

pub struct Bvh {
    nodes: Vec<Node>,
    pub bounds: ([f32; 3], [f32; 3]),
}

/// A tree and its leaves: primitives by index.
pub struct Built {
    pub bvh: Bvh,
    pub order: Vec<u32>,
    /// Of `order`, leaf by leaf.
    pub leaves: Vec<Range<usize>>,
}

/// Bounds of one primitive.
#[derive(Clone, Copy)]
pub struct Bounds(pub [f32; 3], pub [f32; 3]);

impl Boundable for Bounds {
    fn aabb(&self) -> Aabb {
        Aabb::new(self.0.into(), self.1.into())
    }
}

/// Packets waiting at a node: its reference and their rays.
pub type Stack = Vec<(u32, u32)>;

/// What a walk does with a leaf. A trait and not a closure, because it must be compiled with the walk (see
/// [`crate::simd::dispatch`]), and closures cannot be told to.
pub trait Leaf {
    /// Marks those of `rays` that are done in `packet.hit`.
    fn visit<V: Vector>(&mut self, vector: V, packet: &mut Packet, rays: u32, leaf: usize);
}

fn widened(aabb: &Aabb) -> ([f32; 3], [f32; 3]) {
    let (low, high): ([f32; 3], [f32; 3]) = (aabb.min.into(), aabb.max.into());
    let most = low.iter().chain(&high).fold(0.0, |m: f32, x| m.max(x.abs()));
    let margin = WIDENING * most;
    (low.map(|x| x - margin), high.map(|x| x + margin))
}

impl Bvh {
    /// Leaves hold at most `leaf_size` primitives (up to 255).
    pub fn build(primitives: &[Bounds], leaf_size: u32) -> Built {
        let mut nodes = Vec::new();
        let mut leaves = Vec::new();
        if primitives.is_empty() {
            let bvh = Bvh {
                nodes,
                bounds: ([0.0; 3], [0.0; 3]),
            };
            let order = Vec::new();
            return Built { bvh, order, leaves };
        }
        let parameters = BvhBuildParams {
            max_prims_per_leaf: leaf_size,
            // Sixteen primitives cost what one does, so leaves may be full.
            collapse_traversal_cost: leaf_size as f32,
            ..if primitives.len() < MANY {
                BvhBuildParams::medium_build()
            } else {
                BvhBuildParams::very_fast_build()
            }
        };
        let tree = build_bvh2(primitives, parameters, &mut Duration::default());
        // Nodes of the binary tree, in the order of those made of them.
        let mut sources = vec![0];
        while nodes.len() < sources.len() {
            let children = opened(&tree, sources[nodes.len()]);
            let mut node = EMPTY_NODE;
            for (slot, &child) in children.iter().enumerate() {
                let source = &tree.nodes[child];
                let (low, high) = widened(source.aabb());
                for axis in 0..3 {
                    node.planes[axis][0][slot] = low[axis];
                    node.planes[axis][1][slot] = high[axis];
                }
                node.children[slot] = if source.is_leaf() {
                    let first = source.first_index as usize;
                    leaves.push(first..first + source.prim_count as usize);
                    LEAF | (leaves.len() - 1) as u32
                } else {
                    sources.push(child);
                    (sources.len() - 1) as u32
                };
            }
            nodes.push(node);
        }
        let bounds = widened(tree.nodes[0].aabb());
        Built {
            bvh: Bvh { nodes, bounds },
            order: tree.primitive_indices,
            leaves,
        }
    }

    /// Takes `rays` to every leaf that they may meet, nearer ones first, until all are done. `stack` is
    /// scratch. `SHARED`: the packet is.
    #[inline(always)]
    pub fn walk<V: Vector, const SHARED: bool>(
        &self,
        vector: V,
        packet: &mut Packet,
        rays: u32,
        stack: &mut Stack,
        leaf: &mut impl Leaf,
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let floor = stack.len();
        stack.push((0, rays));
        while stack.len() > floor {
            let Some((reference, waiting)) = stack.pop() else {
                return;
            };
            let waiting = waiting & !packet.hit;
            if waiting == 0 {
                continue;
            }
            if reference & LEAF == 0 {
                self.descend::<V, SHARED>(vector, packet, waiting, reference as usize, stack);
            } else {
                leaf.visit(vector, packet, waiting, (reference & !LEAF) as usize);
                if rays & !packet.hit == 0 {
                    stack.truncate(floor);
                    return;
                }
            }
        }
    }

    /// Pushes the children of a node that any ray meets, the nearest last.
    #[inline(always)]
    fn descend<V: Vector, const SHARED: bool>(
        &self,
        vector: V,
        packet: &Packet,
        rays: u32,
        node: usize,
        stack: &mut Stack,
    ) {
        let node = &self.nodes[node];
        let slack = [vector.splat(-packet.slack), vector.splat(packet.slack)];
        let mut relative = [[[0.0; LANES]; 2]; 3];
        if SHARED {
            let origin = packet.origin_of(rays.trailing_zeros() as usize % LANES);
            for axis in 0..3 {
                for side in 0..2 {
                    let distance = distance(vector, &node.planes[axis][side], slack[side], origin[axis]);
                    vector.store(distance, &mut relative[axis][side]);
                }
            }
        }
        let mut child_rays = [0u32; LANES];
        let mut child_near = [0f32; LANES];
        let mut met = 0u32;
        for ray in lanes_of(rays) {
            let (mut near, mut far) = (vector.splat(0.0), vector.splat(packet.t_max[ray]));
            for axis in 0..3 {
                let inverse = vector.splat(packet.inverse[axis][ray]);
                let first = (packet.backward[axis] >> ray & 1) as usize;
                let last = 1 - first;
                let (entry, exit) = if SHARED {
                    (
                        vector.load(&relative[axis][first]),
                        vector.load(&relative[axis][last]),
                    )
                } else {
                    let (planes, origin) = (&node.planes[axis], packet.origin[axis][ray]);
                    (
                        distance(vector, &planes[first], slack[first], origin),
                        distance(vector, &planes[last], slack[last], origin),
                    )
                };
                near = vector.max(entry * inverse, near);
                far = vector.min(exit * inverse, far);
            }
            let children = vector.bits(vector.less_equal(near, far));
            let mut nears = [0.0; LANES];
            if children & !met != 0 {
                vector.store(near, &mut nears);
                for child in lanes_of(children & !met) {
                    child_near[child] = nears[child];
                }
            }
            met |= children;
            for child in lanes_of(children) {
                child_rays[child] |= 1 << ray;
            }
        }
        // Insertion sort, the nearest last. Distances are not negative, so their bits sort like numbers.
        let mut sorted = [0u64; LANES];
        let mut count = 0;
        for child in lanes_of(met) {
            let key = u64::from(child_near[child].to_bits()) << 32 | child as u64;
            let mut at = count;
            while at > 0 && sorted[at - 1] < key {
                sorted[at] = sorted[at - 1];
                at -= 1;
            }
            sorted[at] = key;
            count += 1;
        }
        for key in &sorted[..count] {
            let child = *key as usize % LANES;
            stack.push((node.children[child], child_rays[child]));
        }
    }
}

/// From an origin to widened planes.
#[inline(always)]
fn distance<V: Vector>(vector: V, planes: &Lanes, slack: V::Floats, origin: f32) -> V::Floats {
    vector.load(planes) + slack - vector.splat(origin)
}

/// A node's up to sixteen descendants: the largest inner one is opened until there is no room.
fn opened(tree: &Bvh2, node: usize) -> Vec<usize> {
    let mut children = vec![node];
    while children.len() < LANES {
        let inner = children
            .iter()
            .enumerate()
            .filter(|(_, c)| !tree.nodes[**c].is_leaf());
        let area = |c: usize| tree.nodes[c].aabb().half_area();
        let Some((slot, _)) = inner.max_by(|a, b| area(*a.1).total_cmp(&area(*b.1))) else {
            break;
        };
        let pair = tree.nodes[children[slot]].first_index as usize;
        children[slot] = pair;
        children.insert(slot + 1, pair + 1);
    }
    children
}

/// What each ray of a packet met.
#[derive(Clone, Copy)]
pub struct Met {
    /// The nearest hit, of rays that are asked for it; of several equally near the lowest (instance, triangle).
    pub instance: [u32; LANES],
    pub triangle: [u32; LANES],
    /// How it is decided for them whether what is partly opaque is there: by whose draw, at which pixel.
    pub draw: [Draw; LANES],
    pub pixel: [[i32; 2]; LANES],
    /// Of rays that end at any hit, the share that gets through what is partly opaque.
    pub through: Lanes,
}

impl Met {
    pub const NONE: Met = Met {
        instance: [u32::MAX; LANES],
        triangle: [u32::MAX; LANES],
        draw: [Draw { seed: 0, sample: 0 }; LANES],
        pixel: [[0; 2]; LANES],
        through: [1.0; LANES],
    };

    /// What gets through of a ray of `packet`.
    #[inline(always)]
    pub fn share(&self, packet: &Packet, ray: usize) -> f32 {
        if packet.hit >> ray & 1 == 0 {
            self.through[ray]
        } else {
            0.0
        }
    }
}
