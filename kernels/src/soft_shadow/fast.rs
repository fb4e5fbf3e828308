//! The bitmask method, a register of texels or samples at a time. Hides the same samples as `plain.rs`.

use super::choose::Window;
use super::light::{Light, RIM, SAMPLE_ROWS, SAMPLES, Seen};
use super::plain::{Bits, LOWEST_EDGE, OWN_SURFACE};
use super::prepare::{BLOCK, BLOCK_TEXELS, PreparedMap};
use super::simd::{MOST_LANES, Vector};
use crate::emitter::EmitterKind;

/// Bits of the samples in the first n columns or rows. Ranks are masked to the table's length, so that
/// looking one up needs no check.
#[repr(align(64))]
struct Prefixes([Bits; 2 * SAMPLES]);

static FIRST_COLUMNS: Prefixes = prefixes(false);
static FIRST_ROWS: Prefixes = prefixes(true);

const fn prefixes(by_row: bool) -> Prefixes {
    let mut table = [[0; SAMPLES / 32]; 2 * SAMPLES];
    let mut n = 0;
    while n < 2 * SAMPLES {
        let mut i = 0;
        while i < SAMPLES {
            let place = if by_row { SAMPLE_ROWS[i] as usize } else { i };
            if place < n {
                table[n][i / 32] |= 1 << (i % 32);
            }
            i += 1;
        }
        n += 1;
    }
    Prefixes(table)
}

/// Where the samples lie, as shares of the light's width and height.
static SAMPLE_PLACES: [[f32; SAMPLES]; 2] = sample_places();

const fn sample_places() -> [[f32; SAMPLES]; 2] {
    let mut places = [[0.0; SAMPLES]; 2];
    let mut i = 0;
    while i < SAMPLES {
        places[0][i] = (i as f32 + 0.5) / SAMPLES as f32;
        places[1][i] = (SAMPLE_ROWS[i] as f32 + 0.5) / SAMPLES as f32;
        i += 1;
    }
    places
}

/// Added to a number from 0 to 256 it leaves the nearest whole number in the float's low bits.
const ROUND: f32 = 8_388_608.0;

#[inline(always)]
fn rank(rounded: f32) -> usize {
    rounded.to_bits() as usize % (2 * SAMPLES)
}

/// Column and row within a block of each texel of its first two rows.
const COLUMNS: [f32; MOST_LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0,
];
const ROWS: [f32; MOST_LANES] = [
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0,
];

/// A level of the map from one point.
#[derive(Clone, Copy, Default)]
pub struct Place {
    pub level: usize,
    /// Where the point is, in texels.
    u: f32,
    v: f32,
    texel_x: f32,
    texel_y: f32,
    /// Samples per unit of the light's plane.
    samples_x: f32,
    samples_y: f32,
    /// The band of rises above the point that the level answers for.
    pub above_from: f32,
    pub above_to: f32,
}

impl Place {
    pub fn new(map: &PreparedMap, seen: &Seen, level: usize, above_from: f32, above_to: f32) -> Place {
        let [u, v] = map.place(seen, level);
        let [texel_x, texel_y] = map.texel_size(level);
        let [left, right, bottom, top] = seen.bounds;
        Place {
            level,
            u,
            v,
            texel_x: texel_x as f32,
            texel_y: texel_y as f32,
            samples_x: SAMPLES as f32 / (right - left),
            samples_y: SAMPLES as f32 / (top - bottom),
            above_from,
            above_to,
        }
    }
}

/// The first sample, plus [`ROUND`], beyond an edge `offset` from the point whose surface is `above` it there.
/// On an axis whose samples begin at `start`, `samples` a unit of the light's plane.
#[inline(always)]
fn edge<V: Vector>(
    vector: V,
    offset: V::Floats,
    above: V::Floats,
    lowest: V::Floats,
    [start, samples]: [f32; 2],
) -> V::Floats {
    let covered = vector.sub(vector.div(offset, vector.max(above, lowest)), vector.splat(start));
    let sample = vector.mul(covered, vector.splat(samples));
    let clamped = vector.min(
        vector.max(sample, vector.splat(0.0)),
        vector.splat(SAMPLES as f32),
    );
    vector.add(clamped, vector.splat(ROUND))
}

