//! Round strips at sharp convex edges and open borders, and patches where they meet.

use super::fans::Directions;
use super::{Builder, unit};
use crate::topology::Topology;
use crate::vector::{Vec3, add, cross, dot, scale, sub};
use std::f64::consts::PI;

/// Directions from one to another that a strip passes, without these two, at most `largest` radians apart.
fn between(from: Vec3, to: Vec3, largest: f64) -> impl Iterator<Item = Vec3> {
    let cosine = dot(from, to).clamp(-1.0, 1.0);
    let angle = if largest < PI { cosine.acos() } else { 0.0 };
    let across = unit(sub(to, scale(from, cosine))).filter(|_| angle > 1e-6 && angle < PI - 1e-6);
    let pieces = across.map_or(1.0, |_| (angle / largest).ceil());
    let across = across.unwrap_or_default();
    let (sine, cosine) = (angle / pieces).sin_cos();
    let turned = move |&(x, y): &(f64, f64)| Some((x * cosine - y * sine, x * sine + y * cosine));
    std::iter::successors(Some((cosine, sine)), turned)
        .take(pieces as usize - 1)
        .map(move |(x, y)| add(scale(from, x), scale(across, y)))
}

/// Which way the directions of a strip or a patch look.
#[derive(Clone, Copy, PartialEq)]
enum Looks {
    /// At the eye: nothing of it is hull.
    Front,
    /// Both ways: its outline is seen, and has to be round.
    Turning,
    Away,
}

/// A direction, and where it takes a vertex.
type Moved = (Vec3, Vec3);

/// The end of a strip at a welded vertex.
struct End {
    vertex: u32,
    arc: Vec<Moved>,
    /// The middle of what it passes.
    middle: Vec3,
}

impl Builder<'_> {
    /// Which way a vertex and a direction at a time look, and so all that lies between: what faces away at all of
    /// them does so in sums of them.
    fn looks(&self, ends: impl IntoIterator<Item = (u32, Vec3)>) -> Looks {
        let (mut is_front, mut is_away) = (true, true);
        for (vertex, direction) in ends {
            let facing = self.eye.facing(self.point(vertex), direction);
            is_away &= facing >= 0.0;
            // Pieces are asked once they have moved, which turns them away by so much at most, or by twice that in sums.
            let place = &self.places[vertex as usize];
            is_front &= facing < -2.0 * self.eye.reach(self.width, place);
        }
        match (is_front, is_away) {
            (true, _) => Looks::Front,
            (_, true) => Looks::Away,
            _ => Looks::Turning,
        }
    }

    /// The largest angle between two directions of a strip between these vertices: where no outline is seen of it,
    /// one flat piece closes the hull as well.
    fn strip_angle(&self, ends: [u32; 2], looks: Looks) -> f64 {
        if looks != Looks::Turning {
            return PI;
        }
        let [a, b] = ends.map(|v| self.eye.strip_angle(self.width, &self.places[v as usize]));
        a.min(b)
    }

    /// From one direction to another, at most `largest` radians at a time.
    fn arc(&self, vertex: u32, from: Vec3, to: Vec3, largest: f64) -> Vec<Moved> {
        let ways = [from].into_iter().chain(between(from, to, largest)).chain([to]);
        ways.map(|way| (way, self.moved(vertex, way))).collect()
    }

    /// A strip between two vertices (or one and itself), each moved along an arc: the pieces of it that face away.
    fn strip(&mut self, ends: [u32; 2], arcs: [&[Moved]; 2]) {
        let at = |i: usize| arcs.map(|arc| arc[i.min(arc.len() - 1)]);
        for i in 1..arcs[0].len().max(arcs[1].len()) {
            let ([a, c], [b, d]) = (at(i - 1), at(i));
            for (vertices, [p, q, r]) in [
                ([ends[0], ends[0], ends[1]], [a, b, c]),
                ([ends[0], ends[1], ends[1]], [b, d, c]),
            ] {
                if self.eye.faces_away(p.1, add(p.0, add(q.0, r.0))) {
                    self.emit(vertices, [p.1, q.1, r.1]);
                }
            }
        }
    }
}

