//! Meshes, how opaque they are, and where they stand.

use super::topology::Topology;
use std::sync::{Arc, OnceLock};

/// Triangles in object space. Corners, not vertices, carry normals and uv.
pub struct Mesh {
    pub positions: Vec<[f32; 3]>,
    /// Vertex of each corner, as Blender stores polygons.
    pub corner_vertices: Vec<u32>,
    /// Corners of each triangle: indices into the corner arrays.
    pub triangles: Vec<[u32; 3]>,
    /// Unit shading normals, one a corner; empty: the mesh is flat.
    pub corner_normals: Vec<[f32; 3]>,
    /// One a corner; empty where nothing samples them.
    pub corner_uvs: Vec<[f32; 2]>,
    /// What opacities that are `by_corner` are multiplied by, one a corner; empty: 1.
    pub corner_opacity: Vec<f32>,
    /// What colours that are by corner are multiplied by, one a corner; empty: 1.
    pub corner_colours: Vec<[f32; 3]>,
    /// Material slot of each triangle; empty: slot 0 throughout.
    pub triangle_slots: Vec<u32>,
    pub(super) topology: OnceLock<Topology>,
}

impl Mesh {
    /// What touches what; worked out once for all the geometries that hold the mesh.
    pub fn topology(&self) -> &Topology {
        self.topology
            .get_or_init(|| Topology::of(&self.positions, &self.corner_vertices, &self.triangles))
    }

    pub fn triangle_positions(&self, triangle: usize) -> [[f32; 3]; 3] {
        self.triangles[triangle].map(|corner| self.positions[self.corner_vertices[corner as usize] as usize])
    }

    pub fn slot(&self, triangle: usize) -> u32 {
        self.triangle_slots.get(triangle).copied().unwrap_or(0)
    }
}

/// How much of what meets one side of a surface is stopped: 1 all of it, 0 nothing.
pub struct Opacity {
    /// Where there is no texture.
    pub value: f32,
    /// Row 0 at the bottom, repeated outside 0..1, bilinear; empty: `value` throughout.
    pub texels: Vec<f32>,
    pub width: usize,
    pub height: usize,
    /// Whether it is multiplied by the mesh's `corner_opacity`.
    pub by_corner: bool,
    /// Above 0: 1 where the opacity is at least this, else 0.
    pub threshold: f32,
}

impl Opacity {
    pub const WHOLE: Opacity = Opacity {
        value: 1.0,
        texels: Vec::new(),
        width: 0,
        height: 0,
        by_corner: false,
        threshold: 0.0,
    };

    /// In 0 to 1, at texture coordinates `uv` and where corners' factors are `factor`; what is no number is 0.
    pub fn at(&self, uv: [f32; 2], factor: f32) -> f32 {
        let base = if self.texels.is_empty() {
            self.value
        } else {
            self.sample(uv)
        };
        let opacity = if self.by_corner { base * factor } else { base };
        if self.threshold > 0.0 {
            f32::from(opacity >= self.threshold)
        } else if opacity > 0.0 {
            opacity.min(1.0)
        } else {
            0.0
        }
    }

    /// The opacity where it is the same all over, so that nothing need be interpolated.
    pub fn uniform(&self) -> Option<f32> {
        (self.texels.is_empty() && !self.by_corner).then(|| self.at([0.0; 2], 1.0))
    }

    /// Whether it is 1 or 0 everywhere.
    pub fn is_clip(&self) -> bool {
        self.threshold > 0.0
    }

    fn sample(&self, uv: [f32; 2]) -> f32 {
        let (w, h) = (self.width as f32, self.height as f32);
        let (x, y) = (uv[0].rem_euclid(1.0) * w - 0.5, uv[1].rem_euclid(1.0) * h - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let at = |ix: f32, iy: f32| {
            let column = (ix as i64).rem_euclid(self.width as i64) as usize;
            let row = (iy as i64).rem_euclid(self.height as i64) as usize;
            self.texels[row * self.width + column]
        };
        let bottom = at(x0, y0) * (1.0 - fx) + at(x0 + 1.0, y0) * fx;
        let top = at(x0, y0 + 1.0) * (1.0 - fx) + at(x0 + 1.0, y0 + 1.0) * fx;
        bottom * (1.0 - fy) + top * fy
    }
}

/// Opacities of the front, which is where corners go round counter-clockwise, and of the back.
pub type Sides = [Arc<Opacity>; 2];

pub struct Material {
    /// What cameras meet.
    pub seen: Sides,
    /// What shadow rays and shadow maps meet.
    pub casts: Sides,
}

impl Material {
    /// Whether nothing gets through anywhere.
    pub fn is_whole(&self) -> bool {
        let whole = |opacity: &Arc<Opacity>| opacity.uniform() == Some(1.0);
        self.seen.iter().chain(&self.casts).all(whole)
    }
}

pub struct Instance {
    pub mesh: usize,
    /// Object to world, row-major; the last row is 0 0 0 1.
    pub matrix: [[f64; 4]; 3],
    pub object_id: i32,
    /// Whether the matrix turns the winding round: the front stays where it is in object space, as in Cycles.
    pub is_mirrored: bool,
    /// Material (index into [`Data::materials`]) of each slot; slots beyond the end use the last.
    pub slot_materials: Vec<u32>,
}

impl Instance {
    pub fn material(&self, slot: u32) -> u32 {
        self.slot_materials[(slot as usize).min(self.slot_materials.len() - 1)]
    }
}

#[derive(Default)]
pub struct Data {
    pub meshes: Vec<Arc<Mesh>>,
    pub instances: Vec<Instance>,
    pub materials: Vec<Material>,
}

impl Data {
    /// Of an instance's triangle.
    pub fn material(&self, instance: &Instance, triangle: usize) -> &Material {
        let slot = self.meshes[instance.mesh].slot(triangle);
        &self.materials[instance.material(slot) as usize]
    }
}
