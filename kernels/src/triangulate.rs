//! Polygons to triangles.

/// Corners of each triangle, and each triangle's polygon.
pub type Triangles = (Vec<[u32; 3]>, Vec<u32>);

/// Splits polygons into fans.
pub fn triangulate(
    positions: &[[f32; 3]],
    corner_vertices: &[u32],
    face_starts: &[i32],
) -> Result<Triangles, &'static str> {
    let (mut triangles, mut faces) = (Vec::new(), Vec::new());
    for (face, range) in face_starts.windows(2).enumerate() {
        let (start, end) = (range[0], range[1]);
        if start < 0 || end < start || end as usize > corner_vertices.len() {
            return Err("face_starts points outside corner_vertices");
        }
        let finite = (start..end).all(|c| {
            positions[corner_vertices[c as usize] as usize]
                .iter()
                .all(|x| x.is_finite())
        });
        for corner in start + 1..end.max(1) - 1 {
            if finite {
                triangles.push([start as u32, corner as u32, corner as u32 + 1]);
                faces.push(face as u32);
            }
        }
    }
    Ok((triangles, faces))
}
