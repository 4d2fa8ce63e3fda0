//! What a camera's lens does: pinhole intrinsics and distortion.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

/// Intrinsics of a camera (pixels). Pixel `(u, v)`, column and row, has its centre at integer
/// coordinates; a point `(x, y, z)` of the camera frame is seen at `(fx x' + cx, fy y' + cy)`, where
/// `(x', y')` is the [`distorted`](Distortion::distort) `(x / z, y / z)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Image width.
    pub width: u32,
    /// Image height.
    pub height: u32,
    /// Horizontal focal length.
    pub fx: f64,
    /// Vertical focal length.
    pub fy: f64,
    /// Column of the principal point.
    pub cx: f64,
    /// Row of the principal point.
    pub cy: f64,
    /// What the lens does besides; a pinhole where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
}

impl Intrinsics {
    /// A pinhole with square pixels and a centred principal point, for a vertical field of view
    /// `fovy` (rad).
    pub fn from_fovy(width: u32, height: u32, fovy: f64) -> Self {
        let focal = f64::from(height) / (2.0 * (fovy / 2.0).tan());
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: (f64::from(width) - 1.0) / 2.0,
            cy: (f64::from(height) - 1.0) / 2.0,
            distortion: None,
        }
    }

    /// The normalised coordinates `(x / z, y / z)` seen at pixel coordinates `(u, v)`.
    #[inline]
    pub fn normalised(&self, u: f64, v: f64) -> Vector2<f64> {
        let seen = Vector2::new((u - self.cx) / self.fx, (v - self.cy) / self.fy);
        match &self.distortion {
            None => seen,
            Some(distortion) => distortion.undistort(seen),
        }
    }

    /// The pixel coordinates at which the normalised coordinates `(x / z, y / z)` are seen.
    #[inline]
    pub fn pixel(&self, normalised: Vector2<f64>) -> (f64, f64) {
        let seen = match &self.distortion {
            None => normalised,
            Some(distortion) => distortion.distort(normalised),
        };
        (self.fx * seen.x + self.cx, self.fy * seen.y + self.cy)
    }

    /// Whether each pixel sees one direction, and neighbouring pixels neighbouring ones: false where
    /// the distortion folds the picture.
    pub(crate) fn sees_each_direction_once(&self) -> bool {
        const STEPS: u32 = 32;
        let Some(distortion) = &self.distortion else {
            return true;
        };
        let along =
            |side: u32, step: u32| f64::from(side) * f64::from(step) / f64::from(STEPS) - 0.5;
        (0..=STEPS).all(|row| {
            (0..=STEPS).all(|column| {
                let (u, v) = (along(self.width, column), along(self.height, row));
                distortion.unfolds(Vector2::new(
                    (u - self.cx) / self.fx,
                    (v - self.cy) / self.fy,
                ))
            })
        })
    }
}

/// Brown and Conrady's model of a lens: with `r² = x² + y²`,
///
/// `x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)`,
/// `y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y`,
///
/// in normalised coordinates, as OpenCV's `calib3d` defines its first five coefficients. Those that
/// a file does not give are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Distortion {
    /// Radial, of `r²`.
    pub k1: f64,
    /// Radial, of `r⁴`.
    pub k2: f64,
    /// Tangential, across y.
    pub p1: f64,
    /// Tangential, across x.
    pub p2: f64,
    /// Radial, of `r⁶`.
    pub k3: f64,
}

/// Steps of Newton's method that undo a distortion: they converge quadratically, or not at all.
const MAX_STEPS: usize = 20;

impl Distortion {
    /// The coefficients in OpenCV's order `k1, k2, p1, p2, k3`.
    pub fn coefficients(&self) -> [f64; 5] {
        [self.k1, self.k2, self.p1, self.p2, self.k3]
    }

    /// Where the lens shows what a pinhole would show at `point` (normalised coordinates).
    pub fn distort(&self, point: Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (point.x, point.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        Vector2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    /// What a pinhole would show where the lens shows `seen`: the inverse of [`distort`], by Newton's
    /// method from `seen` itself.
    ///
    /// [`distort`]: Self::distort
    pub fn undistort(&self, seen: Vector2<f64>) -> Vector2<f64> {
        let mut point = seen;
        for _ in 0..MAX_STEPS {
            let Some(inverse) = self.jacobian(point).try_inverse() else {
                break;
            };
            let step = inverse * (self.distort(point) - seen);
            point -= step;
            if step.amax() <= 4.0 * f64::EPSILON * (1.0 + point.amax()) {
                break;
            }
        }
        point
    }

    /// Derivative of the distorted by the undistorted coordinates.
    pub fn jacobian(&self, point: Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (point.x, point.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let across = x * y * slope + 2.0 * (self.p1 * x + self.p2 * y);
        Matrix2::new(
            radial + x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            across,
            across,
            radial + y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        )
    }

    /// Whether `seen` comes from a point whose way to the optical axis is not folded.
    fn unfolds(&self, seen: Vector2<f64>) -> bool {
        let point = self.undistort(seen);
        let found = (self.distort(point) - seen).amax() <= 1e-12 * (1.0 + seen.amax());
        found
            && (0..=16).all(|step| {
                let jacobian = self.jacobian(point * (f64::from(step) / 16.0));
                jacobian.determinant() > 0.0 && jacobian.trace() > 0.0
            })
    }

    /// Bounds `[[low, high]; 2]` on the distorted coordinates of all points within bounds on the
    /// undistorted ones, by interval arithmetic: never too narrow.
    pub(crate) fn bounds(&self, [x, y]: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
        let [x, y] = [Interval(x), Interval(y)];
        let (xx, yy, xy) = (x.squared(), y.squared(), x * y);
        let r2 = xx + yy;
        let constant = |value: f64| Interval([value; 2]);
        let [k1, k2, p1, p2, k3] = self.coefficients().map(constant);
        let radial = constant(1.0) + r2 * (k1 + r2 * (k2 + r2 * k3));
        let two = constant(2.0);
        let seen_x = x * radial + two * p1 * xy + p2 * (r2 + two * xx);
        let seen_y = y * radial + p1 * (r2 + two * yy) + two * p2 * xy;
        [seen_x.0, seen_y.0]
    }
}

/// A closed interval of numbers.
#[derive(Clone, Copy)]
struct Interval([f64; 2]);

impl Interval {
    fn squared(self) -> Self {
        let [low, high] = self.0;
        let [a, b] = [low * low, high * high];
        let least = if low <= 0.0 && high >= 0.0 {
            0.0
        } else {
            a.min(b)
        };
        Self([least, a.max(b)])
    }
}

impl std::ops::Add for Interval {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }
}

impl std::ops::Mul for Interval {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        let products = [a * c, a * d, b * c, b * d];
        Self([
            products.into_iter().fold(f64::INFINITY, f64::min),
            products.into_iter().fold(f64::NEG_INFINITY, f64::max),
        ])
    }
}
