//! Visibility of lights by casting rays: what every faster method is compared with, and what it falls back to.

use super::bvh::Met;
use super::lift::Lift;
use super::packet::{Packet, lanes_of};
use super::pattern::Pattern;
use super::scene::Scene;
use super::trace::Scratch;
use crate::emitter::{Emitter, Samples};
use crate::random::{hash, pcg, unit};
use crate::simd::{LANES, Lanes, Simd, Vector, Work};

/// Shading points are lifted along their geometric normal by this share of their distance to the eye (76
/// micrometres at 10 m, far below a pixel), more than the rounding of a position; see `triangle.rs` for what
/// keeps a surface from shadowing itself beyond that.
pub const LIFT: f32 = 1.0 / (1 << 17) as f32;

/// More samples than this fill a packet from one point; fewer share it with the next points.
const FEW: usize = LANES / 2;

pub struct Query<'a> {
    pub scene: &'a Scene,
    pub casters: &'a [u8],
    pub emitter: &'a Emitter,
    pub eye: [f64; 3],
    pub pattern: &'a Pattern,
    pub seed: u64,
}

/// A run of shading points; positions relative to the query's eye.
#[derive(Clone, Copy)]
pub struct Points<'a> {
    /// Index of the first one, and all their numbers if those are not their indices: part of the hash.
    pub first: usize,
    pub numbers: Option<&'a [u32]>,
    /// The way and the offset of each (`lift.rs`).
    pub lifts: Option<&'a [[f32; 4]]>,
    pub positions: &'a [[f32; 3]],
    pub geometric_normals: &'a [[f32; 3]],
    pub shading_normals: &'a [[f32; 3]],
}

impl Points<'_> {
    #[inline(always)]
    fn number(&self, index: usize) -> u32 {
        self.numbers
            .map_or((self.first + index) as u32, |numbers| numbers[index])
    }
}

/// Rays of several points on their way into one packet.
struct Pending {
    packet: Packet,
    used: usize,
    point: [usize; LANES],
    weight: Lanes,
}

impl Pending {
    fn new() -> Self {
        Pending {
            packet: Packet::EMPTY,
            used: 0,
            point: [0; LANES],
            weight: [0.0; LANES],
        }
    }

    /// Traces what is there and adds the weights that arrive.
    #[inline(always)]
    fn flush<V: Vector>(&mut self, vector: V, query: &Query, scratch: &mut Scratch, arrived: &mut [f32]) {
        if self.used > 0 {
            self.packet.prepare();
            let (scene, mut met) = (query.scene, Met::NONE);
            scene.trace::<_, false>(vector, query.casters, &mut self.packet, scratch, &mut met);
            for lane in lanes_of(self.packet.set & !self.packet.hit) {
                arrived[self.point[lane]] += self.weight[lane] * met.through[lane];
            }
        }
        self.packet = Packet::EMPTY;
        self.used = 0;
    }
}

/// A point as the light's samples see it.
struct Lit {
    /// Lifted, relative to the scene's origin.
    origin: [f32; 3],
    /// Lifted, in the world.
    world: [f64; 3],
    geometric_normal: [f32; 3],
    shading_normal: [f32; 3],
    lift: Option<Lift>,
}

