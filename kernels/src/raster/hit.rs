//! Where in a triangle a pixel's ray lands, in double precision, and what is there.

use super::block::Block;
use super::camera::{Camera, Ray, Transform, winding_normal};
use super::lift::Lifting;
use super::places::Places;
use super::presence::Rule;
use super::wide::{Pixels, WIDE, Wide, Wide3, lane, wide, wide_dot};
use crate::geometry::{Data, Instance, Mesh};
use crate::vector::{Vec3, add, cross, dot, scale, sub};

/// Finds triangles by their ids, for one eye.
pub struct Finder<'a> {
    data: &'a Data,
    /// Id of each instance's first triangle.
    first_ids: &'a [u32],
    pub camera: &'a Camera,
    rule: Rule,
    /// None: pixels are sampled at their centres.
    pub places: Option<&'a Places>,
    /// Of each instance, world axes.
    to_eye: Vec<Transform>,
}

impl<'a> Finder<'a> {
    pub fn new(
        data: &'a Data,
        first_ids: &'a [u32],
        camera: &'a Camera,
        rule: Rule,
        places: Option<&'a Places>,
    ) -> Self {
        let to_eye = |instance: &Instance| camera.object_to_eye(&instance.matrix);
        Finder {
            data,
            first_ids,
            camera,
            rule,
            places,
            to_eye: data.instances.iter().map(to_eye).collect(),
        }
    }

