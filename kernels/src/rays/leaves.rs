//! What a walk does when it comes to triangles, or to an instance of a tree of its own.

use super::bvh::{Leaf, Met, Stack};
use super::clear::Clear;
use super::packet::{Packet, lanes_of};
use super::scene::{Matrix, Scene};
use super::triangle::Block;
use crate::simd::{LANES, Vector};

/// Leaves of triangles: those of one instance, or with `None` each of its own. `SHARED`: the packet is;
/// `NEAREST`: rays go on to their nearest hit instead of ending at any.
pub struct InTriangles<'a, const SHARED: bool, const NEAREST: bool> {
    pub scene: &'a Scene,
    pub blocks: &'a [Block],
    pub instance: Option<u32>,
    pub casters: &'a [u8],
    pub met: &'a mut Met,
}

impl<const SHARED: bool, const NEAREST: bool> InTriangles<'_, SHARED, NEAREST> {
    #[inline(always)]
    fn casts(&self, instance: u32) -> bool {
        self.casters.is_empty() || self.casters[instance as usize] != 0
    }

    /// Of the triangles `hit` in a block, those that cast.
    #[inline(always)]
    fn casting(&self, block: &Block, hit: u32) -> u32 {
        if block.instance.is_some() {
            return hit; // none of it was looked at otherwise
        }
        lanes_of(hit).fold(0, |mask, lane| {
            mask | u32::from(self.casts(block.instances[lane])) << lane
        })
    }
}

impl<const SHARED: bool, const NEAREST: bool> Leaf for InTriangles<'_, SHARED, NEAREST> {
    #[inline(always)]
    fn visit<V: Vector>(&mut self, vector: V, packet: &mut Packet, rays: u32, leaf: usize) {
        let block = &self.blocks[leaf];
        if block.instance.is_some_and(|instance| !self.casts(instance)) {
            return;
        }
        let mut origin = packet.origin_of(rays.trailing_zeros() as usize % LANES);
        let mut seen = block.seen_from(vector, origin, packet);
        for ray in lanes_of(rays) {
            if !SHARED && origin != packet.origin_of(ray) {
                origin = packet.origin_of(ray);
                seen = block.seen_from(vector, origin, packet);
            }
            let d = &packet.direction;
            // As far as the hit so far, and not just before it: of equal ones the rule below decides.
            let met = NEAREST && self.met.instance[ray] != u32::MAX;
            let t_max = packet.t_max[ray];
            let end = if met { t_max.next_up() } else { t_max };
            let hits = seen.intersect(vector, [d[0][ray], d[1][ray], d[2][ray]], end);
            let mut hit = self.casting(block, hits.hit);
            if hit & block.clear != 0 {
                let mut weights = [[0.0; LANES]; 3];
                for edge in 0..3 {
                    vector.store(hits.weights[edge], &mut weights[edge]);
                }
                let clear = Clear {
                    scene: self.scene,
                    block,
                    instance: self.instance,
                    weights: &weights,
                };
                hit = if NEAREST {
                    clear.drawn(hit, self.met.draw[ray], self.met.pixel[ray])
                } else {
                    clear.stopping(hit, &mut self.met.through[ray])
                };
            }
            if hit == 0 {
                continue;
            }
            if NEAREST {
                let mut t = [0.0; LANES];
                vector.store(hits.t, &mut t);
                for lane in lanes_of(hit) {
                    let id = (
                        self.instance.unwrap_or(block.instances[lane]),
                        block.triangles[lane],
                    );
                    let kept = (self.met.instance[ray], self.met.triangle[ray]);
                    let t_max = &mut packet.t_max[ray];
                    // Whatever the order of the tree, the lowest (instance, triangle) of those equally near, as in
                    // the rasteriser.
                    if t[lane] < *t_max || t[lane] == *t_max && id < kept {
                        *t_max = t[lane];
                        (self.met.instance[ray], self.met.triangle[ray]) = id;
                    }
                }
            } else {
                packet.hit |= 1 << ray;
            }
        }
    }
}

/// Leaves of instances, whose own trees are walked in their object space.
pub struct InInstances<'a, const SHARED: bool, const NEAREST: bool> {
    pub scene: &'a Scene,
    pub casters: &'a [u8],
    pub met: &'a mut Met,
    pub stack: &'a mut Stack,
}

impl<const SHARED: bool, const NEAREST: bool> Leaf for InInstances<'_, SHARED, NEAREST> {
    #[inline(always)]
    fn visit<V: Vector>(&mut self, vector: V, packet: &mut Packet, rays: u32, leaf: usize) {
        let placed = &self.scene.placed[leaf];
        if !self.casters.is_empty() && self.casters[placed.instance as usize] == 0 {
            return;
        }
        let tree = &self.scene.trees[placed.tree];
        let mut local = packet_in_object(packet, &placed.inverse);
        let mut triangles = InTriangles::<SHARED, NEAREST> {
            scene: self.scene,
            blocks: &tree.blocks,
            instance: Some(placed.instance),
            casters: &[],
            met: self.met,
        };
        tree.bvh
            .walk::<V, SHARED>(vector, &mut local, rays, self.stack, &mut triangles);
        packet.hit |= local.hit;
        packet.t_max = local.t_max;
    }
}

#[inline(always)]
fn packet_in_object(packet: &Packet, inverse: &Matrix) -> Packet {
    let mut local = *packet;
    for axis in 0..3 {
        let row = inverse[axis];
        for lane in 0..LANES {
            let o = packet.origin.map(|o| f64::from(o[lane]));
            let d = packet.direction.map(|d| f64::from(d[lane]));
            local.origin[axis][lane] = (row[0] * o[0] + row[1] * o[1] + row[2] * o[2] + row[3]) as f32;
            local.direction[axis][lane] = (row[0] * d[0] + row[1] * d[1] + row[2] * d[2]) as f32;
        }
    }
    local.prepare();
    local
}