#[inline(always)]
fn dot<V: Vector>(vector: V, a: [V::Floats; 3], b: [f32; 3]) -> V::Floats {
    let x = vector.mul(a[0], vector.splat(b[0]));
    let y = vector.mul(a[1], vector.splat(b[1]));
    vector.add(vector.add(x, y), vector.mul(a[2], vector.splat(b[2])))
}

/// Sums over all lanes, in the same order whatever their number.
#[inline(always)]
fn total<V: Vector>(vector: V, sums: &[V::Floats; MOST_LANES]) -> f32 {
    let mut total = 0.0;
    for sum in &sums[..MOST_LANES / V::LANES] {
        let mut lanes = [0.0; MOST_LANES];
        vector.store(*sum, &mut lanes);
        for lane in &lanes[..V::LANES] {
            total += lane;
        }
    }
    total
}

/// As `plain::backproject`, for one block whose first texel is at `row` and `column`. `inner`: the inner window
/// from the point, if it reaches into the block.
#[inline(always)]
pub fn backproject_block<V: Vector>(
    vector: V,
    map: &PreparedMap,
    seen: &Seen,
    place: &Place,
    block: usize,
    [row, column]: [usize; 2],
    inner: Option<Window<f32>>,
    mut hidden: V::Bits,
) -> V::Bits {
    let level = &map.levels[place.level];
    let texels = block * BLOCK_TEXELS..(block + 1) * BLOCK_TEXELS;
    let (rises, tilts) = (&level.rise[texels.clone()], &level.tilt[texels]);
    let [left, right, bottom, top] = seen.bounds;
    let zero = vector.splat(0.0);
    let du = vector.sub(
        vector.add(vector.splat(column as f32), vector.load(&COLUMNS)),
        vector.splat(place.u),
    );
    let from_x = vector.mul(du, vector.splat(place.texel_x));
    let to_x = vector.mul(vector.add(du, vector.splat(1.0)), vector.splat(place.texel_x));
    let mid_x = vector.mul(vector.add(du, vector.splat(0.5)), vector.splat(place.texel_x));
    let [base_x, base_y, base_z] = seen.base;
    let [normal_x, normal_y, normal_z] = seen.geometric_normal;
    let mut ranks = [[0.0; MOST_LANES]; 4];
    for first in (0..BLOCK_TEXELS).step_by(V::LANES) {
        let rise = vector.load(&rises[first..]);
        let above = vector.sub(rise, vector.splat(seen.rise));
        let mut found = vector.greater(above, vector.splat(place.above_from))
            & !vector.greater(above, vector.splat(place.above_to));
        if found & V::ALL == 0 {
            continue;
        }
        // Do rays from the light to the point meet it?
        let in_block = vector.add(vector.splat((row + first / BLOCK) as f32), vector.load(&ROWS));
        let dv = vector.sub(in_block, vector.splat(place.v));
        let from_y = vector.mul(dv, vector.splat(place.texel_y));
        let to_y = vector.mul(vector.add(dv, vector.splat(1.0)), vector.splat(place.texel_y));
        found &= vector.greater(vector.mul(vector.splat(right), above), from_x)
            & vector.greater(to_x, vector.mul(vector.splat(left), above))
            & vector.greater(vector.mul(vector.splat(top), above), from_y)
            & vector.greater(to_y, vector.mul(vector.splat(bottom), above));
        if let Some([left, right, bottom, top]) = inner {
            let outside = vector.greater(vector.splat(left), from_x)
                | vector.greater(to_x, vector.splat(right))
                | vector.greater(vector.splat(bottom), from_y)
                | vector.greater(to_y, vector.splat(top));
            found &= outside;
        }
        if found & V::ALL == 0 {
            continue;
        }
        let [tilt_x, tilt_y] = vector.load_halves(&tilts[first..]);
        let slope = vector.max(vector.abs(tilt_x), vector.abs(tilt_y));
        let metre = if map.view.orthographic {
            vector.splat(1.0)
        } else {
            vector.mul(rise, rise)
        };
        let bias = vector.min(
            vector.mul(vector.splat(map.bias.gradient_scale), slope),
            vector.mul(vector.splat(map.bias.gradient_cap), metre),
        );
        found &= vector.greater(above, vector.max(bias, vector.splat(seen.rounding)));
        // Is it above the point's tangent plane?
        let mid_y = vector.mul(vector.add(dv, vector.splat(0.5)), vector.splat(place.texel_y));
        let direction_x = vector.sub(mid_x, vector.mul(above, vector.splat(base_x)));
        let direction_y = vector.sub(mid_y, vector.mul(above, vector.splat(base_y)));
        let direction_z = vector.sub(zero, vector.mul(above, vector.splat(base_z)));
        let length = vector.add(
            vector.add(vector.abs(direction_x), vector.abs(direction_y)),
            vector.abs(direction_z),
        );
        let height = vector.add(
            vector.add(
                vector.mul(vector.splat(normal_x), direction_x),
                vector.mul(vector.splat(normal_y), direction_y),
            ),
            vector.mul(vector.splat(normal_z), direction_z),
        );
        found &= vector.greater(height, vector.mul(vector.splat(OWN_SURFACE), length));
        if found & V::ALL == 0 {
            continue;
        }
        let (half_x, half_y) = (
            vector.mul(vector.splat(0.5), tilt_x),
            vector.mul(vector.splat(0.5), tilt_y),
        );
        let lowest = vector.mul(vector.splat(LOWEST_EDGE), above);
        let (x, y) = ([left, place.samples_x], [bottom, place.samples_y]);
        let x0 = edge(vector, from_x, vector.sub(above, half_x), lowest, x);
        let x1 = edge(vector, to_x, vector.add(above, half_x), lowest, x);
        let y0 = edge(vector, from_y, vector.sub(above, half_y), lowest, y);
        let y1 = edge(vector, to_y, vector.add(above, half_y), lowest, y);
        let (low_x, high_x) = (vector.min(x0, x1), vector.max(x0, x1));
        let (low_y, high_y) = (vector.min(y0, y1), vector.max(y0, y1));
        found &= vector.greater(high_x, low_x) & vector.greater(high_y, low_y) & V::ALL;
        if found == 0 {
            continue;
        }
        vector.store(low_x, &mut ranks[0]);
        vector.store(high_x, &mut ranks[1]);
        vector.store(low_y, &mut ranks[2]);
        vector.store(high_y, &mut ranks[3]);
        while found != 0 {
            let lane = found.trailing_zeros() as usize % MOST_LANES;
            found &= found - 1;
            hidden = vector.or_both(
                hidden,
                &FIRST_COLUMNS.0[rank(ranks[0][lane])],
                &FIRST_COLUMNS.0[rank(ranks[1][lane])],
                &FIRST_ROWS.0[rank(ranks[2][lane])],
                &FIRST_ROWS.0[rank(ranks[3][lane])],
            );
        }
    }
    hidden
}

