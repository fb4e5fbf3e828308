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

/// One bit a light sample; set: hidden.
pub type Bits = [u32; SAMPLES / 32];

/// Row of the sample in each of the 256 columns, so that rows and columns are distinct. Made by
/// `scripts/build/light_samples.py`, which says how good it is; twin of samples.glsl.
#[rustfmt::skip]
pub const SAMPLE_ROWS: [u8; SAMPLES] = [
    237, 57, 15, 200, 182, 142, 74, 107, 31, 122, 216, 165, 89, 253, 47, 152,
    3, 133, 230, 101, 184, 70, 210, 32, 168, 119, 17, 84, 245, 197, 146, 51,
    227, 65, 106, 179, 130, 36, 2, 212, 163, 93, 20, 247, 193, 77, 150, 117,
    235, 59, 42, 136, 173, 205, 100, 9, 221, 83, 30, 187, 158, 255, 126, 49,
    66, 112, 234, 143, 203, 170, 19, 81, 218, 99, 34, 4, 188, 156, 242, 62,
    134, 48, 120, 226, 202, 177, 88, 28, 105, 73, 14, 149, 248, 164, 214, 44,
    132, 195, 233, 61, 109, 181, 6, 92, 24, 76, 123, 244, 153, 217, 39, 167,
    199, 139, 54, 16, 231, 103, 85, 186, 121, 68, 249, 208, 5, 40, 157, 171,
    140, 23, 222, 98, 239, 55, 82, 183, 115, 198, 11, 131, 37, 71, 250, 160,
    213, 145, 229, 95, 56, 111, 172, 27, 13, 190, 241, 127, 41, 79, 204, 147,
    220, 67, 96, 176, 8, 113, 243, 52, 161, 192, 21, 129, 35, 224, 144, 80,
    206, 97, 63, 236, 114, 174, 7, 159, 252, 43, 189, 25, 141, 215, 90, 64,
    125, 232, 108, 201, 78, 178, 46, 10, 154, 29, 251, 223, 137, 166, 94, 60,
    191, 110, 211, 0, 75, 38, 128, 240, 148, 175, 22, 50, 91, 228, 194, 116,
    207, 12, 162, 72, 254, 135, 58, 104, 180, 33, 219, 86, 151, 238, 18, 124,
    196, 45, 169, 69, 1, 102, 138, 225, 155, 118, 87, 246, 209, 185, 26, 53,
];

/// Steepness of a round light's rim: a sample stands for the area around it, so that its weight falls from 1 to 0
/// over about the distance to the next, rather than at once. Per square of the share of the radius.
pub const RIM: f32 = 2.5;

/// Share of its coordinates, turned into the view, by which a point's depth there may be off: the rounding of the
/// coordinates themselves, of the map's depths, and on a GPU of each product on the way, about 16 halves of the last
/// place in all. Nothing else keeps a surface that is parallel to the light's plane from shading itself.
const ROUNDING: f64 = 1e-6;

/// Smallest half-angle (tangent) a light is given, so that a light of no size casts a hard shadow.
const SMALLEST_HALF_SIZE: f32 = 1e-5;

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
    /// Where the point projects, in window units, and its rise (see `level.rs`).
    pub window_x: f64,
    pub window_y: f64,
    pub rise: f32,
    /// By how much the rise of the point and that of its own surface in a map may differ from rounding alone.
    pub rounding: f32,
    /// D = (X - base.x, Y - base.y, -base.z).
    pub base: [f32; 3],
    /// Left, right, bottom, top of the samples on the light's plane; zero lies inside.
    pub bounds: [f32; 4],
    pub geometric_normal: [f32; 3],
    pub shading_normal: [f32; 3],
    /// SPHERE and FACING_DISK: squared sine of the half-angle.
    pub sin2_rim: f32,
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
        let terms: f64 = (0..3).map(|i| (self.axes[2][i] * position[i]).abs()).sum();
        let rounding = ROUNDING * (terms + self.origin[2].abs());
        let mut seen = Seen {
            window_x: x,
            window_y: y,
            rise: -z as f32,
            rounding: rounding as f32,
            base: [0.0, 0.0, 1.0],
            bounds: [0.0; 4],
            geometric_normal: self.turn(geometric_normal),
            shading_normal: self.turn(shading_normal),
            sin2_rim: 0.0,
            too_close: false,
        };
        if !self.orthographic {
            seen.window_x = x / z;
            seen.window_y = y / z;
            seen.rise = (1.0 / z) as f32;
            seen.rounding = (rounding / (z * z)) as f32;
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
        seen.sin2_rim = sin2;
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

    /// False only where no sample has a weight: the point is below the horizon of its shading normal, or outside the
    /// light's cone by more than the light's own size.
    pub fn reaches(&self, seen: &Seen) -> bool {
        // Written so that a NaN in a normal reads as no light.
        let above = seen.height_range(seen.shading_normal).1 > 0.0;
        above && (self.cos_cone <= -1.0 || self.is_in_cone(seen))
    }

    /// Whether the light's middle is seen within the cone's angle and that of the rim, which is soft.
    fn is_in_cone(&self, seen: &Seen) -> bool {
        let sin2_rim = seen.sin2_rim * (1.0 + 0.5 / RIM);
        let sin2_cone = 1.0 - self.cos_cone * self.cos_cone;
        let cos_both = self.cos_cone * (1.0 - sin2_rim).max(0.0).sqrt() - (sin2_cone * sin2_rim).sqrt();
        let along = dot(seen.base, self.cone_axis);
        // Less than a hundred-thousandth is rounding.
        along >= (cos_both - 1e-5) * dot(seen.base, seen.base).sqrt()
    }

    /// Irradiance per area of the light's plane at (X, Y), up to a factor that is the same for all samples.
    pub fn weight(&self, seen: &Seen, x: f32, y: f32) -> f32 {
        let to_light = seen.direction(x, y);
        let length2 = dot(to_light, to_light);
        let cosine = dot(seen.shading_normal, to_light).max(0.0);
        // Squared share of the way from the middle to the rim.
        let radius2 = match self.kind {
            EmitterKind::Rectangle => 0.0,
            EmitterKind::Ellipse | EmitterKind::DistantDisk => {
                let (u, v) = (x / seen.bounds[1], y / seen.bounds[3]);
                u * u + v * v
            }
            EmitterKind::Sphere | EmitterKind::FacingDisk => {
                // The sine from the cross product with the direction to the middle: exact for the smallest lights.
                let [base_x, base_y, base_z] = seen.base;
                let along_z = x * base_y - y * base_x;
                let cross2 = (x * x + y * y) * (base_z * base_z) + along_z * along_z;
                cross2 / (length2 * (dot(seen.base, seen.base) * seen.sin2_rim))
            }
        };
        let inside = (0.5 + RIM * (1.0 - radius2)).clamp(0.0, 1.0);
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
        cosine * inside * spread * cone / (length2 * length2)
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
