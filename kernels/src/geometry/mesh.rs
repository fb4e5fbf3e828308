//! Meshes, what cuts holes into them, and where they stand.

use super::topology::Topology;
use std::sync::{Arc, OnceLock};

/// Triangles in object space. Corners, not vertices, carry normals and uv.
pub struct Mesh {
    pub positions: Vec<[f32; 3]>,
    /// Vertex of each corner, as Blender stores polygons.
    pub corner_vertices: Vec<u32>,
    /// Corners of each triangle: indices into the three corner arrays.
    pub triangles: Vec<[u32; 3]>,
    /// Unit shading normals, one a corner; empty: the mesh is flat.
    pub corner_normals: Vec<[f32; 3]>,
    /// One a corner; empty where nothing samples them.
    pub corner_uvs: Vec<[f32; 2]>,
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
}

/// The part of a material that decides whether a fragment is there at all (alpha clip).
pub struct Cutout {
    /// A fragment is there where its alpha is at least this; 0 or less: everywhere.
    pub threshold: f32,
    /// Alpha where there is no texture.
    pub alpha: f32,
    /// Alpha texels, row 0 at the bottom, repeated outside 0..1, bilinear; empty: `alpha` throughout.
    pub texels: Vec<f32>,
    pub width: usize,
    pub height: usize,
}

impl Cutout {
    /// Whether a fragment with these texture coordinates is there.
    pub fn is_opaque(&self, uv: [f32; 2]) -> bool {
        if self.threshold <= 0.0 {
            return true;
        }
        if self.texels.is_empty() {
            self.alpha >= self.threshold
        } else {
            self.sample(uv) >= self.threshold
        }
    }

    /// Whether the answer is the same everywhere, so that no uv need be interpolated.
    pub fn is_uniform(&self) -> bool {
        self.threshold <= 0.0 || self.texels.is_empty()
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

pub struct Instance {
    pub mesh: usize,
    /// Object to world, row-major; the last row is 0 0 0 1.
    pub matrix: [[f64; 4]; 3],
    pub object_id: i32,
    /// Material (index into [`Data::cutouts`]) of each slot; slots beyond the end use the last.
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
    pub cutouts: Vec<Cutout>,
}
