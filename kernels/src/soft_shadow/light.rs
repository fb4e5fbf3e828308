//! The light as a shading point sees it: a rectangle of the light's plane holding 256 weighted samples.
//!
//! All emitters share one form. In the axes of the view, directions from the point to the light are
//! D = (X - base_x, Y - base_y, -base_z), where (X, Y) lies on the light's plane: the plane through the eye of
//! a perspective view, the plane at unit distance of an orthographic one. Irradiance is the integral of
//! L (n . D) base_z / |D|^4 dX dY over the light.

use crate::emitter::{Emitter, EmitterKind};
use crate::vector::dot as dot64;
use crate::view::View;

pub const SAMPLES: usize = 256;

/// Row of the sample in each of the 256 columns: a scrambled (0, 2)-net, so rows and columns are distinct
/// and every dyadic box of area 1/256 holds one sample.
pub const SAMPLE_ROWS: [u8; SAMPLES] = sample_rows(SCRAMBLE);

const SCRAMBLE: u32 = 254;

/// Owen scrambling of the van der Corput sequence with Laine and Karras's hash.
const fn sample_rows(seed: u32) -> [u8; SAMPLES] {
    let mut rows = [0; SAMPLES];
    let mut column = 0;
    while column < SAMPLES {
        // Bits of the column from the lowest up decide the row from its highest bit down.
        let mut x = (column as u32).wrapping_add(seed);
        x ^= x.wrapping_mul(0x6c50_b47c);
        x ^= x.wrapping_mul(0xb82f_1e52);
        x ^= x.wrapping_mul(0xc7af_e638);
        x ^= x.wrapping_mul(0x8d22_f6e6);
        rows[column] = (x as u8).reverse_bits();
        column += 1;
    }
    rows
}

/// Smallest half-angle (tangent) a light is given, so that a light of no size casts a hard shadow.
const SMALLEST_HALF_SIZE: f32 = 1e-4;

/// A light in the axes of one view: what does not change from point to point.
#[derive(Clone, Debug)]
pub struct Light {
    pub kind: EmitterKind,
    orthographic: bool,
    /// World to view: rows right, up, forward; then where the points' origin lies in the view.
    axes: [[f64; 3]; 3],
    origin: [f64; 3],
    half_size: [f32; 2],
    pub tan_half_spread: f32,
    pub cos_cone: f32,
    /// 1 / (width of the cone's soft edge in cosines), vast for a hard one.
    pub cone_sharpness: f32,
    /// Where the cone points, in view axes.
    pub cone_axis: [f32; 3],
}

/// The light as one shading point sees it, in view axes.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Where the point projects, in window units, and its rise (see `prepare.rs`).
    pub window_x: f64,
    pub window_y: f64,
    pub rise: f32,
    /// D = (X - base.x, Y - base.y, -base.z).
    pub base: [f32; 3],
    /// Left, right, bottom, top of the samples on the light's plane; zero lies inside.
    pub bounds: [f32; 4],
    pub geometric_normal: [f32; 3],
    pub shading_normal: [f32; 3],
    /// SPHERE and FACING_DISK: smallest squared cosine between a sample and the centre.
    pub cos2_rim: f32,
    /// The point is so close that `bounds` had to be cut.
    pub too_close: bool,
}

