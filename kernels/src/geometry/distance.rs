//! How close a point is to a mesh.

use super::mesh::Mesh;
use crate::vector::{Vec3, add, cross, dot, scale, sub};
use rayon::prelude::*;

/// Triangles that a thread takes at a time.
const CHUNK: usize = 4096;

/// Distance in the world from `point` to the triangles of `mesh` as an instance with this matrix shows them; `most` where
/// none is nearer.
pub fn distance(mesh: &Mesh, matrix: &[[f64; 4]; 3], point: Vec3, most: f64) -> f64 {
    // Relative to the point, so that nothing far from the world's origin is lost.
    let place = |p: [f32; 3]| {
        let along = |row: &[f64; 4], to: f64| {
            row[0] * p[0] as f64 + row[1] * p[1] as f64 + row[2] * p[2] as f64 + (row[3] - to)
        };
        [0, 1, 2].map(|axis| along(&matrix[axis], point[axis]))
    };
    let nearest = |triangles: &[[u32; 3]]| {
        triangles.iter().fold(most * most, |best, corners| {
            let vertex = |corner: u32| mesh.positions[mesh.corner_vertices[corner as usize] as usize];
            let corners = corners.map(|corner| place(vertex(corner)));
            if box_distance2(&corners) >= best {
                best
            } else {
                best.min(distance2(corners))
            }
        })
    };
    let chunks = mesh.triangles.par_chunks(CHUNK).map(nearest);
    chunks.reduce(|| most * most, f64::min).sqrt()
}

/// Squared distance from the origin to the box around a triangle.
fn box_distance2(corners: &[Vec3; 3]) -> f64 {
    let along = |axis: usize| {
        let [a, b, c] = corners.map(|corner| corner[axis]);
        a.min(b).min(c).max(-(a.max(b).max(c))).max(0.0)
    };
    let away = [0, 1, 2].map(along);
    dot(away, away)
}

/// Squared distance from the origin to a triangle, which may be a line or a point.
fn distance2(corners: [Vec3; 3]) -> f64 {
    let [a, b, c] = corners;
    let edges = [(a, b), (b, c), (c, a)];
    let to_edge = |(from, to): (Vec3, Vec3)| {
        let along = sub(to, from);
        let length2 = dot(along, along);
        let share = if length2 > 0.0 {
            (-dot(from, along) / length2).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let nearest = add(from, scale(along, share));
        dot(nearest, nearest)
    };
    let to_edges = edges.map(to_edge).into_iter().fold(f64::INFINITY, f64::min);
    let normal = cross(sub(b, a), sub(c, a));
    let is_over = edges
        .iter()
        .all(|&(from, to)| dot(cross(sub(to, from), normal), from) >= 0.0);
    if is_over && dot(normal, normal) > 0.0 {
        // Its foot on the plane is inside.
        to_edges.min(dot(a, normal).powi(2) / dot(normal, normal))
    } else {
        to_edges
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_near_at_its_face_its_edges_and_its_corners() {
        let away = |[x, y, z]: Vec3| {
            let corners = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
            distance2(corners.map(|corner| sub(corner, [x, y, z]))).sqrt()
        };
        assert_eq!(away([1.0, 1.0, 2.0]), 2.0);
        assert_eq!(away([1.0, 1.0, -2.0]), 2.0);
        assert_eq!(away([2.0, -3.0, 0.0]), 3.0);
        assert_eq!(away([-3.0, -4.0, 0.0]), 5.0);
        assert!((away([4.0, 4.0, 0.0]) - 8f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn a_line_and_a_point_are_triangles_too() {
        let line = [[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 2.0, 0.0]];
        assert_eq!(distance2(line), 1.0);
        assert_eq!(distance2([[0.0, 3.0, 4.0]; 3]), 25.0);
    }
}
