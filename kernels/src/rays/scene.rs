//! Geometry prepared for rays: one tree over everything that was flattened, and a tree of instances.

use super::bvh::{Bounds, Built, Bvh};
use super::packet::WIDENING;
use super::triangle::{Block, Triangle};
use crate::geometry::{Data, Instance, Mesh};
use crate::simd::LANES;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Meshes used several times are copied into the flat tree as long as it stays below this many triangles
/// (some 100 bytes each, with their share of the tree): one tree is faster to walk than two levels.
const FLAT_BUDGET: usize = 4_000_000;

/// Points or triangles below which handing them out costs more than it gains: scenes have thousands of small
/// meshes.
const WORTH_A_THREAD: usize = 4096;

/// What references to leaves can number.
const MAX_PRIMITIVES: usize = 1 << 31;

/// A tree over triangles; each leaf is a block.
pub struct Triangles {
    pub bvh: Bvh,
    pub blocks: Vec<Block>,
    count: usize,
}

impl Triangles {
    fn build(triangles: &[Triangle]) -> Self {
        let bounds: Vec<Bounds> = triangles
            .par_iter()
            .map(|t| {
                let over = |f: fn(f32, f32) -> f32| {
                    [0, 1, 2].map(|axis| f(f(t.corners[0][axis], t.corners[1][axis]), t.corners[2][axis]))
                };
                Bounds(over(f32::min), over(f32::max))
            })
            .collect();
        let Built { bvh, order, leaves } = Bvh::build(&bounds, LANES as u32);
        let block = |leaf: Range<usize>| Block::new(order[leaf].iter().map(|&i| triangles[i as usize]));
        Triangles {
            bvh,
            blocks: leaves.into_par_iter().map(block).collect(),
            count: triangles.len(),
        }
    }
}

/// An instance that was not flattened.
pub struct Placed {
    pub instance: u32,
    pub tree: usize,
    /// Relative to the origin, to object space relative to the tree's own centre; in float64.
    pub inverse: Matrix,
}

pub struct Scene {
    pub origin: [f64; 3],
    pub data: Arc<Data>,
    pub flat: Triangles,
    pub trees: Vec<Triangles>,
    pub placed: Vec<Placed>,
    pub top: Bvh,
}

/// The upper three rows, row-major.
pub type Matrix = [[f64; 4]; 3];

fn apply(m: &Matrix, p: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| m[i][0] * p[0] + m[i][1] * p[1] + m[i][2] * p[2] + m[i][3])
}

/// None for a singular matrix.
fn inverted(m: &Matrix) -> Option<Matrix> {
    let minor = |r0: usize, c0: usize, r1: usize, c1: usize| m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0];
    let adjugate = [
        [minor(1, 1, 2, 2), -minor(0, 1, 2, 2), minor(0, 1, 1, 2)],
        [-minor(1, 0, 2, 2), minor(0, 0, 2, 2), -minor(0, 0, 1, 2)],
        [minor(1, 0, 2, 1), -minor(0, 0, 2, 1), minor(0, 0, 1, 1)],
    ];
    let determinant = m[0][0] * adjugate[0][0] + m[0][1] * adjugate[1][0] + m[0][2] * adjugate[2][0];
    let scale = m
        .iter()
        .map(|row| row[..3].iter().fold(0.0, |s: f64, x| s.max(x.abs())))
        .product::<f64>();
    // The negation also turns away NaN.
    #[allow(clippy::neg_cmp_op_on_partial_ord)]
    if !(determinant.abs() > 1e-12 * scale) || !determinant.is_normal() {
        return None;
    }
    let mut result = [[0.0; 4]; 3];
    for row in 0..3 {
        for column in 0..3 {
            result[row][column] = adjugate[row][column] / determinant;
        }
        result[row][3] = -(result[row][0] * m[0][3] + result[row][1] * m[1][3] + result[row][2] * m[2][3]);
    }
    Some(result)
}

/// Whether something may get through triangles of an instance, by material slot.
fn clear_slots(data: &Data, instance: &Instance) -> Vec<bool> {
    let is_clear = |&m: &u32| !data.materials[m as usize].is_whole();
    instance.slot_materials.iter().map(is_clear).collect()
}

fn is_clear(mesh: &Mesh, slots: &[bool], triangle: usize) -> bool {
    slots[(mesh.slot(triangle) as usize).min(slots.len() - 1)]
}

/// Triangles of instances: index, and matrix relative to the origin.
fn flattened_triangles(data: &Data, parts: &[(usize, Matrix)]) -> Vec<Triangle> {
    let of_part = |&(index, matrix): &(usize, Matrix)| {
        let slots = clear_slots(data, &data.instances[index]);
        let mesh = &data.meshes[data.instances[index].mesh];
        let place = move |p: &[f32; 3]| apply(&matrix, p.map(f64::from));
        let points = mesh.positions.par_iter().with_min_len(WORTH_A_THREAD).map(place);
        let points: Vec<[f64; 3]> = points.collect();
        (0..mesh.triangles.len())
            .into_par_iter()
            .with_min_len(WORTH_A_THREAD)
            .filter_map(move |t| {
                let corners = mesh.triangles[t].map(|c| points[mesh.corner_vertices[c as usize] as usize]);
                Triangle::new(corners, index as u32, t as u32, is_clear(mesh, &slots, t))
            })
    };
    parts.par_iter().flat_map(of_part).collect()
}

