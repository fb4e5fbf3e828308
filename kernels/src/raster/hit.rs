//! Where in a triangle a pixel's ray lands, in double precision, and what is there.

use super::camera::{Camera, Ray, Transform, winding_normal};
use super::simd::Lanes;
use super::tile::BLOCK_WIDTH;
use crate::geometry::{Data, Instance, Mesh};
use crate::vector::{Vec3, add, cross, dot, scale, sub};

/// Finds triangles by their ids, for one eye.
pub struct Finder<'a> {
    data: &'a Data,
    /// Id of each instance's first triangle.
    first_ids: &'a [u32],
    pub camera: &'a Camera,
    /// Of each instance, world axes.
    to_eye: Vec<Transform>,
}

impl<'a> Finder<'a> {
    pub fn new(data: &'a Data, first_ids: &'a [u32], camera: &'a Camera) -> Self {
        let to_eye = |instance: &Instance| camera.object_to_eye(&instance.matrix);
        Finder {
            data,
            first_ids,
            camera,
            to_eye: data.instances.iter().map(to_eye).collect(),
        }
    }

    fn index(&self, id: u32) -> usize {
        self.first_ids.partition_point(|&first| first <= id) - 1
    }

    /// Whose triangle `id` is, which counts triangles over all instances.
    pub fn instance(&self, id: u32) -> &Instance {
        &self.data.instances[self.index(id)]
    }

    pub fn find(&self, id: u32) -> Hit<'_> {
        let instance_index = self.index(id);
        let instance = &self.data.instances[instance_index];
        let to_eye = &self.to_eye[instance_index];
        let mesh = self.data.meshes[instance.mesh].as_ref();
        let triangle = (id - self.first_ids[instance_index]) as usize;
        let local = mesh.triangle_positions(triangle);
        let corners = local.map(|p| to_eye.point(p));
        let sides = [sub(corners[1], corners[0]), sub(corners[2], corners[0])];
        Hit {
            instance_index,
            instance,
            mesh,
            triangle,
            to_eye,
            corners,
            sides,
            meeting: meeting(self.camera, corners[0], sides),
            normal: normalised(to_eye.normal(winding_normal(local))),
        }
    }

    /// Sets the depths of a block's fragments that alpha clip cuts away to infinity; `pixel` is its first.
    #[inline(never)]
    pub fn cut(&self, depths: &mut Lanes<f32>, id: u32, pixel: [usize; 2]) {
        let hit = self.find(id);
        let cutout = &self.data.cutouts[hit.material() as usize];
        for (lane, depth) in depths.0.iter_mut().enumerate() {
            if depth.is_finite() {
                let at = [pixel[0] + lane % BLOCK_WIDTH, pixel[1] + lane / BLOCK_WIDTH];
                let weights = hit.weights(self.camera, at);
                if !cutout.is_opaque(hit.uv(weights)) {
                    *depth = f32::INFINITY;
                }
            }
        }
    }
}

/// A triangle ready to answer for pixels. World axes, relative to the eye.
pub struct Hit<'a> {
    pub instance_index: usize,
    pub instance: &'a Instance,
    pub triangle: usize,
    mesh: &'a Mesh,
    to_eye: &'a Transform,
    corners: [Vec3; 3],
    sides: [Vec3; 2],
    /// Of the pixel (1, x, y): weights of the second and the third corner, over the last row's value.
    meeting: [Vec3; 3],
    /// Unit normal by the winding; None where the triangle has no area.
    normal: Option<Vec3>,
}

fn normalised(v: Vec3) -> Option<Vec3> {
    let length = dot(v, v).sqrt();
    (length.is_finite() && length > 0.0).then(|| scale(v, 1.0 / length))
}

/// What [`Hit::weights`] is worked out with: where a ray meets a triangle (Möller and Trumbore), of which every
/// product but one with the pixel is the triangle's own.
fn meeting(camera: &Camera, corner: Vec3, [a, b]: [Vec3; 2]) -> [Vec3; 3] {
    let [right, up, forward] = camera.axes;
    let ([x, y], [dx, dy]) = (camera.first, camera.step);
    let linear = |origin: f64, of: Vec3| {
        let (across, along) = (dot(right, of), dot(up, of));
        [origin + x * across + y * along, dx * across, dy * along]
    };
    if camera.orthographic {
        let (p, q) = (cross(forward, b), cross(a, forward));
        [
            linear(-dot(corner, p), p),
            linear(-dot(corner, q), q),
            [dot(a, p), 0.0, 0.0],
        ]
    } else {
        let through = |of: Vec3| linear(dot(forward, of), of);
        [cross(corner, b), cross(a, corner), cross(b, a)].map(through)
    }
}

