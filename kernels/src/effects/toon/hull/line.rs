//! How wide a line is, and where that moves a vertex to.

use crate::vector::{Vec3, add, dot, scale, unit};
use crate::view::View;

/// A round strip's ring may be narrower than the line by this many pixels, between its directions.
const FLAT_PIXELS: f64 = 0.05;
/// The angles between two directions of a strip, radians, that this may lead to: 2 to 30 degrees.
const STRIP_ANGLES: [f64; 2] = [std::f64::consts::PI / 90.0, std::f64::consts::FRAC_PI_6];

/// What moves away from the eye appears to move less the farther it is; beyond four times as far it is let be.
const LEAST_APPROACH: f64 = 0.25;

/// How wide a line is.
pub struct Width {
    /// Metres, or pixels.
    pub width: f64,
    pub in_pixels: bool,
    /// Limits, pixels.
    pub least: f64,
    pub most: f64,
}

impl Width {
    /// Pixels of a line that is `wanted` metres or pixels wide where a pixel is `pixel` metres.
    fn pixels(&self, wanted: f64, pixel: f64) -> f64 {
        let pixels = if self.in_pixels { wanted } else { wanted / pixel };
        pixels.clamp(self.least, self.most)
    }
}

pub struct Eye {
    pub view: View,
    /// Window units of a pixel.
    pub pixel: f64,
}

/// A welded vertex, and how far it moves.
pub struct Place {
    /// Relative to the eye.
    pub point: Vec3,
    /// Towards it from the eye, unit; None in an orthographic view.
    ray: Option<Vec3>,
    /// Metres of a pixel beside it that is seen straight on.
    pixel: f64,
    /// Width of the line, metres or pixels; 0 for none.
    pub wanted: f64,
}

impl Eye {
    /// How much a triangle or a strip at `p`, relative to the eye, faces away with the outward normal `n`: less than 0
    /// where it faces the eye.
    pub fn facing(&self, p: Vec3, n: Vec3) -> f64 {
        let towards = if self.view.orthographic {
            self.view.forward
        } else {
            p
        };
        dot(towards, n)
    }

    pub fn faces_away(&self, p: Vec3, n: Vec3) -> bool {
        self.facing(p, n) > 0.0
    }

    /// A vertex where the line is `wanted` wide.
    pub fn place(&self, point: Vec3, wanted: f64) -> Place {
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
    pub fn moved(&self, width: &Width, place: &Place, direction: Vec3) -> Vec3 {
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

    /// Metres that a vertex is moved by at most, in whichever direction.
    pub fn reach(&self, width: &Width, place: &Place) -> f64 {
        let metres = width.pixels(place.wanted, place.pixel) * place.pixel;
        metres.max(if width.in_pixels { 0.0 } else { place.wanted }) / LEAST_APPROACH
    }

    /// The largest angle between two directions of a strip at a vertex.
    pub fn strip_angle(&self, width: &Width, place: &Place) -> f64 {
        let pixels = width.pixels(place.wanted, place.pixel);
        let [least, most] = STRIP_ANGLES;
        (2.0 * (1.0 - FLAT_PIXELS / pixels).clamp(-1.0, 1.0).acos()).clamp(least, most)
    }
}
