//! Ear clipping (Meisters 1975), with the reflex corners in a list of their own.

type Point = [f64; 2];

/// Twice the signed area: positive where the corners turn left.
fn area(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Working memory, kept from polygon to polygon.
#[derive(Default)]
pub struct Ears {
    points: Vec<Point>,
    /// The corners that are left, as a ring.
    next: Vec<u32>,
    previous: Vec<u32>,
    /// Corners that do not turn left, which alone can lie inside an ear; those gone or turned since are still listed.
    reflex: Vec<u32>,
    state: Vec<State>,
}

#[derive(Clone, Copy, PartialEq)]
enum State {
    /// May be an ear.
    Convex,
    /// Turns left, but another corner is in the way; clipping elsewhere does not change that.
    Blocked,
    /// Turns right or not at all.
    Reflex,
    Gone,
}

impl Ears {
    /// Writes `triangles.len()` triangles, two fewer than there are corners: indices into the corners,
    /// wound as they are. Every corner is used and every triangle has distinct corners, whatever the input.
    pub fn clip(
        &mut self,
        corners: impl ExactSizeIterator<Item = [f32; 3]> + Clone,
        triangles: &mut [[u32; 3]],
    ) {
        let count = corners.len() as u32;
        self.flatten(corners);
        self.next = (1..count).chain([0]).collect();
        self.previous = [count - 1].into_iter().chain(0..count - 1).collect();
        self.reflex.clear();
        self.state.clear();
        self.state.resize(count as usize, State::Convex);
        for i in 0..count {
            if self.turn(i) <= 0.0 {
                self.state[i as usize] = State::Reflex;
                self.reflex.push(i);
            }
        }
        let mut here = 0;
        for (done, triangle) in triangles.iter_mut().enumerate() {
            here = self.find(here, count as usize - done);
            let (before, after) = (self.previous[here as usize], self.next[here as usize]);
            *triangle = [before, here, after];
            self.next[before as usize] = after;
            self.previous[after as usize] = before;
            self.state[here as usize] = State::Gone;
            for i in [before, after] {
                let state = if self.turn(i) > 0.0 {
                    State::Convex
                } else {
                    State::Reflex
                };
                if state == State::Reflex && self.state[i as usize] != State::Reflex {
                    self.reflex.push(i); // only where the polygon crosses itself
                }
                self.state[i as usize] = state;
            }
            // Going on two corners further makes fewer slivers than a fan.
            here = self.next[after as usize];
        }
    }

    /// Projects the corners along the polygon's Newell normal, so that they run counter-clockwise.
    fn flatten(&mut self, corners: impl ExactSizeIterator<Item = [f32; 3]> + Clone) {
        let mut corners = corners.map(|p| p.map(f64::from));
        let origin = corners.clone().next().unwrap_or_default();
        let relative = |p: [f64; 3]| [p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]];
        let mut normal = [0.0; 3];
        let mut last = relative(corners.clone().last().unwrap_or_default());
        for p in corners.clone().map(relative) {
            normal[0] += (last[1] - p[1]) * (last[2] + p[2]);
            normal[1] += (last[2] - p[2]) * (last[0] + p[0]);
            normal[2] += (last[0] - p[0]) * (last[1] + p[1]);
            last = p;
        }
        let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
        let [x, y, z] = if length > 0.0 {
            normal.map(|v| v / length)
        } else {
            [0.0, 0.0, 1.0]
        };
        // An orthonormal basis without a branch near the poles (Duff et al. 2017).
        let sign = 1f64.copysign(z);
        let a = -1.0 / (sign + z);
        let b = x * y * a;
        let right = [1.0 + sign * x * x * a, sign * b, -sign * x];
        let up = [b, sign + y * y * a, -y];
        let along = |axis: [f64; 3], p: [f64; 3]| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2];
        self.points.clear();
        self.points.extend(
            corners
                .by_ref()
                .map(relative)
                .map(|p| [along(right, p), along(up, p)]),
        );
    }

    fn point(&self, i: u32) -> Point {
        self.points[i as usize]
    }

    fn turn(&self, i: u32) -> f64 {
        let (before, after) = (self.previous[i as usize], self.next[i as usize]);
        area(self.point(before), self.point(i), self.point(after))
    }

    /// The next ear from `start` on. A polygon that crosses itself or has no area may have none: then the
    /// next corner that turns left, and failing that the one that turns right the least.
    fn find(&mut self, start: u32, left: usize) -> u32 {
        let mut here = start;
        for _ in 0..left {
            if self.state[here as usize] == State::Convex {
                if self.is_ear(here) {
                    return here;
                }
                self.state[here as usize] = State::Blocked;
            }
            here = self.next[here as usize];
        }
        let (mut best, mut best_turn) = (start, f64::NEG_INFINITY);
        for _ in 0..left {
            let turn = self.turn(here);
            if turn > 0.0 {
                return here;
            }
            if turn > best_turn {
                (best, best_turn) = (here, turn);
            }
            here = self.next[here as usize];
        }
        best
    }

    /// Whether no other corner lies in the closed triangle at a convex corner. Corners in the same
    /// place as one of its own do not count.
    fn is_ear(&mut self, i: u32) -> bool {
        let (before, after) = (self.previous[i as usize], self.next[i as usize]);
        let [a, b, c] = [before, i, after].map(|corner| self.point(corner));
        let state = &self.state;
        self.reflex
            .retain(|&other| state[other as usize] == State::Reflex);
        self.reflex.iter().all(|&other| {
            let p = self.point(other);
            let inside = area(a, b, p) >= 0.0 && area(b, c, p) >= 0.0 && area(c, a, p) >= 0.0;
            !inside || p == a || p == b || p == c
        })
    }
}