impl Hit<'_> {
    pub fn material(&self) -> u32 {
        let slot = self.mesh.triangle_slots.get(self.triangle).copied().unwrap_or(0);
        self.instance.material(slot)
    }

    /// Weights of the corners where a pixel's ray meets the triangle. A pixel that only snapping put inside
    /// gets the nearest point of the outline: weights never leave the triangle.
    #[inline(always)]
    pub fn weights(&self, camera: &Camera, pixel: [usize; 2]) -> Vec3 {
        let at = [1.0, pixel[0] as f64, pixel[1] as f64];
        let [u, v, all] = self.meeting.map(|row| dot(row, at));
        let inverse = 1.0 / all;
        let (u, v) = (u * inverse, v * inverse);
        let weights = [1.0 - u - v, u, v];
        if weights.iter().all(|&w| w >= 0.0 && w.is_finite()) {
            weights
        } else {
            self.nearest_on_outline(camera, &camera.ray(pixel[0], pixel[1]))
        }
    }

    /// The point of the outline that the ray passes nearest to, as seen from the eye.
    fn nearest_on_outline(&self, camera: &Camera, ray: &Ray) -> Vec3 {
        let forward = camera.axes[2];
        let across = |v: Vec3| {
            let along = dot(v, ray.direction) / dot(ray.direction, ray.direction);
            sub(v, scale(ray.direction, along))
        };
        let mut best = (f64::INFINITY, [1.0, 0.0, 0.0]);
        for i in 0..3 {
            let (j, start) = ((i + 1) % 3, sub(self.corners[i], ray.origin));
            let side = sub(self.corners[j], self.corners[i]);
            let (start_across, side_across) = (across(start), across(side));
            let (depth, slope) = (dot(self.corners[i], forward), dot(side, forward));
            let mut s = -dot(start_across, side_across) / dot(side_across, side_across);
            s = if s.is_finite() { s.clamp(0.0, 1.0) } else { 0.0 };
            if depth + s * slope < camera.near && slope != 0.0 {
                s = ((camera.near - depth) / slope).clamp(0.0, 1.0);
            }
            let off = add(start_across, scale(side_across, s));
            let away = if camera.orthographic {
                1.0
            } else {
                depth + s * slope
            };
            let distance = dot(off, off) / (away * away);
            if away > 0.0 && distance < best.0 {
                let mut weights = [0.0; 3];
                weights[i] = 1.0 - s;
                weights[j] = s;
                best = (distance, weights);
            }
        }
        best.1
    }

    /// Position relative to the eye, world axes.
    pub fn position(&self, weights: Vec3) -> Vec3 {
        let [_, u, v] = weights;
        add(
            self.corners[0],
            add(scale(self.sides[0], u), scale(self.sides[1], v)),
        )
    }

    pub fn uv(&self, weights: Vec3) -> [f32; 2] {
        if self.mesh.corner_uvs.is_empty() {
            return [0.0; 2];
        }
        let corners = self.mesh.triangles[self.triangle].map(|c| self.mesh.corner_uvs[c as usize]);
        std::array::from_fn(|k| (0..3).map(|i| f64::from(corners[i][k]) * weights[i]).sum::<f64>() as f32)
    }

    /// Unit normals, geometric and shading, in world axes. The geometric one faces the viewer, and the
    /// shading one is turned with it.
    pub fn normals(&self, ray: &Ray, weights: Vec3) -> [Vec3; 2] {
        let winding = self
            .normal
            .or_else(|| normalised(scale(ray.direction, -1.0)))
            .unwrap_or([0.0, 0.0, 1.0]);
        // A mirroring matrix turns winding and corner normals alike, so one turn is right for both.
        let turn = if dot(winding, ray.direction) > 0.0 {
            -1.0
        } else {
            1.0
        };
        let geometric = scale(winding, turn);
        if self.mesh.corner_normals.is_empty() {
            return [geometric, geometric];
        }
        let corners = self.mesh.triangles[self.triangle].map(|c| self.mesh.corner_normals[c as usize]);
        let local: Vec3 =
            std::array::from_fn(|k| (0..3).map(|i| f64::from(corners[i][k]) * weights[i]).sum::<f64>());
        let shading = normalised(scale(self.to_eye.normal(local), turn)).unwrap_or(geometric);
        [geometric, shading]
    }
}