impl Lit {
    #[inline(always)]
    fn new(query: &Query, points: &Points, index: usize) -> Option<Self> {
        let position = points.positions[index];
        let geometric_normal = points.geometric_normals[index];
        let shading_normal = points.shading_normals[index];
        let (mut finite, mut farthest) = (true, 0.0f32);
        for axis in 0..3 {
            finite &= position[axis].is_finite()
                & geometric_normal[axis].is_finite()
                & shading_normal[axis].is_finite();
            farthest = farthest.max(position[axis].abs());
        }
        if !finite {
            return None;
        }
        let lift = f64::from(LIFT * farthest);
        let (mut world, mut origin) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            let lifted = lift * f64::from(geometric_normal[axis]);
            world[axis] = query.eye[axis] + f64::from(position[axis]) + lifted;
            origin[axis] = (world[axis] - query.scene.origin[axis]) as f32;
        }
        Some(Lit {
            origin,
            world,
            geometric_normal,
            shading_normal,
            lift: points.lifts.and_then(|lifts| Lift::of(lifts[index])),
        })
    }

    /// Whether a direction leaves the surface: at or below its own horizon a point is in shadow, unless rays begin above.
    #[inline(always)]
    fn leaves(&self, direction: [f32; 3]) -> bool {
        let n = self.geometric_normal;
        n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2] > 0.0 || self.lift.is_some()
    }

    /// Origin, direction and length of the ray to a sample of the light.
    #[inline(always)]
    fn ray(&self, direction: [f32; 3], distance: f32) -> ([f32; 3], [f32; 3], f32) {
        let Some(lift) = &self.lift else {
            return (self.origin, direction, distance);
        };
        let way = lift.towards(self.geometric_normal, self.shading_normal, direction);
        let origin = [0, 1, 2].map(|a| self.origin[a] + way[a]);
        if distance == f32::MAX {
            return (origin, direction, distance);
        }
        (origin, [0, 1, 2].map(|a| direction[a] * distance - way[a]), 1.0)
    }
}

/// Visibility and unshadowed weight of each point.
pub struct Visibility<'a, 'b> {
    pub query: &'a Query<'a>,
    pub points: Points<'a>,
    pub visibility: &'b mut [f32],
    pub weight: &'b mut [f32],
}

impl Work for Visibility<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let vector = simd.sixteen();
        let Visibility {
            query,
            points,
            visibility,
            weight,
        } = self;
        let mut scratch = Scratch::default();
        let mut pending = Pending::new();
        let mut samples = Samples::default();
        let pattern = query.pattern;
        let count = if query.emitter.is_single() {
            1
        } else {
            pattern.count
        };
        visibility.fill(0.0); // what arrives, until the end
        for index in 0..points.positions.len() {
            weight[index] = 0.0;
            let Some(lit) = Lit::new(query, &points, index) else {
                continue;
            };
            if query.emitter.surely_misses(lit.world, lit.shading_normal) {
                continue;
            }
            let light = query.emitter.seen_from(lit.world);
            let turn = pattern.turn(hash(query.seed, [points.number(index), 0]));
            let (mut sent, mut arrived) = ([0.0; LANES], [0.0; LANES]);
            for batch in 0..pattern.batches() {
                let [u, v] = pattern.samples(turn, batch);
                light.sample(lit.shading_normal, &u, &v, &mut samples);
                let mut traced = [false; LANES];
                for lane in 0..LANES {
                    let in_count = batch * LANES + lane < count;
                    let w = if in_count { samples.weight[lane] } else { 0.0 };
                    sent[lane] += w;
                    traced[lane] = (w > 0.0) & lit.leaves(samples.towards(lane));
                }
                let mut rays = 0;
                for lane in 0..LANES {
                    rays |= u32::from(traced[lane]) << lane;
                }
                if rays == 0 {
                    continue;
                }
                if count > FEW && lit.lift.is_none() {
                    let mut packet =
                        Packet::of_one_origin(lit.origin, samples.direction, samples.distance, rays);
                    let (scene, mut met) = (query.scene, Met::NONE);
                    scene.trace::<_, false>(vector, query.casters, &mut packet, &mut scratch, &mut met);
                    for lane in lanes_of(rays & !packet.hit) {
                        arrived[lane] += samples.weight[lane] * met.through[lane];
                    }
                    continue;
                }
                if pending.used + rays.count_ones() as usize > LANES {
                    pending.flush(vector, query, &mut scratch, visibility);
                }
                for lane in lanes_of(rays) {
                    let (origin, direction, distance) =
                        lit.ray(samples.towards(lane), samples.distance[lane]);
                    pending.packet.add(pending.used, origin, direction, distance);
                    pending.point[pending.used] = index;
                    pending.weight[pending.used] = samples.weight[lane];
                    pending.used += 1;
                }
            }
            weight[index] = sent.iter().sum();
            visibility[index] += arrived.iter().sum::<f32>();
        }
        pending.flush(vector, query, &mut scratch, visibility);
        for (index, (visibility, weight)) in visibility.iter_mut().zip(weight).enumerate() {
            *visibility = if *weight > 0.0 {
                (*visibility / *weight).min(1.0)
            } else {
                1.0
            };
            let single = *weight > 0.0 && query.emitter.is_single();
            *weight /= if single { 1.0 } else { pattern.count as f32 };
            debug_assert!(weight.is_finite(), "point {index}");
        }
    }
}

