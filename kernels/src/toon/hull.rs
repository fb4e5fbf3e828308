//! The inverted hull: surfaces moved out along their normals, of which only what faces away is kept.
//!
//! The hull is the surface grown by a ball of the line's width, as far as triangles can say: smooth parts move
//! along the mean normal of all triangles that touch (vertices are welded by position, so that split normals open
//! no gaps), sharp convex edges and open borders get round strips, and corners the patches between these. So the
//! ring around a silhouette is as wide at a box's edge as on a ball, from every side.

mod python;

pub use python::*;

use crate::geometry::{Data, Instance, Mesh};
use crate::topology::Topology;
use crate::vector::{Vec3, add, cross, dot, length, scale, sub};
use crate::view::View;
use std::collections::HashMap;

/// Triangles that meet at less than this angle are one smooth surface: 30 degrees.
const SMOOTH_COSINE: f64 = 0.866_025_403_784_438_6;
/// A round strip's ring may be narrower than the line by this many pixels, between its directions.
const FLAT_PIXELS: f64 = 0.05;
/// The angles between two directions of a strip, radians, that this may lead to: 2 to 30 degrees.
const STRIP_ANGLES: [f64; 2] = [std::f64::consts::PI / 90.0, std::f64::consts::FRAC_PI_6];

/// What moves away from the eye appears to move less the farther it is; beyond four times as far it is let be.
const LEAST_APPROACH: f64 = 0.25;

fn unit(a: Vec3) -> Option<Vec3> {
    let length = length(a);
    (length > 1e-150 && length.is_finite()).then(|| scale(a, 1.0 / length))
}

/// How wide a line is.
struct Width {
    /// Metres, or pixels.
    width: f64,
    in_pixels: bool,
    /// Limits, pixels.
    least: f64,
    most: f64,
}

impl Width {
    /// Pixels of a line that is `wanted` metres or pixels wide where a pixel is `pixel` metres.
    fn pixels(&self, wanted: f64, pixel: f64) -> f64 {
        let pixels = if self.in_pixels { wanted } else { wanted / pixel };
        pixels.clamp(self.least, self.most)
    }
}

struct Eye {
    view: View,
    /// Window units of a pixel.
    pixel: f64,
}

/// A welded vertex, and how far it moves.
struct Place {
    /// Relative to the eye.
    point: Vec3,
    /// Towards it from the eye, unit; None in an orthographic view.
    ray: Option<Vec3>,
    /// Metres of a pixel beside it that is seen straight on.
    pixel: f64,
    /// Width of the line, metres or pixels; 0 for none.
    wanted: f64,
}

impl Eye {
    /// Whether a triangle or a strip at `p`, relative to the eye, faces away with the outward normal `n`.
    fn faces_away(&self, p: Vec3, n: Vec3) -> bool {
        dot(
            if self.view.orthographic {
                self.view.forward
            } else {
                p
            },
            n,
        ) > 0.0
    }

    /// A vertex where the line is `wanted` wide.
    fn place(&self, point: Vec3, wanted: f64) -> Place {
        let (depth, ray) = if self.view.orthographic {
            (1.0, None)
        } else {
            (dot(point, self.view.forward).max(self.view.near), unit(point))
        };
        Place {
            point,
            ray,
            pixel: self.pixel * depth,
            wanted: if wanted > 0.0 { wanted } else { 0.0 }, // whatever the least width
        }
    }

    /// Where a vertex is moved to along a unit direction.
    ///
    /// An image plane stretches what is away from its middle. Let n be the direction without its part along the line
    /// of sight, unit, as it is on a silhouette; there, what is moved by k times its depth appears d window units
    /// farther out if k = d m / (1 - d m n_z), with n_z = n . forward and m^2 = 1 - n_z^2.
    fn moved(&self, width: &Width, place: &Place, direction: Vec3) -> Vec3 {
        if place.wanted <= 0.0 {
            return place.point;
        }
        let (mut shrinking, mut receding) = (1.0, 0.0);
        if let Some(ray) = place.ray {
            let along = dot(direction, ray);
            let across = 1.0 - along * along;
            // Of a step along the line of sight nothing is seen.
            if across > 1e-6 {
                let forward = self.view.forward;
                let tilt = (dot(direction, forward) - along * dot(ray, forward)) / across.sqrt();
                shrinking = (1.0 - tilt * tilt).max(0.0).sqrt();
                receding = self.pixel * shrinking * tilt;
            }
        }
        let pixels = width.pixels(place.wanted, place.pixel * shrinking);
        let unlimited = pixels > width.least && pixels < width.most;
        let metres = if unlimited && !width.in_pixels {
            place.wanted
        } else {
            pixels * place.pixel * shrinking / (1.0 - pixels * receding).max(LEAST_APPROACH)
        };
        add(place.point, scale(direction, metres))
    }

