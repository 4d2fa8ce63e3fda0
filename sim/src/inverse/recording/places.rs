//! What there is an unknown of, and how wide its prior is: words that the table of unknowns is written in.

use crate::robot::Axis;

/// Which one of a kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct At {
    /// The tendon, module or marker, from 0.
    pub number: usize,
    pub axis: Axis,
}

/// What there is one unknown of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Each {
    Once,
    Servo,
    Tendon,
    Module,
    /// For each axis of a module with a backbone or a rod.
    ElasticModule(&'static [Axis]),
    /// A module at which tendons end.
    ModuleOfTendons,
    ModuleOfStretchingTendons,
    BaseRotation,
    BasePosition,
    MarkerPosition,
    GravityRotation,
}

/// The standard deviation of a prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Spread {
    /// In the unknown's unit, or of a factor relative.
    Of(f64),
    /// A share of the robot's length.
    OfLength(f64),
    /// A share of the holes' distance from the axis; of a tension drive a share of the largest tension.
    OfDisplacement(f64),
    /// Divided by the holes' distance from the axis.
    PerHoleRadius(f64),
    /// A share of the time between rows.
    OfStep(f64),
}

impl At {
    pub fn new(number: usize, axis: Axis) -> Self {
        Self { number, axis }
    }
}