    /// Neighbouring pixels of a row, where they are sampled.
    #[inline(always)]
    pub fn pixels(&self, first: [i32; 2], wanted: [bool; WIDE]) -> Pixels {
        self.places.map_or_else(
            || Pixels::new(first, wanted),
            |places| places.pixels(first, wanted),
        )
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
            corner_normals: (!mesh.corner_normals.is_empty())
                .then(|| mesh.triangles[triangle].map(|c| mesh.corner_normals[c as usize].map(f64::from))),
        }
    }

    /// Sets the depths of a block's fragments that are not there to infinity; `pixel` is its first.
    #[inline(never)]
    pub fn cut(&self, depths: &mut Block<f32>, id: u32, pixel: [i32; 2]) {
        let hit = self.find(id);
        let material = &self.data.materials[hit.material() as usize];
        // A map looks from the light, and a ray of a shadow towards it: that meets the other side.
        let is_back = hit.shows_back(self.camera) == self.rule.is_camera;
        let opacity = &self.rule.sides(material)[usize::from(is_back)];
        let uniform = opacity.uniform();
        let triangle = [hit.instance_index, hit.triangle];
        for (row, depths) in depths.0.as_chunks_mut::<WIDE>().0.iter_mut().enumerate() {
            let wanted = depths.map(f32::is_finite);
            if wanted == [false; WIDE] {
                continue;
            }
            let pixels = self.pixels([pixel[0], pixel[1] + row as i32], wanted);
            let found = if let Some(opacity) = uniform {
                [opacity; WIDE]
            } else {
                let weights = hit.weights(self.camera, pixels);
                let ([u, v], factors) = (hit.uvs(&weights), hit.factors(&weights));
                std::array::from_fn(|l| opacity.at([u[l] as f32, v[l] as f32], factors[l] as f32))
            };
            for (l, depth) in depths.iter_mut().enumerate() {
                let place = [pixels.first[0] + l as i32, pixels.first[1]];
                if wanted[l] && !self.rule.keeps(found[l], triangle, place) {
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
    /// Shading normals of the corners, object space; None where the mesh is flat.
    corner_normals: Option<[Vec3; 3]>,
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
        self.instance.material(self.mesh.slot(self.triangle))
    }

    /// Whether the eye is behind it.
    fn shows_back(&self, camera: &Camera) -> bool {
        let towards = if camera.orthographic {
            camera.axes[2]
        } else {
            self.corners[0]
        };
        let is_behind = self.normal.is_some_and(|normal| dot(normal, towards) > 0.0);
        is_behind != self.instance.is_mirrored
    }

    /// Weights of the corners where each pixel's ray meets the triangle. A pixel that only snapping put inside
    /// gets the nearest point of the outline: weights never leave the triangle.
    #[inline(always)]
    pub fn weights(&self, camera: &Camera, pixels: Pixels) -> Wide3 {
        let [u, v, all] = self.meeting.map(|row| pixels.affine(row));
        let inverse = wide(|l| 1.0 / all[l]);
        let (u, v) = (wide(|l| u[l] * inverse[l]), wide(|l| v[l] * inverse[l]));
        let mut weights = [wide(|l| 1.0 - u[l] - v[l]), u, v];
        // At least 0 and finite: NaN is not, and the three make one, so that none is infinite alone.
        let inside: [bool; WIDE] = std::array::from_fn(|l| {
            let [w, u, v] = lane(&weights, l);
            (w >= 0.0) & (u >= 0.0) & (v >= 0.0) & (u < f64::INFINITY) & (v < f64::INFINITY)
        });
        if inside != [true; WIDE] {
            for l in (0..WIDE).filter(|&l| pixels.wanted[l] && !inside[l]) {
                let nearest = self.nearest_on_outline(camera, &camera.ray([pixels.x[l], pixels.y[l]]));
                for (weight, nearest) in weights.iter_mut().zip(nearest) {
                    weight[l] = nearest;
                }
            }
        }
        weights
    }

    /// The point of the outline that the ray passes nearest to, as seen from the eye.
    #[inline(never)]
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

    /// Positions relative to the eye, world axes.
    #[inline(always)]
    pub fn positions(&self, weights: &Wide3) -> Wide3 {
        let [_, u, v] = weights;
        std::array::from_fn(|k| {
            wide(|l| self.corners[0][k] + (self.sides[0][k] * u[l] + self.sides[1][k] * v[l]))
        })
    }

    #[inline(always)]
    pub fn uvs(&self, weights: &Wide3) -> [Wide; 2] {
        if self.mesh.corner_uvs.is_empty() {
            return [[0.0; WIDE]; 2];
        }
        let corners = self.mesh.triangles[self.triangle].map(|c| self.mesh.corner_uvs[c as usize]);
        std::array::from_fn(|k| wide_dot(corners.map(|corner| f64::from(corner[k])), weights))
    }

    /// What colours by corner are multiplied by; 1 where the mesh has none.
    pub fn colours(&self, weights: &Wide3) -> Wide3 {
        if self.mesh.corner_colours.is_empty() {
            return [[1.0; WIDE]; 3];
        }
        let corners = self.mesh.triangles[self.triangle].map(|c| self.mesh.corner_colours[c as usize]);
        std::array::from_fn(|k| wide_dot(corners.map(|corner| f64::from(corner[k])), weights))
    }

    /// What opacities by corner are multiplied by.
    fn factors(&self, weights: &Wide3) -> Wide {
        if self.mesh.corner_opacity.is_empty() {
            return [1.0; WIDE];
        }
        let corners = self.mesh.triangles[self.triangle].map(|c| self.mesh.corner_opacity[c as usize]);
        wide_dot(corners.map(f64::from), weights)
    }

    /// Where rays of shadows may begin above it; None where the mesh is flat.
    pub fn lifting(&self) -> Option<Lifting> {
        let corners = self
            .mesh
            .triangle_positions(self.triangle)
            .map(|p| p.map(f64::from));
        Some(Lifting::new(corners, self.corner_normals?, &self.to_eye.linear))
    }

    /// Unit normals, geometric and shading, in world axes. The geometric one faces the viewer, and the
    /// shading one is turned with it.
    #[inline(always)]
    pub fn normals(&self, camera: &Camera, pixels: Pixels, weights: &Wide3) -> [Wide3; 2] {
        let directions = camera.directions(pixels);
        let winding: Wide3 = self.normal.map_or_else(
            || {
                let towards: [Vec3; WIDE] = std::array::from_fn(|l| {
                    normalised(scale(lane(&directions, l), -1.0)).unwrap_or([0.0, 0.0, 1.0])
                });
                std::array::from_fn(|k| wide(|l| towards[l][k]))
            },
            |normal| normal.map(|x| [x; WIDE]),
        );
        // A mirroring matrix turns winding and corner normals alike, so one turn is right for both.
        let turn = wide(|l| {
            let along = dot(lane(&winding, l), lane(&directions, l));
            if along > 0.0 { -1.0 } else { 1.0 }
        });
        let geometric = winding.map(|x| wide(|l| x[l] * turn[l]));
        let Some(corners) = self.corner_normals else {
            return [geometric, geometric];
        };
        let local: Wide3 = std::array::from_fn(|k| wide_dot(corners.map(|corner| corner[k]), weights));
        let turned = self.to_eye.cofactors.map(|row| {
            let of = wide_dot(row, &local);
            wide(|l| of[l] * turn[l])
        });
        let length = wide(|l| dot(lane(&turned, l), lane(&turned, l)).sqrt());
        let inverse = wide(|l| 1.0 / length[l]);
        let is_vector = length.map(|x| x > 0.0 && x < f64::INFINITY);
        let shading = std::array::from_fn(|k| {
            wide(|l| {
                let unit = turned[k][l] * inverse[l];
                if is_vector[l] { unit } else { geometric[k][l] }
            })
        });
        [geometric, shading]
    }
}