/// Two independent estimates of each point's visibility by one ray each, 0 or 1; where a share gets through, 1 is as
/// likely as that.
pub struct Screen<'a, 'b> {
    pub query: &'a Query<'a>,
    pub points: Points<'a>,
    pub estimates: &'b mut [[u8; 2]],
}

impl Work for Screen<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let vector = simd.sixteen();
        let Screen {
            query,
            points,
            estimates,
        } = self;
        let mut scratch = Scratch::default();
        let mut pending = Pending::new();
        let mut samples = Samples::default();
        let pattern = query.pattern;
        let mut arrived = vec![0.0; 2 * points.positions.len()];
        let mut directions = vec![[0.0; 3]; pattern.batches() * LANES];
        let mut distances = vec![0.0; directions.len()];
        let mut sums = vec![0.0; directions.len()];
        for index in 0..points.positions.len() {
            let lit = Lit::new(query, &points, index);
            for estimate in 0..2 {
                let slot = 2 * index + estimate;
                arrived[slot] = 1.0; // where no light could arrive, nothing is in shadow
                let Some(lit) = &lit else {
                    continue;
                };
                let light = query.emitter.seen_from(lit.world);
                let count = if query.emitter.is_single() {
                    1
                } else {
                    pattern.count
                };
                let key = hash(query.seed, [points.number(index), 1 + estimate as u32]);
                let turn = pattern.turn(key);
                let mut sum = 0.0;
                for batch in 0..pattern.batches() {
                    let [u, v] = pattern.samples(turn, batch);
                    light.sample(lit.shading_normal, &u, &v, &mut samples);
                    for lane in 0..LANES {
                        let candidate = batch * LANES + lane;
                        if candidate < count {
                            sum += samples.weight[lane];
                        }
                        sums[candidate] = sum;
                        directions[candidate] = samples.towards(lane);
                        distances[candidate] = samples.distance[lane];
                    }
                }
                if sum <= 0.0 {
                    continue;
                }
                let aim = unit(pcg(key ^ 0x9e37_79b9)) * sum;
                let chosen = sums.partition_point(|&s| s <= aim).min(count - 1);
                arrived[slot] = 0.0;
                if !lit.leaves(directions[chosen]) {
                    continue;
                }
                if pending.used == LANES {
                    pending.flush(vector, query, &mut scratch, &mut arrived);
                }
                let lane = pending.used;
                let (origin, direction, distance) = lit.ray(directions[chosen], distances[chosen]);
                pending.packet.add(lane, origin, direction, distance);
                pending.point[lane] = slot;
                pending.weight[lane] = 1.0;
                pending.used += 1;
            }
        }
        pending.flush(vector, query, &mut scratch, &mut arrived);
        for (index, estimate) in estimates.iter_mut().enumerate() {
            *estimate = [0, 1].map(|i| {
                let chance = unit(hash(query.seed, [points.number(index), 3 + i as u32]));
                u8::from(arrived[2 * index + i] > chance)
            });
        }
    }
}
