//! Which triangles are one smooth surface around a vertex, and where it faces there.

use crate::geometry::Topology;
use crate::vector::{Vec3, add, dot, scale, sub, unit};

/// Triangles that meet at less than this angle are one smooth surface: 30 degrees.
const SMOOTH_COSINE: f64 = 0.866_025_403_784_438_6;

/// Groups corners of triangles that are one smooth surface around their vertex.
struct Fans(Vec<u32>);

impl Fans {
    fn root(&mut self, mut corner: u32) -> u32 {
        while self.0[corner as usize] != corner {
            let above = self.0[self.0[corner as usize] as usize];
            self.0[corner as usize] = above;
            corner = above;
        }
        corner
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// Outward directions of triangles' corners: the mean normal, by angle, of the smooth surface around.
pub struct Directions {
    /// Which direction each corner of each triangle has; only corners of one vertex share one.
    indices: Vec<[u32; 3]>,
    directions: Vec<Vec3>,
}

impl Directions {
    pub fn index(&self, triangle: usize, corner: usize) -> usize {
        self.indices[triangle][corner] as usize
    }

    pub fn at(&self, triangle: usize, corner: usize) -> Vec3 {
        self.directions[self.index(triangle, corner)]
    }

    /// One more than the largest index.
    pub fn count(&self) -> usize {
        self.directions.len()
    }
}

pub fn fan_directions(topology: &Topology, points: &[Vec3], normals: &[Option<Vec3>]) -> Directions {
    let mut fans = Fans((0..3 * topology.corners.len() as u32).collect());
    for edge in &topology.edges {
        let Some((b, l)) = edge.second else { continue };
        let (a, k) = edge.first;
        if is_smooth(topology, normals, (a, k), (b, l)) {
            // The second triangle runs through the edge backwards.
            fans.join(3 * a + u32::from(k), 3 * b + u32::from((l + 1) % 3));
            fans.join(3 * a + u32::from((k + 1) % 3), 3 * b + u32::from(l));
        }
    }
    let roots: Vec<u32> = (0..3 * topology.corners.len() as u32)
        .map(|corner| fans.root(corner))
        .collect();
    let mut sums = vec![[0.0; 3]; roots.len()];
    for (triangle, ends) in topology.corners.iter().enumerate() {
        let Some(n) = normals[triangle] else { continue };
        let [a, b, c] = ends.map(|v| points[v as usize]);
        let sides = [sub(b, a), sub(c, b), sub(a, c)].map(unit);
        for k in 0..3 {
            let (Some(next), Some(before)) = (sides[k], sides[(k + 2) % 3]) else {
                continue;
            };
            let angle = (-dot(next, before)).clamp(-1.0, 1.0).acos();
            let sum = &mut sums[roots[3 * triangle + k] as usize];
            *sum = add(*sum, scale(n, angle));
        }
    }
    let means: Vec<Option<Vec3>> = sums.into_iter().map(unit).collect();
    // A tip's normals are far from their mean: there each triangle keeps to its own.
    let mut is_tip: Vec<bool> = means.iter().map(Option::is_none).collect();
    for (corner, &root) in roots.iter().enumerate() {
        if let (Some(n), Some(mean)) = (normals[corner / 3], means[root as usize]) {
            is_tip[root as usize] |= dot(n, mean) < SMOOTH_COSINE;
        }
    }
    let mut directions: Vec<Vec3> = means.into_iter().map(Option::unwrap_or_default).collect();
    let mut index = |corner: usize| {
        let root = roots[corner];
        if !is_tip[root as usize] {
            return root;
        }
        directions[corner] = normals[corner / 3].unwrap_or_default();
        corner as u32
    };
    let indices = (0..topology.corners.len())
        .map(|t| [3 * t, 3 * t + 1, 3 * t + 2].map(&mut index))
        .collect();
    Directions { indices, directions }
}

fn is_smooth(topology: &Topology, normals: &[Option<Vec3>], a: (u32, u8), b: (u32, u8)) -> bool {
    let start = |(t, k): (u32, u8)| topology.corners[t as usize][k as usize];
    // Two triangles that wind the same way about an edge face opposite sides.
    start(a) != start(b)
        && match (normals[a.0 as usize], normals[b.0 as usize]) {
            (Some(m), Some(n)) => dot(m, n) >= SMOOTH_COSINE,
            _ => false,
        }
}
