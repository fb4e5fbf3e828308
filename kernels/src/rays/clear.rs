//! Rays at triangles that something may get through: what is stopped, and what is seen.

use super::packet::lanes_of;
use super::scene::Scene;
use super::triangle::Block;
use crate::geometry::{Mesh, Sides};
use crate::random::Draw;
use crate::simd::Lanes;

/// Of a ray's light less than this is none.
const LEAST: f32 = 1e-4;

/// A block's triangles as a ray hits them.
pub struct Clear<'a> {
    pub scene: &'a Scene,
    pub block: &'a Block,
    /// Whose all of them are; `None`: each of its own.
    pub instance: Option<u32>,
    /// Unnormalised, of corners 2, 0 and 1.
    pub weights: &'a [Lanes; 3],
}

impl Clear<'_> {
    /// Of the triangles `hit` (one bit a lane), those that stop the ray; what gets through the others multiplies
    /// `through`. All of them once there is next to nothing left.
    #[inline(never)]
    pub fn stopping(&self, hit: u32, through: &mut f32) -> u32 {
        let mut stopping = hit;
        for lane in lanes_of(hit & self.block.clear) {
            let opacity = self.opacity(lane, false);
            if opacity < 1.0 {
                stopping &= !(1 << lane);
                *through *= 1.0 - opacity;
            }
        }
        if *through < LEAST { hit } else { stopping }
    }

    /// Of the triangles `hit`, those that a view ray finds there.
    #[inline(never)]
    pub fn drawn(&self, hit: u32, draw: Draw, pixel: [i32; 2]) -> u32 {
        let mut drawn = hit;
        for lane in lanes_of(hit & self.block.clear) {
            let opacity = self.opacity(lane, true);
            let triangle = [self.instance_of(lane), self.block.triangles[lane] as usize];
            if opacity < 1.0 && !draw.of_triangle(triangle).is_there(pixel, opacity) {
                drawn &= !(1 << lane);
            }
        }
        drawn
    }

    fn instance_of(&self, lane: usize) -> usize {
        self.instance.unwrap_or(self.block.instances[lane]) as usize
    }

    /// Where the ray hits a triangle, for cameras or for shadow rays; 0 where a neighbour has the place.
    fn opacity(&self, lane: usize, is_camera: bool) -> f32 {
        let data = &self.scene.data;
        let instance = &data.instances[self.instance_of(lane)];
        let mesh = data.meshes[instance.mesh].as_ref();
        let triangle = self.block.triangles[lane] as usize;
        let material = data.material(instance, triangle);
        let sides: &Sides = if is_camera {
            &material.seen
        } else {
            &material.casts
        };
        // Their sum has the sign of the ray's way against the normal.
        let weights = [0, 1, 2].map(|edge: usize| self.weights[edge][lane]);
        let sum = weights[0] + weights[1] + weights[2];
        // Triangles of a tree of their own are in object space, where the front is.
        let is_turned = self.instance.is_none() && instance.is_mirrored;
        let opacity = &sides[usize::from((sum < 0.0) != is_turned)];
        if opacity.uniform() == Some(1.0) {
            return 1.0;
        }
        if !owns(mesh, triangle, weights, sum) {
            return 0.0;
        }
        if let Some(opacity) = opacity.uniform() {
            return opacity;
        }
        let (mut uv, mut factor) = ([0.0; 2], 0.0);
        for (&corner, weight) in mesh.triangles[triangle].iter().zip([1, 2, 0]) {
            let (corner, share) = (corner as usize, weights[weight] / sum);
            if let Some(at) = mesh.corner_uvs.get(corner) {
                uv[0] += at[0] * share;
                uv[1] += at[1] * share;
            }
            factor += mesh
                .corner_opacity
                .get(corner)
                .map_or(share, |factor| factor * share);
        }
        opacity.at(uv, factor)
    }
}

/// Whether a triangle has the place where a ray hits it, and no neighbour does: hits reach beyond edges by
/// what is rounded, so that nothing leaks between opaque ones, and what is partly opaque must count once.
/// The product of a ray with an edge has just the other sign for the neighbour; of one that is 0 the edge's
/// direction decides.
fn owns(mesh: &Mesh, triangle: usize, weights: [f32; 3], sum: f32) -> bool {
    let corners = mesh.triangle_positions(triangle);
    (0..3).all(|edge| {
        let along = weights[edge] * sum;
        along > 0.0 || (along == 0.0 && corners[edge] < corners[(edge + 1) % 3])
    })
}