/// Where a register of samples from the number `first` on lies on the light's plane.
#[inline(always)]
fn samples<V: Vector>(vector: V, seen: &Seen, first: usize) -> [V::Floats; 2] {
    let [left, right, bottom, top] = seen.bounds;
    let (x, y) = (
        vector.load(&SAMPLE_PLACES[0][first..]),
        vector.load(&SAMPLE_PLACES[1][first..]),
    );
    [
        vector.add(vector.splat(left), vector.mul(x, vector.splat(right - left))),
        vector.add(vector.splat(bottom), vector.mul(y, vector.splat(top - bottom))),
    ]
}

/// As `plain::horizon`.
#[inline(always)]
pub fn horizon<V: Vector>(vector: V, seen: &Seen) -> Bits {
    let [normal_x, normal_y, normal_z] = seen.geometric_normal;
    let [base_x, base_y, base_z] = seen.base;
    let mut hidden = Bits::default();
    for first in (0..SAMPLES).step_by(V::LANES) {
        let [x, y] = samples(vector, seen, first);
        let height = vector.add(
            vector.add(
                vector.mul(vector.splat(normal_x), vector.sub(x, vector.splat(base_x))),
                vector.mul(vector.splat(normal_y), vector.sub(y, vector.splat(base_y))),
            ),
            vector.splat(normal_z * -base_z),
        );
        let shown = vector.greater(height, vector.splat(0.0));
        hidden[first / 32] |= (!shown & V::ALL) << (first % 32);
    }
    hidden
}