pub fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Light {
    /// `eye`: the world position that shading points are relative to.
    pub fn new(emitter: &Emitter, view: &View, eye: [f64; 3]) -> Self {
        let axes = [view.right, view.up, view.forward];
        let offset = [0, 1, 2].map(|i| eye[i] - view.eye[i]);
        Light {
            kind: emitter.kind,
            orthographic: view.orthographic,
            axes,
            origin: axes.map(|axis| dot64(axis, offset)),
            half_size: [emitter.half_width as f32, emitter.half_height as f32],
            tan_half_spread: emitter.tan_half_spread as f32,
            cos_cone: emitter.cos_cone as f32,
            cone_sharpness: (1.0 / ((1.0 - emitter.cos_cone) * emitter.blend)).min(1e30) as f32,
            cone_axis: axes.map(|axis| dot64(axis, emitter.forward) as f32),
        }
    }

    fn turn(&self, v: [f32; 3]) -> [f32; 3] {
        self.axes.map(|axis| dot64(axis, v.map(f64::from)) as f32)
    }

    /// None: the point is not in front of the light's plane, or is not finite.
    pub fn see(
        &self,
        position: [f32; 3],
        geometric_normal: [f32; 3],
        shading_normal: [f32; 3],
    ) -> Option<Seen> {
        let position = position.map(f64::from);
        let x = dot64(self.axes[0], position) + self.origin[0];
        let y = dot64(self.axes[1], position) + self.origin[1];
        let z = dot64(self.axes[2], position) + self.origin[2];
        let mut seen = Seen {
            window_x: x,
            window_y: y,
            rise: -z as f32,
            base: [0.0, 0.0, 1.0],
            bounds: [0.0; 4],
            geometric_normal: self.turn(geometric_normal),
            shading_normal: self.turn(shading_normal),
            cos2_rim: 0.0,
            too_close: false,
        };
        if !self.orthographic {
            seen.window_x = x / z;
            seen.window_y = y / z;
            seen.rise = (1.0 / z) as f32;
            seen.base = [x as f32, y as f32, z as f32];
            if !(z > 0.0 && seen.rise.is_finite()) {
                return None;
            }
        }
        if !(x + y + z).is_finite() || seen.base[2] <= 0.0 {
            return None;
        }
        self.bound(&mut seen);
        Some(seen)
    }

    /// Sets the rectangle that holds the light's samples.
    fn bound(&self, seen: &mut Seen) {
        let [x, y, z] = seen.base;
        let smallest = SMALLEST_HALF_SIZE * z;
        if !matches!(self.kind, EmitterKind::Sphere | EmitterKind::FacingDisk) {
            let [half_width, half_height] = self.half_size.map(|half| half.max(smallest));
            seen.bounds = [-half_width, half_width, -half_height, half_height];
            return;
        }
        // A facing disk looks like the sphere whose rim it is.
        let distance2 = x * x + y * y + z * z;
        let mut sin2 = self.half_size[0] * self.half_size[0] / distance2;
        if self.kind == EmitterKind::FacingDisk {
            sin2 /= 1.0 + sin2;
        }
        let largest2 = 0.64 * z * z / distance2;
        seen.too_close = sin2 > largest2;
        sin2 = sin2.clamp(smallest * smallest / distance2, largest2);
        seen.cos2_rim = 1.0 - sin2;
        let radius2 = sin2 * distance2;
        // Planes through the point, parallel to an axis and tangent to the sphere, cut the light's plane at
        // X with X^2 (z^2 - r^2) + 2 r^2 x X - r^2 (x^2 + z^2) = 0.
        let roots = |x: f32| {
            let spread = (radius2 * (x * x + z * z - radius2).max(0.0)).sqrt() * z;
            let (middle, scale) = (-radius2 * x, 1.0 / (z * z - radius2));
            ((middle - spread) * scale, (middle + spread) * scale)
        };
        let ((left, right), (bottom, top)) = (roots(x), roots(y));
        seen.bounds = [left, right, bottom, top];
    }

    /// Irradiance per area of the light's plane at (X, Y), up to a factor that is the same for all samples.
    pub fn weight(&self, seen: &Seen, x: f32, y: f32) -> f32 {
        let to_light = seen.direction(x, y);
        let length2 = dot(to_light, to_light);
        let cosine = dot(seen.shading_normal, to_light).max(0.0);
        let inside = match self.kind {
            EmitterKind::Rectangle => true,
            EmitterKind::Ellipse | EmitterKind::DistantDisk => {
                let (u, v) = (x / seen.bounds[1], y / seen.bounds[3]);
                u * u + v * v <= 1.0
            }
            EmitterKind::Sphere | EmitterKind::FacingDisk => {
                let along = -dot(to_light, seen.base);
                along > 0.0 && along * along >= length2 * dot(seen.base, seen.base) * seen.cos2_rim
            }
        };
        if !inside {
            return 0.0;
        }
        let spread = if self.tan_half_spread < f32::MAX {
            let across = (to_light[0] * to_light[0] + to_light[1] * to_light[1]).sqrt();
            (self.tan_half_spread - across / seen.base[2]).max(0.0)
        } else {
            1.0
        };
        let cone = if self.cos_cone > -1.0 {
            let cos_axis = -dot(to_light, self.cone_axis) / length2.sqrt();
            let t = ((cos_axis - self.cos_cone) * self.cone_sharpness).clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        } else {
            1.0
        };
        cosine * spread * cone / (length2 * length2)
    }
}

impl Seen {
    /// From the shading point to (X, Y) on the light's plane.
    pub fn direction(&self, x: f32, y: f32) -> [f32; 3] {
        [x - self.base[0], y - self.base[1], -self.base[2]]
    }

    /// Where sample `i` lies on the light's plane.
    pub fn sample(&self, i: usize) -> (f32, f32) {
        let [left, right, bottom, top] = self.bounds;
        let (u, v) = (
            (i as f32 + 0.5) / SAMPLES as f32,
            (SAMPLE_ROWS[i] as f32 + 0.5) / SAMPLES as f32,
        );
        (left + u * (right - left), bottom + v * (top - bottom))
    }

    /// Smallest and largest n . D over `bounds`; the light is above the plane of `normal` where positive.
    pub fn height_range(&self, normal: [f32; 3]) -> (f32, f32) {
        let [left, right, bottom, top] = self.bounds;
        let middle = dot(normal, self.direction(0.5 * (left + right), 0.5 * (bottom + top)));
        let reach = 0.5 * (normal[0].abs() * (right - left) + normal[1].abs() * (top - bottom));
        (middle - reach, middle + reach)
    }
}