impl Scene {
    /// `casters`: one a instance, zero leaves the instance out; empty: all are in.
    pub fn build(data: Arc<Data>, origin: [f64; 3], casters: &[u8]) -> Result<Self, &'static str> {
        let mut users = vec![0usize; data.meshes.len()];
        let is_in = |index: usize| casters.is_empty() || casters[index] != 0;
        for (index, instance) in data.instances.iter().enumerate() {
            users[instance.mesh] += usize::from(is_in(index));
        }
        // Single-use meshes first, then the others, the smallest totals first, as far as the budget goes.
        let mut order: Vec<usize> = (0..users.len()).filter(|&m| users[m] > 0).collect();
        let total = |mesh: usize| users[mesh] * data.meshes[mesh].triangles.len();
        order.sort_by_key(|&mesh| (users[mesh] > 1, total(mesh)));
        let mut flattened = vec![false; users.len()];
        let mut sum = 0;
        for mesh in order {
            sum += total(mesh);
            flattened[mesh] = users[mesh] == 1 || sum <= FLAT_BUDGET;
        }

        let mut parts = Vec::new();
        let mut trees = Vec::new();
        let mut tree_of_mesh: Vec<Option<(usize, [f64; 3])>> = vec![None; users.len()];
        let mut placed = Vec::new();
        let mut boxes = Vec::new();
        for (index, instance) in data.instances.iter().enumerate().filter(|(i, _)| is_in(*i)) {
            let mut matrix = instance.matrix;
            for row in 0..3 {
                matrix[row][3] -= origin[row];
            }
            let Some(inverse) = inverted(&matrix) else {
                continue;
            };
            let mesh = &data.meshes[instance.mesh];
            if flattened[instance.mesh] {
                parts.push((index, matrix));
                continue;
            }
            let (tree, centre) = *tree_of_mesh[instance.mesh].get_or_insert_with(|| {
                let users = data.instances.iter().filter(|other| other.mesh == instance.mesh);
                let slots: Vec<Vec<bool>> = users.map(|other| clear_slots(&data, other)).collect();
                let (tree, centre) = build_tree(mesh, &slots);
                trees.push(tree);
                (trees.len() - 1, centre)
            });
            if trees[tree].count == 0 {
                continue;
            }
            let mut centred = inverse;
            let mut forward = matrix;
            for row in 0..3 {
                centred[row][3] -= centre[row];
            }
            let shift = apply(&matrix, centre);
            for row in 0..3 {
                forward[row][3] = shift[row];
            }
            boxes.push(transformed_bounds(&forward, trees[tree].bvh.bounds));
            placed.push(Placed {
                instance: index as u32,
                tree,
                inverse: centred,
            });
        }
        let flat = flattened_triangles(&data, &parts);
        if flat.len() > MAX_PRIMITIVES || placed.len() > MAX_PRIMITIVES {
            return Err("too many triangles for one tree");
        }
        let Built {
            bvh: top,
            order,
            leaves,
        } = Bvh::build(&boxes, 1);
        let mut slots: Vec<Option<Placed>> = placed.into_iter().map(Some).collect();
        let placed = leaves
            .into_iter()
            .filter_map(|leaf| slots[order[leaf.start] as usize].take())
            .collect();
        Ok(Scene {
            origin,
            data,
            flat: Triangles::build(&flat),
            trees,
            placed,
            top,
        })
    }

    pub fn triangle_count(&self) -> usize {
        self.flat.count + self.trees.iter().map(|t| t.count).sum::<usize>()
    }

    pub fn placed_count(&self) -> usize {
        self.placed.len()
    }
}

/// The mesh's own tree, relative to the centre of its bounds, so that float32 holds it best. `slots`: of each instance
/// that shows it, what something may get through.
fn build_tree(mesh: &Mesh, slots: &[Vec<bool>]) -> (Triangles, [f64; 3]) {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for triangle in 0..mesh.triangles.len() {
        for corner in mesh.triangle_positions(triangle) {
            for axis in 0..3 {
                low[axis] = low[axis].min(corner[axis].into());
                high[axis] = high[axis].max(corner[axis].into());
            }
        }
    }
    let centre = if low[0] <= high[0] {
        [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]))
    } else {
        [0.0; 3]
    };
    let triangles: Vec<Triangle> = (0..mesh.triangles.len())
        .into_par_iter()
        .filter_map(|t| {
            let corners = mesh
                .triangle_positions(t)
                .map(|c| [0, 1, 2].map(|axis| f64::from(c[axis]) - centre[axis]));
            let is_clear = slots.iter().any(|slots| is_clear(mesh, slots, t));
            Triangle::new(corners, u32::MAX, t as u32, is_clear)
        })
        .collect();
    (Triangles::build(&triangles), centre)
}

fn transformed_bounds(matrix: &Matrix, bounds: ([f32; 3], [f32; 3])) -> Bounds {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for corner in 0..8 {
        let pick = |axis: usize| {
            f64::from(if corner >> axis & 1 == 0 {
                bounds.0[axis]
            } else {
                bounds.1[axis]
            })
        };
        let p = apply(matrix, [pick(0), pick(1), pick(2)]);
        for axis in 0..3 {
            low[axis] = low[axis].min(p[axis]);
            high[axis] = high[axis].max(p[axis]);
        }
    }
    // Rays are rounded when they are brought to object space.
    let margin = f64::from(4.0 * WIDENING) * low.iter().chain(&high).fold(0.0, |m: f64, x| m.max(x.abs()));
    Bounds(
        low.map(|x| (x - margin) as f32),
        high.map(|x| (x + margin) as f32),
    )
}
