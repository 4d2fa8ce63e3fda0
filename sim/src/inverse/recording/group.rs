//! Groups of unknowns that users choose by name.

use std::fmt;

use serde::Serialize;

use super::Order;
use crate::robot::{ModuleSpec, RobotSpec};

/// Unknowns of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Group {
    /// The servos' gains: one for each tendon, and a factor for all.
    SpoolRadius,
    /// The servos' offsets, above 0 pretension, below 0 slack: one for each tendon.
    Pretension,
    /// The servos' backlash: one for each tendon.
    Backlash,
    /// How far positions are behind the servos: one for all.
    Lag,
    /// The rotation of each tendon's holes about the axis, in all bodies alike.
    HoleAngles,
    /// The distance of the holes from the axis: one factor for each module, the base with the first.
    HoleRadius,
    /// The rotation of the discs about the axis, even along each module.
    Twist,
    /// Bending stiffness: one factor for each module.
    Stiffness,
    /// Torsion stiffness: one factor for each module.
    Torsion,
    /// The bend at rest about the discs' x and y axes, even along each module.
    RestBend,
    /// Stiffness of tendons and drives in series: one for the tendons that end at the same module.
    TendonStiffness,
    /// How tendons stiffen as they are stretched: one for the tendons that end at the same module.
    TendonStiffening,
    /// Friction in the holes: one coefficient for the tendons that end at the same module. The recording is then replayed as a path.
    Friction,
    /// The base's position and orientation in the world.
    BasePose,
    /// The markers' positions on their discs.
    MarkerOffset,
    /// The direction of gravity.
    Gravity,
    /// The mass of the discs, the rod's included: one factor for each module.
    Mass,
}

impl Group {
    /// All groups.
    pub const ALL: [Self; 17] = [
        Self::SpoolRadius,
        Self::Pretension,
        Self::Backlash,
        Self::Lag,
        Self::HoleAngles,
        Self::HoleRadius,
        Self::Twist,
        Self::Stiffness,
        Self::Torsion,
        Self::RestBend,
        Self::TendonStiffness,
        Self::TendonStiffening,
        Self::Friction,
        Self::BasePose,
        Self::MarkerOffset,
        Self::Gravity,
        Self::Mass,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::SpoolRadius => "spool_radius",
            Self::Pretension => "pretension",
            Self::Backlash => "backlash",
            Self::Lag => "lag",
            Self::HoleAngles => "hole_angles",
            Self::HoleRadius => "hole_radius",
            Self::Twist => "twist",
            Self::Stiffness => "stiffness",
            Self::Torsion => "torsion",
            Self::RestBend => "rest_bend",
            Self::TendonStiffness => "tendon_stiffness",
            Self::TendonStiffening => "tendon_stiffening",
            Self::Friction => "friction",
            Self::BasePose => "base_pose",
            Self::MarkerOffset => "marker_offset",
            Self::Gravity => "gravity",
            Self::Mass => "mass",
        }
    }

    /// Why a robot, or a recording whose rows are in `order`, has none of its unknowns; `None` where it may have some.
    pub fn missing(self, robot: &RobotSpec, order: Order) -> Option<&'static str> {
        let elastic = |module: &ModuleSpec| module.backbone.is_some() || module.rod.is_some();
        let (has, reason) = match self {
            Self::Twist | Self::Stiffness | Self::Torsion | Self::RestBend => (
                robot.modules.iter().any(elastic),
                "no module has a backbone or a rod",
            ),
            Self::TendonStiffness | Self::TendonStiffening => (
                robot.tendons().iter().any(|tendon| tendon.stretches()),
                "no tendon has a stiffness: expected a drive with a gain, or an axial_stiffness",
            ),
            Self::Gravity | Self::Mass => (
                robot.gravity != [0.0; 3],
                "the robot's gravity is zero, which has no direction, and pulls on no mass",
            ),
            Self::Backlash | Self::Lag | Self::Friction => (
                order == Order::Motion,
                "each row is the robot at rest, which does not tell how it came there",
            ),
            _ => return None,
        };
        (!has).then_some(reason)
    }

    /// The group of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|group| group.name() == name)
    }
}

impl fmt::Display for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