    /// The largest angle between two directions of a strip at a vertex.
    fn strip_angle(&self, width: &Width, place: &Place) -> f64 {
        let pixels = width.pixels(place.wanted, place.pixel);
        let [least, most] = STRIP_ANGLES;
        (2.0 * (1.0 - FLAT_PIXELS / pixels).clamp(-1.0, 1.0).acos()).clamp(least, most)
    }
}

/// Directions from one to another that a strip passes, both ends included, at most `largest` radians apart.
fn arc(from: Vec3, to: Vec3, largest: f64) -> Vec<Vec3> {
    let angle = dot(from, to).clamp(-1.0, 1.0).acos();
    let pieces = (angle / largest).ceil().max(1.0);
    let sine = angle.sin();
    (0..=pieces as usize)
        .map(|i| {
            let t = i as f64 / pieces;
            if sine < 1e-6 {
                return if 2 * i > pieces as usize { to } else { from };
            }
            let mixed = add(
                scale(from, ((1.0 - t) * angle).sin() / sine),
                scale(to, (t * angle).sin() / sine),
            );
            unit(mixed).unwrap_or(from)
        })
        .collect()
}

/// The round strips that end at a welded vertex: what they pass, and the sum of their directions.
#[derive(Default)]
struct Meeting {
    arcs: Vec<Vec<Vec3>>,
    middle: Vec3,
}

/// One instance's hull under way.
struct Builder<'a> {
    eye: &'a Eye,
    width: &'a Width,
    /// Of welded vertices.
    places: Vec<Place>,
    triangles: Vec<[[f32; 3]; 3]>,
}

impl Builder<'_> {
    /// Vertex moved along a direction.
    fn moved(&self, vertex: u32, direction: Vec3) -> Vec3 {
        self.eye
            .moved(self.width, &self.places[vertex as usize], direction)
    }

    fn point(&self, vertex: u32) -> Vec3 {
        self.places[vertex as usize].point
    }

    /// The largest angle between two directions of a strip that ends at these vertices.
    fn strip_angle(&self, ends: [u32; 2]) -> f64 {
        let [a, b] = ends.map(|v| self.eye.strip_angle(self.width, &self.places[v as usize]));
        a.min(b)
    }

    /// A triangle of the hull, from vertices and where they are moved to.
    fn emit(&mut self, vertices: [u32; 3], moved: [Vec3; 3]) {
        if vertices.iter().all(|v| self.places[*v as usize].wanted <= 0.0) {
            return; // no line here
        }
        let [a, b, c] = moved;
        if moved.iter().flatten().all(|x| x.is_finite()) && a != b && b != c && c != a {
            self.triangles.push(moved.map(|p| p.map(|x| x as f32)));
        }
    }

    /// A strip between two vertices (or one and itself), each moved along an arc of directions: the pieces of it that
    /// face away.
    fn strip(&mut self, ends: [u32; 2], arcs: [&[Vec3]; 2]) {
        let count = arcs[0].len().max(arcs[1].len());
        let at = |end: usize, i: usize| arcs[end][i.min(arcs[end].len() - 1)];
        let mut before = [0, 1].map(|end| (at(end, 0), self.moved(ends[end], at(end, 0))));
        for i in 1..count {
            let [a, c] = before;
            let [b, d] = [0, 1].map(|end| (at(end, i), self.moved(ends[end], at(end, i))));
            for (vertices, [p, q, r]) in [
                ([ends[0], ends[0], ends[1]], [a, b, c]),
                ([ends[0], ends[1], ends[1]], [b, d, c]),
            ] {
                if self.eye.faces_away(p.1, add(p.0, add(q.0, r.0))) {
                    self.emit(vertices, [p.1, q.1, r.1]);
                }
            }
            before = [b, d];
        }
    }
}

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

/// The hull of one instance, triangles relative to the eye.
fn hull(
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
    for (triangle, ends) in topology.corners.iter().enumerate() {
        // By the triangle before it moved: what was in front stays away, even where the hull folds over.
        let Some(n) = normals[triangle] else { continue };
        let corners: [(u32, Vec3); 3] = std::array::from_fn(|k| (ends[k], directions[3 * triangle + k]));
        let turn = if eye.faces_away(builder.point(ends[0]), n) {
            1.0
        } else if is_open {
            -1.0
        } else {
            continue;
        };
        let moved = corners.map(|(vertex, direction)| builder.moved(vertex, scale(direction, turn)));
        builder.emit(*ends, moved);
    }
    round_edges(topology, &normals, &directions, &mut builder);
    builder.triangles
}

