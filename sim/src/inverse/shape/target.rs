//! What a shape is asked for: targets for discs.

use nalgebra::{Matrix3xX, Unit, UnitQuaternion, Vector3};

use crate::backbone::{inverse_right_jacobian, rotation_vector};
use crate::robot::Robot;
use crate::statics::Equilibrium;

/// A target for one disc. For a position and an orientation, ask for both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// The disc, from 0 at the base.
    pub disc: usize,
    /// Where or how it should be.
    pub goal: Goal,
    /// Weight of its squared error among those of the other targets, above 0.
    pub weight: f64,
}

/// Where or how a disc should be, in the world frame. Turns count as lengths, by a lever: an error of
/// one radian is one of `lever` metres.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// Its origin there (m).
    Position(Vector3<f64>),
    /// Its z axis, along the backbone, in this direction.
    Direction {
        /// The direction.
        axis: Unit<Vector3<f64>>,
        /// The lever (m).
        lever: f64,
    },
    /// Turned so.
    Orientation {
        /// The orientation.
        orientation: UnitQuaternion<f64>,
        /// The lever (m).
        lever: f64,
    },
}

impl Target {
    /// A disc's origin at `position` (m), with weight 1.
    pub fn position(disc: usize, position: Vector3<f64>) -> Self {
        Self {
            disc,
            goal: Goal::Position(position),
            weight: 1.0,
        }
    }

    /// The origin of the robot's distal disc at `position` (m), with weight 1.
    pub fn tip(robot: &Robot, position: Vector3<f64>) -> Self {
        Self::position(robot.discs().len() - 1, position)
    }

    /// Every disc's origin on a curve, at its distance from the base origin along the straight
    /// backbone: `curve` takes that distance (m) to a position (m).
    pub fn along(robot: &Robot, curve: impl Fn(f64) -> Vector3<f64>) -> Vec<Self> {
        let mut distance = 0.0;
        let target = |(disc, laid): (usize, &crate::robot::Disc)| {
            distance += laid.offset.norm();
            Self::position(disc, curve(distance))
        };
        robot.discs().iter().enumerate().map(target).collect()
    }

    /// Why no such target can be met; `None` if it might.
    pub(super) fn fault(&self, robot: &Robot) -> Option<&'static str> {
        let finite = match self.goal {
            Goal::Position(position) => position.iter().all(|x| x.is_finite()),
            Goal::Direction { axis, lever } => {
                lever > 0.0 && lever.is_finite() && axis.iter().all(|x| x.is_finite())
            }
            Goal::Orientation { orientation, lever } => {
                lever > 0.0 && lever.is_finite() && orientation.coords.iter().all(|x| x.is_finite())
            }
        };
        if self.disc >= robot.discs().len() {
            Some("the robot has no such disc; discs are counted from 0")
        } else if !finite {
            Some("positions, directions and orientations are finite numbers, and levers above 0")
        } else if !(self.weight > 0.0 && self.weight.is_finite()) {
            Some("weights are finite numbers above 0")
        } else {
            None
        }
    }

    /// Error of the disc's pose (m), a vector in the world frame.
    pub(super) fn error(&self, equilibrium: &Equilibrium) -> Vector3<f64> {
        let orientation = &equilibrium.orientations[self.disc];
        match self.goal {
            Goal::Position(position) => equilibrium.positions[self.disc] - position,
            Goal::Direction { axis, lever } => {
                (orientation * Vector3::z() - axis.into_inner()) * lever
            }
            Goal::Orientation {
                orientation: wanted,
                lever,
            } => rotation_vector(&(orientation * wanted.inverse())) * lever,
        }
    }

    /// The error's Jacobian, from the disc's rows of [`Sensitivity::command_jacobian`]: those of its
    /// origin and of its rotation.
    ///
    /// [`Sensitivity::command_jacobian`]: crate::sensitivity::Sensitivity::command_jacobian
    pub(super) fn error_jacobian(
        &self,
        equilibrium: &Equilibrium,
        [moved, turned]: [Matrix3xX<f64>; 2],
    ) -> Matrix3xX<f64> {
        let orientation = &equilibrium.orientations[self.disc];
        match self.goal {
            Goal::Position(_) => moved,
            Goal::Direction { lever, .. } => {
                (orientation * Vector3::z()).cross_matrix() * turned * -lever
            }
            // A turn from the left moves a rotation vector by the inverse left Jacobian, the transpose
            // of the right one.
            Goal::Orientation {
                orientation: wanted,
                lever,
            } => {
                let error = rotation_vector(&(orientation * wanted.inverse()));
                inverse_right_jacobian(&error).0.transpose() * turned * lever
            }
        }
    }
}
