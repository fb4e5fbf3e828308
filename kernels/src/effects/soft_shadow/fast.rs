//! The bitmask method, a register of texels or samples at a time. Hides the same samples as `plain.rs`.

use super::level::{BLOCK, BLOCK_TEXELS};
use super::light::{Bits, Light, RIM, SAMPLE_ROWS, SAMPLES, Seen};
use super::plain::{LOWEST_EDGE, OWN_SURFACE};
use super::prepare::PreparedMap;
use super::window::Window;
use crate::emitter::EmitterKind;
use crate::simd::{Eight, LANES, Simd, Vector};

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
const COLUMNS: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0,
];
const ROWS: [f32; LANES] = [
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
    let covered = offset / vector.max(above, lowest) - vector.splat(start);
    let sample = covered * vector.splat(samples);
    let clamped = vector.min(
        vector.max(sample, vector.splat(0.0)),
        vector.splat(SAMPLES as f32),
    );
    clamped + vector.splat(ROUND)
}

#[inline(always)]
fn dot<V: Vector>(vector: V, a: [V::Floats; 3], b: [f32; 3]) -> V::Floats {
    let x = a[0] * vector.splat(b[0]);
    let y = a[1] * vector.splat(b[1]);
    x + y + a[2] * vector.splat(b[2])
}

/// Sums over all lanes, in the same order whatever their number.
#[inline(always)]
fn total<V: Vector>(vector: V, sums: &[V::Floats; LANES]) -> f32 {
    let mut total = 0.0;
    for sum in &sums[..LANES / V::LANES] {
        let mut lanes = [0.0; LANES];
        vector.store(*sum, &mut lanes);
        for lane in &lanes[..V::LANES] {
            total += lane;
        }
    }
    total
}

/// The samples from one rounded rank up to another, or the other way round.
#[inline(always)]
fn bits_between<E: Eight>(eight: E, prefixes: &Prefixes, low: f32, high: f32) -> E::Ints {
    let (low, high) = (&prefixes.0[rank(low)], &prefixes.0[rank(high)]);
    eight.xor_ints(eight.load_ints(low), eight.load_ints(high))
}

/// A bit a sample, in a register.
type Hidden<S> = <<S as Simd>::Eight as Eight>::Ints;