/// The outward direction of every triangle's corners: the mean normal, by angle, of the smooth surface around.
fn fan_directions(topology: &Topology, points: &[Vec3], normals: &[Option<Vec3>]) -> Vec<Vec3> {
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
    let mut is_tip = vec![false; roots.len()];
    for (corner, &root) in roots.iter().enumerate() {
        if let (Some(n), Some(mean)) = (normals[corner / 3], means[root as usize]) {
            is_tip[root as usize] |= dot(n, mean) < SMOOTH_COSINE;
        }
    }
    let direction = |corner: usize| {
        let root = roots[corner] as usize;
        let mean = means[root].filter(|_| !is_tip[root]);
        mean.or(normals[corner / 3]).unwrap_or([0.0; 3])
    };
    (0..roots.len()).map(direction).collect()
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

/// Round strips at convex edges and open borders, and patches where they meet.
fn round_edges(topology: &Topology, normals: &[Option<Vec3>], directions: &[Vec3], builder: &mut Builder) {
    let mut meetings: HashMap<u32, Meeting> = HashMap::new();
    for edge in &topology.edges {
        let (a, k) = edge.first;
        let [start, end] = [k, (k + 1) % 3].map(|k| topology.corners[a as usize][k as usize]);
        let Some(n) = normals[a as usize] else { continue };
        let at = |t: u32, k: u8| directions[(3 * t + u32::from(k)) as usize];
        let (here, along) = (
            [at(a, k), at(a, (k + 1) % 3)],
            sub(builder.point(end), builder.point(start)),
        );
        let second = edge.second.filter(|(b, _)| normals[*b as usize].is_some());
        let arcs: [Vec<Vec3>; 2] = match second {
            Some((b, l)) if topology.corners[b as usize][l as usize] != start => {
                let opposite = topology.corners[b as usize][(l as usize + 2) % 3];
                let away = sub(builder.point(opposite), builder.point(start));
                let there = [at(b, (l + 1) % 3), at(b, l)];
                if here == there || dot(n, away) >= 0.0 {
                    continue; // one surface, or a valley, where the moved triangles overlap
                }
                let largest = builder.strip_angle([start, end]);
                [arc(here[0], there[0], largest), arc(here[1], there[1], largest)]
            }
            _ => {
                let inner = topology.corners[a as usize][(k as usize + 2) % 3];
                let Some(out) = outward(along, n, sub(builder.point(inner), builder.point(start))) else {
                    continue;
                };
                let largest = builder.strip_angle([start, end]);
                here.map(|n| {
                    let out = unit(sub(out, scale(n, dot(n, out)))).unwrap_or(out);
                    let mut both = arc(n, out, largest);
                    both.extend(arc(out, scale(n, -1.0), largest).into_iter().skip(1));
                    both
                })
            }
        };
        builder.strip([start, end], [&arcs[0], &arcs[1]]);
        for (vertex, arc) in [start, end].into_iter().zip(arcs) {
            let meeting = meetings.entry(vertex).or_default();
            meeting.middle = add(meeting.middle, arc[arc.len() / 2]);
            meeting.arcs.push(arc);
        }
    }
    let mut meetings: Vec<(u32, Meeting)> = meetings.into_iter().collect();
    meetings.sort_unstable_by_key(|(vertex, _)| *vertex); // the same order every time
    for (vertex, meeting) in meetings {
        let Some(middle) = unit(meeting.middle) else {
            continue;
        };
        if meeting.arcs.len() < 2 {
            continue;
        }
        let largest = builder.strip_angle([vertex; 2]);
        for arc in &meeting.arcs {
            // From the corner's middle out to the strip's end, a part of a sphere.
            let rays: Vec<Vec<Vec3>> = arc.iter().map(|&end| self::arc(middle, end, largest)).collect();
            for pair in rays.windows(2) {
                builder.strip([vertex; 2], [&pair[0], &pair[1]]);
            }
        }
    }
}

/// The direction in a triangle's plane that leads out over its side `along`; `inward` leads to its third corner.
fn outward(along: Vec3, normal: Vec3, inward: Vec3) -> Option<Vec3> {
    let across = unit(cross(along, normal))?;
    Some(if dot(across, inward) > 0.0 {
        scale(across, -1.0)
    } else {
        across
    })
}

/// Which triangles have no line: those that alpha clip leaves out, in part or whole.
fn clipped(data: &Data, instance: &Instance, mesh: &Mesh, triangle: usize) -> bool {
    let slot = mesh.triangle_slots.get(triangle).copied().unwrap_or(0);
    let cutout = &data.cutouts[instance.material(slot) as usize];
    !cutout.is_uniform() || !cutout.is_opaque([0.0; 2])
}
