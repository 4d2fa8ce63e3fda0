//! The backbone's curve between the discs.
//!
//! Between the origins of two neighbouring bodies the curve is the cubic (Hermite) that leaves the lower and meets the upper
//! one along their z axes; its frames turn from one's to the other's by the shortest rotation, corrected so that their z axis
//! is the curve's tangent. Of a smooth curve whose points and frames are exact, that misses points with the fourth and
//! frames with the second power of the pitch. So for a chain that stands for a continuous rod, the joints half a pitch below the
//! discs' origins, points and frames are of second order in the pitch, as the discs' are.
//!
//! ```
//! use tdcr_sim::curve::BackboneCurve;
//! use tdcr_sim::robot::{Loads, Robot};
//!
//! let robot = Robot::load("2m")?;
//! let settled = robot.settle(&robot.mean_command(), &Loads::default());
//! let curve = BackboneCurve::new(&robot, &settled.pose());
//! let middle = curve.at(0.5 * curve.length()).expect("on the curve");
//! println!("{} m, along {}", middle.translation.vector, middle * nalgebra::Vector3::z());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::pose::Pose;
use crate::robot::Robot;

/// The curve of a robot's backbone in one pose, by arc length.
#[derive(Clone, Debug)]
pub struct BackboneCurve {
    robot: Robot,
    /// Arc length of each body's origin (m), the base's first.
    arc_lengths: Vec<f64>,
    /// Frame of each body in the world (m).
    frames: Vec<Isometry3<f64>>,
}

impl BackboneCurve {
    /// The curve of `robot` where `pose` is.
    ///
    /// # Panics
    /// If the pose is of a robot with another number of discs.
    pub fn new(robot: &Robot, pose: &Pose) -> Self {
        let n = robot.discs().len();
        assert_eq!(pose.positions.len(), n, "a pose of this robot");
        let base = Isometry3::from_parts(robot.base().into(), robot.base_orientation());
        let mut arc_lengths = vec![0.0];
        arc_lengths.extend(robot.arc_lengths());
        let discs = (0..n).map(|disc| pose.disc(disc));
        Self {
            robot: robot.clone(),
            arc_lengths,
            frames: std::iter::once(base).chain(discs).collect(),
        }
    }

    /// Length of the backbone (m), from the base's origin to that of the last disc.
    pub fn length(&self) -> f64 {
        self.arc_lengths.last().copied().unwrap_or(0.0)
    }

    /// The frame at `arc_length` (m) from the base, in the world: its origin on the curve, its z axis along it. `None` beyond
    /// the ends.
    pub fn at(&self, arc_length: f64) -> Option<Isometry3<f64>> {
        let arc_length = self.robot.on_backbone(arc_length)?;
        let pieces = self.arc_lengths.len() - 1;
        let above = self.arc_lengths.partition_point(|s| *s <= arc_length);
        let upper = above.clamp(1, pieces);
        let [from, to] = [self.arc_lengths[upper - 1], self.arc_lengths[upper]];
        let piece = Piece {
            length: to - from,
            lower: &self.frames[upper - 1],
            upper: &self.frames[upper],
        };
        Some(piece.at((arc_length - from) / (to - from)))
    }

    /// `count` frames at equal distances, from the base's to the last disc's; the base's alone for one.
    pub fn sample(&self, count: usize) -> Vec<Isometry3<f64>> {
        let step = self.length() / count.saturating_sub(1).max(1) as f64;
        let place = |index: usize| f64::min(index as f64 * step, self.length());
        (0..count)
            .filter_map(|index| self.at(place(index)))
            .collect()
    }
}

/// The curve between two neighbouring bodies.
struct Piece<'a> {
    /// m.
    length: f64,
    lower: &'a Isometry3<f64>,
    upper: &'a Isometry3<f64>,
}

impl Piece<'_> {
    /// The frame at a share of the way.
    fn at(&self, t: f64) -> Isometry3<f64> {
        let (p, q) = (
            &self.lower.translation.vector,
            &self.upper.translation.vector,
        );
        let [u, v] = [self.lower, self.upper].map(|frame| frame * Vector3::z() * self.length);
        let s = 1.0 - t;
        let point = p * (s * s * (1.0 + 2.0 * t)) + q * (t * t * (1.0 + 2.0 * s)) + u * (t * s * s)
            - v * (t * t * s);
        let tangent =
            (q - p) * (6.0 * t * s) + u * (s * (1.0 - 3.0 * t)) + v * (t * (1.0 - 3.0 * s));
        // The lower body's frame turned towards the upper one's, along the shorter way.
        let turn = (self.lower.rotation.inverse() * self.upper.rotation).scaled_axis();
        let between = self.lower.rotation * UnitQuaternion::from_scaled_axis(turn * t);
        let onto = UnitQuaternion::rotation_between(&(between * Vector3::z()), &tangent);
        Isometry3::from_parts(point.into(), onto.unwrap_or_default() * between)
    }
}