/// As `plain::backproject`, for one block whose first texel is at `row` and `column`. `inner`: the inner window
/// from the point, if it reaches into the block.
#[inline(always)]
pub fn backproject_block<S: Simd>(
    simd: S,
    map: &PreparedMap,
    seen: &Seen,
    place: &Place,
    block: usize,
    [row, column]: [usize; 2],
    inner: Option<Window<f32>>,
    mut hidden: Hidden<S>,
) -> Hidden<S> {
    let (vector, eight) = (simd.widest(), simd.eight());
    let level = &map.levels[place.level];
    let texels = block * BLOCK_TEXELS..(block + 1) * BLOCK_TEXELS;
    let (rises, tilts) = (&level.rise[texels.clone()], &level.tilt[texels]);
    let [left, right, bottom, top] = seen.bounds;
    let zero = vector.splat(0.0);
    let du = vector.splat(column as f32) + vector.load(&COLUMNS) - vector.splat(place.u);
    let from_x = du * vector.splat(place.texel_x);
    let to_x = (du + vector.splat(1.0)) * vector.splat(place.texel_x);
    let mid_x = (du + vector.splat(0.5)) * vector.splat(place.texel_x);
    let [base_x, base_y, base_z] = seen.base;
    let [normal_x, normal_y, normal_z] = seen.geometric_normal;
    let mut ranks = [[0.0; LANES]; 4];
    for first in (0..BLOCK_TEXELS).step_by(S::Widest::LANES) {
        let rise = vector.load(&rises[first..]);
        let above = rise - vector.splat(seen.rise);
        let mut found = vector.greater(above, vector.splat(place.above_from))
            & !vector.greater(above, vector.splat(place.above_to));
        if found & S::Widest::ALL == 0 {
            continue;
        }
        // Do rays from the light to the point meet it?
        let in_block = vector.splat((row + first / BLOCK) as f32) + vector.load(&ROWS);
        let dv = in_block - vector.splat(place.v);
        let from_y = dv * vector.splat(place.texel_y);
        let to_y = (dv + vector.splat(1.0)) * vector.splat(place.texel_y);
        found &= vector.greater(vector.splat(right) * above, from_x)
            & vector.greater(to_x, vector.splat(left) * above)
            & vector.greater(vector.splat(top) * above, from_y)
            & vector.greater(to_y, vector.splat(bottom) * above);
        if let Some([left, right, bottom, top]) = inner {
            let outside = vector.greater(vector.splat(left), from_x)
                | vector.greater(to_x, vector.splat(right))
                | vector.greater(vector.splat(bottom), from_y)
                | vector.greater(to_y, vector.splat(top));
            found &= outside;
        }
        if found & S::Widest::ALL == 0 {
            continue;
        }
        let [tilt_x, tilt_y] = vector.load_halves(&tilts[first..]);
        let slope = vector.max(vector.abs(tilt_x), vector.abs(tilt_y));
        let metre = if map.view.orthographic {
            vector.splat(1.0)
        } else {
            rise * rise
        };
        let bias = vector.min(
            vector.splat(map.bias.gradient_scale) * slope,
            vector.splat(map.bias.gradient_cap) * metre,
        );
        found &= vector.greater(above, vector.max(bias, vector.splat(seen.rounding)));
        // Is it above the point's tangent plane?
        let mid_y = (dv + vector.splat(0.5)) * vector.splat(place.texel_y);
        let direction_x = mid_x - above * vector.splat(base_x);
        let direction_y = mid_y - above * vector.splat(base_y);
        let direction_z = zero - above * vector.splat(base_z);
        let length = vector.abs(direction_x) + vector.abs(direction_y) + vector.abs(direction_z);
        let height = vector.splat(normal_x) * direction_x
            + vector.splat(normal_y) * direction_y
            + vector.splat(normal_z) * direction_z;
        found &= vector.greater(height, vector.splat(OWN_SURFACE) * length);
        if found & S::Widest::ALL == 0 {
            continue;
        }
        let (half_x, half_y) = (vector.splat(0.5) * tilt_x, vector.splat(0.5) * tilt_y);
        let lowest = vector.splat(LOWEST_EDGE) * above;
        let (x, y) = ([left, place.samples_x], [bottom, place.samples_y]);
        let x0 = edge(vector, from_x, above - half_x, lowest, x);
        let x1 = edge(vector, to_x, above + half_x, lowest, x);
        let y0 = edge(vector, from_y, above - half_y, lowest, y);
        let y1 = edge(vector, to_y, above + half_y, lowest, y);
        let (low_x, high_x) = (vector.min(x0, x1), vector.max(x0, x1));
        let (low_y, high_y) = (vector.min(y0, y1), vector.max(y0, y1));
        found &= vector.greater(high_x, low_x) & vector.greater(high_y, low_y) & S::Widest::ALL;
        if found == 0 {
            continue;
        }
        vector.store(low_x, &mut ranks[0]);
        vector.store(high_x, &mut ranks[1]);
        vector.store(low_y, &mut ranks[2]);
        vector.store(high_y, &mut ranks[3]);
        while found != 0 {
            let lane = found.trailing_zeros() as usize % LANES;
            found &= found - 1;
            let columns = bits_between(eight, &FIRST_COLUMNS, ranks[0][lane], ranks[1][lane]);
            let rows = bits_between(eight, &FIRST_ROWS, ranks[2][lane], ranks[3][lane]);
            hidden = eight.or_ints(hidden, eight.and_ints(columns, rows));
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
        vector.splat(left) + x * vector.splat(right - left),
        vector.splat(bottom) + y * vector.splat(top - bottom),
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
        let height = vector.splat(normal_x) * (x - vector.splat(base_x))
            + vector.splat(normal_y) * (y - vector.splat(base_y))
            + vector.splat(normal_z * -base_z);
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
    let mut open = [zero; LANES];
    let mut all = [zero; LANES];
    for first in (0..SAMPLES).step_by(V::LANES) {
        let [x, y] = samples(vector, seen, first);
        let (dx, dy) = (x - vector.splat(base_x), y - vector.splat(base_y));
        let across2 = dx * dx + dy * dy;
        let length2 = across2 + vector.splat(base_z * base_z);
        let to_light = [dx, dy, vector.splat(-base_z)];
        let cosine = vector.max(dot(vector, to_light, seen.shading_normal), zero);
        let mut weight = cosine / (length2 * length2);
        let radius2 = match light.kind {
            EmitterKind::Rectangle => None,
            EmitterKind::Ellipse | EmitterKind::DistantDisk => {
                let (u, v) = (x * vector.splat(1.0 / right), y * vector.splat(1.0 / top));
                Some(u * u + v * v)
            }
            EmitterKind::Sphere | EmitterKind::FacingDisk => {
                let from_middle2 = x * x + y * y;
                let along_z = x * vector.splat(base_y) - y * vector.splat(base_x);
                let cross2 = from_middle2 * vector.splat(base_z * base_z) + along_z * along_z;
                let rim = length2 * vector.splat(base2 * seen.sin2_rim);
                Some(cross2 / rim)
            }
        };
        if let Some(radius2) = radius2 {
            let inside = vector.splat(0.5 + RIM) - vector.splat(RIM) * radius2;
            let inside = vector.min(vector.max(inside, zero), vector.splat(1.0));
            weight = weight * inside;
        }
        if light.tan_half_spread < f32::MAX {
            let tangent = vector.sqrt(across2) / vector.splat(base_z);
            let spread = vector.max(vector.splat(light.tan_half_spread) - tangent, zero);
            weight = weight * spread;
        }
        if light.cos_cone > -1.0 {
            let [axis_x, axis_y, axis_z] = light.cone_axis;
            let along = dot(vector, to_light, [-axis_x, -axis_y, -axis_z]);
            let cos_axis = along / vector.sqrt(length2);
            let t = (cos_axis - vector.splat(light.cos_cone)) * vector.splat(light.cone_sharpness);
            let t = vector.min(vector.max(t, zero), vector.splat(1.0));
            let smooth = t * t * (vector.splat(3.0) - vector.splat(2.0) * t);
            weight = weight * smooth;
        }
        let shown = !(hidden[first / 32] >> (first % 32));
        let sum = first / V::LANES % (LANES / V::LANES);
        open[sum] = open[sum] + vector.keep(shown, weight);
        all[sum] = all[sum] + weight;
    }
    let (open, all) = (total(vector, &open), total(vector, &all));
    if all > 0.0 { open / all } else { 1.0 }
}
