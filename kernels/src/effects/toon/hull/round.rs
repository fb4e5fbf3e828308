//! Round strips at sharp convex edges and open borders, and patches where they meet.

use super::builder::Builder;
use super::fans::Directions;
use crate::geometry::{Edge, Topology};
use crate::vector::{Vec3, add, cross, dot, scale, sub, unit};
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

/// How a strip turns at a welded vertex where it ends: from one direction to another, at a border round its outside.
struct Turn {
    vertex: u32,
    from: Vec3,
    via: Option<Vec3>,
    to: Vec3,
}

impl Turn {
    fn middle(&self) -> Vec3 {
        self.via.or(unit(add(self.from, self.to))).unwrap_or(self.from)
    }
}

impl Builder<'_> {
    /// Whether no piece with this direction at a vertex faces away. Pieces are asked once they have moved, which turns
    /// them away by so much at most, or by twice that in sums.
    fn faces_eye(&self, vertex: u32, direction: Vec3) -> bool {
        let reach = self.eye.reach(self.width, &self.places[vertex as usize]);
        self.eye.facing(self.point(vertex), direction) < -2.0 * reach
    }

    /// Which way a strip looks by its ends, and so all that lies between: what faces away at all of them does so in
    /// sums of them.
    fn looks(&self, strip: &[Turn; 2]) -> Looks {
        let (mut is_front, mut is_away) = (true, true);
        for turn in strip {
            for direction in [Some(turn.from), turn.via, Some(turn.to)].into_iter().flatten() {
                is_away &= self.eye.facing(self.point(turn.vertex), direction) >= 0.0;
                is_front &= self.faces_eye(turn.vertex, direction);
            }
        }
        match (is_front, is_away) {
            (true, _) => Looks::Front,
            (_, true) => Looks::Away,
            _ => Looks::Turning,
        }
    }

    /// The largest angle between two directions at these vertices, where an outline may be seen.
    fn strip_angle(&self, ends: [u32; 2]) -> f64 {
        let [a, b] = ends.map(|v| self.eye.strip_angle(self.width, &self.places[v as usize]));
        a.min(b)
    }

    /// What a strip passes at its end.
    fn passed(&self, turn: &Turn, largest: f64) -> Vec<Moved> {
        let Some(via) = turn.via else {
            return self.arc(turn.vertex, turn.from, turn.to, largest);
        };
        let mut arc = self.arc(turn.vertex, turn.from, via, largest);
        arc.pop();
        arc.extend(self.arc(turn.vertex, via, turn.to, largest));
        arc
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
    let strips: Vec<([Turn; 2], Looks)> = topology
        .edges
        .iter()
        .filter_map(|edge| turns(edge, topology, normals, directions, builder))
        .map(|strip| {
            let looks = builder.looks(&strip);
            (strip, looks)
        })
        .collect();
    // Where an outline may be seen of anything that meets at a vertex, all of it is round there. Elsewhere flat pieces
    // close the hull as well.
    let mut vertices: Vec<Option<Looks>> = vec![None; builder.places.len()];
    for (strip, looks) in &strips {
        for turn in strip {
            let known = &mut vertices[turn.vertex as usize];
            *known = Some(known.map_or(
                *looks,
                |known| if known == *looks { known } else { Looks::Turning },
            ));
        }
    }
    let is_round = |vertex: u32| vertices[vertex as usize] == Some(Looks::Turning);
    let mut meetings: Vec<(&Turn, Vec<Moved>)> = Vec::with_capacity(2 * strips.len());
    for (strip, looks) in &strips {
        let ends = [strip[0].vertex, strip[1].vertex];
        let largest = builder.strip_angle(ends);
        let arcs = [0, 1].map(|end| {
            let largest = if is_round(ends[end]) { largest } else { PI };
            builder.passed(&strip[end], largest)
        });
        if *looks != Looks::Front {
            builder.strip(ends, [&arcs[0], &arcs[1]]);
        }
        meetings.extend(strip.iter().zip(arcs));
    }
    meetings.sort_by_key(|(turn, _)| turn.vertex);
    for ends in meetings.chunk_by(|a, b| a.0.vertex == b.0.vertex) {
        let vertex = ends[0].0.vertex;
        if ends.len() > 1 && vertices[vertex as usize] != Some(Looks::Front) {
            let largest = if is_round(vertex) {
                builder.strip_angle([vertex; 2])
            } else {
                PI
            };
            patch(vertex, ends, largest, builder);
        }
    }
}

/// How the strip along an edge turns at its two ends; None where the surface is smooth or a valley.
fn turns(
    edge: &Edge,
    topology: &Topology,
    normals: &[Option<Vec3>],
    directions: &Directions,
    builder: &Builder,
) -> Option<[Turn; 2]> {
    let (a, k) = edge.first;
    let [start, end] = [k, (k + 1) % 3].map(|k| topology.corners[a as usize][k as usize]);
    let n = normals[a as usize]?;
    let at = |t: u32, k: u8| directions.at(t as usize, k as usize);
    let here = [at(a, k), at(a, (k + 1) % 3)];
    let opposite = |(t, k): (u32, u8)| {
        let vertex = topology.corners[t as usize][(k as usize + 2) % 3];
        sub(builder.point(vertex), builder.point(start))
    };
    let second = edge.second.filter(|(b, _)| normals[*b as usize].is_some());
    if let Some((b, l)) = second
        && topology.corners[b as usize][l as usize] != start
    {
        let there = [at(b, (l + 1) % 3), at(b, l)];
        // One surface, or a valley, where the moved triangles overlap.
        let is_sharp = here != there && dot(n, opposite((b, l))) < 0.0;
        let turn = |vertex, from, to| Turn {
            vertex,
            from,
            via: None,
            to,
        };
        return is_sharp.then(|| [turn(start, here[0], there[0]), turn(end, here[1], there[1])]);
    }
    let along = sub(builder.point(end), builder.point(start));
    let out = outward(along, n, opposite((a, k)))?;
    let turn = |vertex, n| Turn {
        vertex,
        from: n,
        via: Some(unit(sub(out, scale(n, dot(n, out)))).unwrap_or(out)),
        to: scale(n, -1.0),
    };
    Some([turn(start, here[0]), turn(end, here[1])])
}

/// The part of a sphere between the strips that end at a vertex.
fn patch(vertex: u32, ends: &[(&Turn, Vec<Moved>)], largest: f64, builder: &mut Builder) {
    let Some(middle) = unit(
        ends.iter()
            .fold([0.0; 3], |sum, (turn, _)| add(sum, turn.middle())),
    ) else {
        return;
    };
    let start = (middle, builder.moved(vertex, middle));
    for (_, arc) in ends {
        let mut ways = arc.iter().map(|&(way, _)| way).chain([middle]);
        if ways.all(|way| builder.faces_eye(vertex, way)) {
            continue;
        }
        // From the corner's middle out to the strip's end.
        let ray = |&tip: &Moved| -> Vec<Moved> {
            let inner = between(middle, tip.0, largest).map(|way| (way, builder.moved(vertex, way)));
            [start].into_iter().chain(inner).chain([tip]).collect()
        };
        let rays: Vec<Vec<Moved>> = arc.iter().map(ray).collect();
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
