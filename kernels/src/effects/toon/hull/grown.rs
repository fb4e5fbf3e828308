//! The hull of one instance.

use super::builder::Builder;
use super::fans::fan_directions;
use super::line::{Eye, Width};
use super::round::round_edges;
use crate::geometry::{Data, Instance, Mesh, Topology};
use crate::vector::{Vec3, cross, dot, scale, sub, unit};

/// The hull of one instance, triangles relative to the eye.
pub fn hull(
    mesh: &Mesh,
    topology: &Topology,
    instance: &Instance,
    skipped: &dyn Fn(usize) -> bool,
    thickness: Option<&[f32]>,
    width: &Width,
    eye: &Eye,
) -> Vec<[[f32; 3]; 3]> {
    let matrix = &instance.matrix;
    let point = |vertex: &u32| -> Vec3 {
        let p = mesh.positions[*vertex as usize].map(f64::from);
        std::array::from_fn(|k| {
            dot([matrix[k][0], matrix[k][1], matrix[k][2]], p) + (matrix[k][3] - eye.view.eye[k])
        })
    };
    let points: Vec<Vec3> = topology.vertices.iter().map(point).collect();
    let places = topology
        .vertices
        .iter()
        .zip(&points)
        .map(|(vertex, p)| {
            let share = thickness.map_or(1.0, |t| f64::from(t[*vertex as usize]));
            eye.place(*p, width.width * share)
        })
        .collect();
    // A mirroring matrix turns the winding round, but not what is outside.
    let [rx, ry, rz] = [0, 1, 2].map(|k| [matrix[k][0], matrix[k][1], matrix[k][2]]);
    let side = dot(rx, cross(ry, rz)).signum();
    let normal = |ends: &[u32; 3]| -> Option<Vec3> {
        let [a, b, c] = ends.map(|v| points[v as usize]);
        unit(scale(cross(sub(b, a), sub(c, a)), side))
    };
    let normals: Vec<Option<Vec3>> = topology
        .corners
        .iter()
        .enumerate()
        .map(|(triangle, ends)| if skipped(triangle) { None } else { normal(ends) })
        .collect();
    let directions = fan_directions(topology, &points, &normals);
    // An open surface has a back of its own, which its border's ring ends at.
    let is_open = topology.edges.iter().any(|edge| edge.second.is_none());
    let mut builder = Builder {
        eye,
        width,
        places,
        triangles: Vec::new(),
    };
    // Where a vertex is moved to, by the index of its direction.
    let mut outward: Vec<Option<Vec3>> = vec![None; directions.count()];
    for (triangle, ends) in topology.corners.iter().enumerate() {
        // By the triangle before it moved: what was in front stays away, even where the hull folds over.
        let Some(n) = normals[triangle] else { continue };
        let moved = if eye.faces_away(builder.point(ends[0]), n) {
            std::array::from_fn(|k| {
                let place = &mut outward[directions.index(triangle, k)];
                *place.get_or_insert_with(|| builder.moved(ends[k], directions.at(triangle, k)))
            })
        } else if is_open {
            std::array::from_fn(|k| builder.moved(ends[k], scale(directions.at(triangle, k), -1.0)))
        } else {
            continue;
        };
        builder.emit(*ends, moved);
    }
    round_edges(topology, &normals, &directions, &mut builder);
    builder.triangles
}

/// Which triangles have no line: those that something is seen through, in part or whole.
pub fn is_clear(data: &Data, instance: &Instance, triangle: usize) -> bool {
    let seen = &data.material(instance, triangle).seen;
    seen.iter().any(|opacity| opacity.uniform() != Some(1.0))
}
