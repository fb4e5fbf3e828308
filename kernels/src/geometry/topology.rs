//! What of a mesh touches what: vertices welded by position, and edges with the triangles on both sides.

use rayon::prelude::*;

/// An edge between two welded vertices.
#[derive(Clone, Copy)]
pub struct Edge {
    /// Triangle and, in it, the corner where the edge starts; of the one or two triangles that it belongs to.
    pub first: (u32, u8),
    pub second: Option<(u32, u8)>,
}

pub struct Topology {
    /// Welded vertex of each triangle's corner.
    pub corners: Vec<[u32; 3]>,
    /// A vertex of the mesh for each welded one.
    pub vertices: Vec<u32>,
    /// Triangles that meet at more than two sides of an edge each have an edge of their own.
    pub edges: Vec<Edge>,
}

/// Positions that are equal number by number (0 and -0 too) become one vertex.
fn weld(positions: &[[f32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let key = |vertex: u32| positions[vertex as usize].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<([u32; 3], u32)> = (0..positions.len() as u32).map(|v| (key(v), v)).collect();
    order.par_sort_unstable();
    let mut welded = vec![0; positions.len()];
    let mut vertices = Vec::new();
    let mut last = None;
    for (position, vertex) in order {
        if last != Some(position) {
            vertices.push(vertex);
            last = Some(position);
        }
        welded[vertex as usize] = vertices.len() as u32 - 1;
    }
    (welded, vertices)
}

impl Topology {
    /// Of the triangles of a [`Mesh`](super::mesh::Mesh), which says what the arrays are.
    pub fn of(positions: &[[f32; 3]], corner_vertices: &[u32], triangles: &[[u32; 3]]) -> Self {
        let (welded, vertices) = weld(positions);
        let corner = |corner: u32| welded[corner_vertices[corner as usize] as usize];
        let corners: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(corner)).collect();
        let mut sides: Vec<(u64, u32, u8)> = Vec::with_capacity(3 * corners.len());
        for (triangle, ends) in corners.iter().enumerate() {
            // A triangle that welding folded up joins its neighbours by not being there.
            if ends[0] == ends[1] || ends[1] == ends[2] || ends[2] == ends[0] {
                continue;
            }
            for k in 0..3 {
                let (a, b) = (ends[k], ends[(k + 1) % 3]);
                let key = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
                sides.push((key, triangle as u32, k as u8));
            }
        }
        sides.par_sort_unstable();
        let mut edges = Vec::with_capacity(sides.len() / 2 + 1);
        for same in sides.chunk_by(|a, b| a.0 == b.0) {
            if let [(_, a, k), (_, b, l)] = *same {
                edges.push(Edge {
                    first: (a, k),
                    second: Some((b, l)),
                });
            } else {
                edges.extend(same.iter().map(|&(_, a, k)| Edge {
                    first: (a, k),
                    second: None,
                }));
            }
        }
        Topology {
            corners,
            vertices,
            edges,
        }
    }
}