/// Round strips at convex edges and open borders, and patches where they meet.
pub fn round_edges(
    topology: &Topology,
    normals: &[Option<Vec3>],
    directions: &Directions,
    builder: &mut Builder,
) {
    let mut meetings: Vec<End> = Vec::new();
    for edge in &topology.edges {
        let (a, k) = edge.first;
        let [start, end] = [k, (k + 1) % 3].map(|k| topology.corners[a as usize][k as usize]);
        let Some(n) = normals[a as usize] else { continue };
        let at = |t: u32, k: u8| directions.at(t as usize, k as usize);
        let here = [at(a, k), at(a, (k + 1) % 3)];
        let second = edge.second.filter(|(b, _)| normals[*b as usize].is_some());
        let (looks, [first, second]) = match second {
            Some((b, l)) if topology.corners[b as usize][l as usize] != start => {
                let there = [at(b, (l + 1) % 3), at(b, l)];
                if here == there {
                    continue; // one surface
                }
                let opposite = topology.corners[b as usize][(l as usize + 2) % 3];
                if dot(n, sub(builder.point(opposite), builder.point(start))) >= 0.0 {
                    continue; // a valley, where the moved triangles overlap
                }
                let both = [(start, here[0], there[0]), (end, here[1], there[1])];
                let looks = builder.looks(both.iter().flat_map(|(v, from, to)| [(*v, *from), (*v, *to)]));
                let largest = builder.strip_angle([start, end], looks);
                let ends = both.map(|(vertex, from, to)| End {
                    vertex,
                    arc: builder.arc(vertex, from, to, largest),
                    middle: unit(add(from, to)).unwrap_or(from),
                });
                (looks, ends)
            }
            _ => {
                let along = sub(builder.point(end), builder.point(start));
                let inner = topology.corners[a as usize][(k as usize + 2) % 3];
                let Some(out) = outward(along, n, sub(builder.point(inner), builder.point(start))) else {
                    continue;
                };
                // From one side of the sheet to the other: its outline is always seen.
                let largest = builder.strip_angle([start, end], Looks::Turning);
                let ends = [(start, here[0]), (end, here[1])].map(|(vertex, n)| {
                    let out = unit(sub(out, scale(n, dot(n, out)))).unwrap_or(out);
                    let mut both = builder.arc(vertex, n, out, largest);
                    both.pop();
                    both.extend(builder.arc(vertex, out, scale(n, -1.0), largest));
                    End {
                        vertex,
                        arc: both,
                        middle: out,
                    }
                });
                (Looks::Turning, ends)
            }
        };
        if looks != Looks::Front {
            builder.strip([start, end], [&first.arc, &second.arc]);
        }
        meetings.extend([first, second]);
    }
    meetings.sort_by_key(|end| end.vertex);
    for ends in meetings.chunk_by(|a, b| a.vertex == b.vertex) {
        patch(ends, builder);
    }
}

/// The part of a sphere between the strips that end at a vertex.
fn patch(ends: &[End], builder: &mut Builder) {
    let vertex = ends[0].vertex;
    let Some(middle) = unit(ends.iter().fold([0.0; 3], |sum, end| add(sum, end.middle))) else {
        return;
    };
    if ends.len() < 2 {
        return;
    }
    let looks = |builder: &Builder, ends: &[End]| {
        let ways = ends.iter().flat_map(|end| &end.arc).map(|&(way, _)| way);
        builder.looks(ways.chain([middle]).map(|way| (vertex, way)))
    };
    let largest = builder.strip_angle([vertex; 2], looks(builder, ends));
    let start = (middle, builder.moved(vertex, middle));
    for end in ends {
        if looks(builder, std::slice::from_ref(end)) == Looks::Front {
            continue;
        }
        // From the corner's middle out to the strip's end.
        let ray = |&tip: &Moved| -> Vec<Moved> {
            let inner = between(middle, tip.0, largest).map(|way| (way, builder.moved(vertex, way)));
            [start].into_iter().chain(inner).chain([tip]).collect()
        };
        let rays: Vec<Vec<Moved>> = end.arc.iter().map(ray).collect();
        for pair in rays.windows(2) {
            builder.strip([vertex; 2], [&pair[0], &pair[1]]);
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
