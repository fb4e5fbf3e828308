//! A packet's way through a scene.

use super::bvh::{Met, Stack};
use super::leaves::{InInstances, InTriangles};
use super::packet::Packet;
use super::scene::Scene;
use crate::simd::Vector;

/// Stacks of the walks, kept from packet to packet.
#[derive(Default)]
pub struct Scratch {
    outer: Stack,
    inner: Stack,
}

impl Scene {
    /// Traces a prepared packet: rays that something stops are marked in `packet.hit`, and of the others `met` says what
    /// gets through; or with `NEAREST` they end at their nearest hit, which is written to `met`. `casters` as in
    /// [`Scene::build`].
    #[inline(always)]
    pub fn trace<V: Vector, const NEAREST: bool>(
        &self,
        vector: V,
        casters: &[u8],
        packet: &mut Packet,
        scratch: &mut Scratch,
        met: &mut Met,
    ) {
        if packet.shared {
            self.walk::<V, true, NEAREST>(vector, casters, packet, scratch, met);
        } else {
            self.walk::<V, false, NEAREST>(vector, casters, packet, scratch, met);
        }
    }

    #[inline(always)]
    fn walk<V: Vector, const SHARED: bool, const NEAREST: bool>(
        &self,
        vector: V,
        casters: &[u8],
        packet: &mut Packet,
        scratch: &mut Scratch,
        met: &mut Met,
    ) {
        let Scratch { outer, inner } = scratch;
        let rays = packet.set;
        let mut flat = InTriangles::<SHARED, NEAREST> {
            scene: self,
            blocks: &self.flat.blocks,
            instance: None,
            casters,
            met,
        };
        self.flat
            .bvh
            .walk::<V, SHARED>(vector, packet, rays, outer, &mut flat);
        let rays = rays & !packet.hit;
        if !self.placed.is_empty() && rays != 0 {
            let mut placed = InInstances::<SHARED, NEAREST> {
                scene: self,
                casters,
                met,
                stack: inner,
            };
            self.top
                .walk::<V, SHARED>(vector, packet, rays, outer, &mut placed);
        }
    }
}