/// As `plain::resolve`, summed in another order.
#[inline(always)]
pub fn resolve<V: Vector>(vector: V, light: &Light, seen: &Seen, hidden: &Bits) -> f32 {
    let zero = vector.splat(0.0);
    let [_, right, _, top] = seen.bounds;
    let [base_x, base_y, base_z] = seen.base;
    let base2 = base_x * base_x + base_y * base_y + base_z * base_z;
    let mut open = [zero; MOST_LANES];
    let mut all = [zero; MOST_LANES];
    for first in (0..SAMPLES).step_by(V::LANES) {
        let [x, y] = samples(vector, seen, first);
        let (dx, dy) = (
            vector.sub(x, vector.splat(base_x)),
            vector.sub(y, vector.splat(base_y)),
        );
        let across2 = vector.add(vector.mul(dx, dx), vector.mul(dy, dy));
        let length2 = vector.add(across2, vector.splat(base_z * base_z));
        let to_light = [dx, dy, vector.splat(-base_z)];
        let cosine = vector.max(dot(vector, to_light, seen.shading_normal), zero);
        let mut weight = vector.div(cosine, vector.mul(length2, length2));
        let radius2 = match light.kind {
            EmitterKind::Rectangle => None,
            EmitterKind::Ellipse | EmitterKind::DistantDisk => {
                let (u, v) = (
                    vector.mul(x, vector.splat(1.0 / right)),
                    vector.mul(y, vector.splat(1.0 / top)),
                );
                Some(vector.add(vector.mul(u, u), vector.mul(v, v)))
            }
            EmitterKind::Sphere | EmitterKind::FacingDisk => {
                let from_middle2 = vector.add(vector.mul(x, x), vector.mul(y, y));
                let along_z = vector.sub(
                    vector.mul(x, vector.splat(base_y)),
                    vector.mul(y, vector.splat(base_x)),
                );
                let cross2 = vector.add(
                    vector.mul(from_middle2, vector.splat(base_z * base_z)),
                    vector.mul(along_z, along_z),
                );
                let rim = vector.mul(length2, vector.splat(base2 * seen.sin2_rim));
                Some(vector.div(cross2, rim))
            }
        };
        if let Some(radius2) = radius2 {
            let inside = vector.sub(vector.splat(0.5 + RIM), vector.mul(vector.splat(RIM), radius2));
            let inside = vector.min(vector.max(inside, zero), vector.splat(1.0));
            weight = vector.mul(weight, inside);
        }
        if light.tan_half_spread < f32::MAX {
            let tangent = vector.div(vector.sqrt(across2), vector.splat(base_z));
            let spread = vector.max(vector.sub(vector.splat(light.tan_half_spread), tangent), zero);
            weight = vector.mul(weight, spread);
        }
        if light.cos_cone > -1.0 {
            let [axis_x, axis_y, axis_z] = light.cone_axis;
            let along = dot(vector, to_light, [-axis_x, -axis_y, -axis_z]);
            let cos_axis = vector.div(along, vector.sqrt(length2));
            let t = vector.mul(
                vector.sub(cos_axis, vector.splat(light.cos_cone)),
                vector.splat(light.cone_sharpness),
            );
            let t = vector.min(vector.max(t, zero), vector.splat(1.0));
            let smooth = vector.mul(
                vector.mul(t, t),
                vector.sub(vector.splat(3.0), vector.mul(vector.splat(2.0), t)),
            );
            weight = vector.mul(weight, smooth);
        }
        let shown = !(hidden[first / 32] >> (first % 32));
        let sum = first / V::LANES % (MOST_LANES / V::LANES);
        open[sum] = vector.add(open[sum], vector.keep(shown, weight));
        all[sum] = vector.add(all[sum], weight);
    }
    let (open, all) = (total(vector, &open), total(vector, &all));
    if all > 0.0 { open / all } else { 1.0 }
}
