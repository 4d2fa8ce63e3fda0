//! Loads on a robot besides its own weight.

use nalgebra::Vector3;
use thiserror::Error;

use super::Robot;

/// Loads on a robot besides its own weight: a tip payload, wrenches at discs, a load along the
/// backbone. None by default.
///
/// ```
/// use tdcr_sim::robot::{Frame, Loads, Payload, Robot, Wrench};
///
/// let robot = Robot::load("2m")?;
/// let push = Wrench { force: [0.05, 0.0, 0.0], ..Wrench::none(4, Frame::World) };
/// let loads = Loads::payload(0.02)?.with_wrench(push)?;
/// let settled = robot.settle(&robot.mean_command(), &loads);
/// assert!(settled.converged);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loads {
    payload: Payload,
    wrenches: Vec<Wrench>,
    line: Vector3<f64>,
}

/// A mass hung from the distal disc: a force along gravity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Payload {
    /// Mass (kg).
    pub mass: f64,
    /// Where it hangs, in the distal disc's frame (m).
    pub offset: [f64; 3],
}

/// A force and a moment on a disc, or on a point fixed to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench {
    /// The disc, from 0 at the base.
    pub disc: usize,
    /// The point that the force acts on, in the disc's frame whatever `frame` is (m); the disc's origin by default.
    pub point: [f64; 3],
    /// Force (N).
    pub force: [f64; 3],
    /// Moment (N m).
    pub moment: [f64; 3],
    /// The frame that force and moment are given in.
    pub frame: Frame,
}

/// The frame that a wrench is given in, and keeps its direction in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// The world's.
    World,
    /// The disc's: the wrench turns with it.
    Disc,
}

/// Why a load was refused.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum LoadsError {
    /// A mass that is negative or not a number.
    #[error("the payload is {0} kg; expected a finite mass, 0 or above")]
    Mass(f64),
    /// A component that is not a finite number.
    #[error("the {what} is {value}; expected finite numbers")]
    NotFinite {
        /// Of which load.
        what: &'static str,
        /// The component.
        value: f64,
    },
    /// A point beyond the ends of the backbone.
    #[error(
        "a wrench acts at {arc_length} m along the backbone; expected between 0 and its length, {length} m"
    )]
    ArcLength {
        /// Where it was asked for, from the base along the backbone (m).
        arc_length: f64,
        /// The backbone's length (m).
        length: f64,
    },
    /// A disc that the robot does not have.
    #[error("a wrench acts on disc {disc}; the robot has {discs} discs, counted from 0")]
    Disc {
        /// The disc asked for.
        disc: usize,
        /// Number of discs.
        discs: usize,
    },
}

impl Wrench {
    /// No force and no moment on `disc`; to be filled in.
    pub fn none(disc: usize, frame: Frame) -> Self {
        Self {
            disc,
            point: [0.0; 3],
            force: [0.0; 3],
            moment: [0.0; 3],
            frame,
        }
    }
}

impl Loads {
    /// A payload (kg) at the origin of the distal disc: a force `p g` along gravity.
    ///
    /// # Errors
    /// [`LoadsError`] for a negative or non-finite mass.
    pub fn payload(mass: f64) -> Result<Self, LoadsError> {
        Self::default().with_payload(Payload {
            mass,
            offset: [0.0; 3],
        })
    }

    /// These loads with another payload.
    ///
    /// # Errors
    /// [`LoadsError`] for a negative or non-finite mass, or a non-finite offset.
    pub fn with_payload(mut self, payload: Payload) -> Result<Self, LoadsError> {
        if !(payload.mass.is_finite() && payload.mass >= 0.0) {
            return Err(LoadsError::Mass(payload.mass));
        }
        finite("payload's offset (m)", &payload.offset)?;
        self.payload = payload;
        Ok(self)
    }

    /// These loads and one more wrench.
    ///
    /// # Errors
    /// [`LoadsError`] for components that are not finite.
    pub fn with_wrench(mut self, wrench: Wrench) -> Result<Self, LoadsError> {
        finite("point of a wrench (m)", &wrench.point)?;
        finite("force (N)", &wrench.force)?;
        finite("moment (N m)", &wrench.moment)?;
        self.wrenches.push(wrench);
        Ok(self)
    }

    /// These loads and a force (N) and a moment (N m) at a point of the backbone, `arc_length` (m) from the base along it,
    /// in `frame`: the world's, or that of the discs about the point.
    ///
    /// It is shared by the two discs on either side in proportion to how near their origins are, each holding the point
    /// rigidly. A joint so bends under the part of the moment that the piece of backbone it stands for lies below, which
    /// keeps a chain's convergence with the square of the pitch wherever the point lies. The base bears its own share.
    ///
    /// # Errors
    /// [`LoadsError::ArcLength`] for a point beyond the ends, [`LoadsError::NotFinite`] for components that are not finite.
    pub fn with_backbone_wrench(
        mut self,
        robot: &Robot,
        arc_length: f64,
        force: [f64; 3],
        moment: [f64; 3],
        frame: Frame,
    ) -> Result<Self, LoadsError> {
        let origins = robot.arc_lengths();
        let length = origins.last().copied().unwrap_or(0.0);
        let Some(arc_length) = robot.on_backbone(arc_length) else {
            return Err(LoadsError::ArcLength { arc_length, length });
        };
        let upper = origins.partition_point(|&origin| origin < arc_length);
        let below = upper.checked_sub(1).map_or(0.0, |disc| origins[disc]);
        let share = (arc_length - below) / (origins[upper] - below);
        let shares = [
            upper.checked_sub(1).map(|disc| (disc, 1.0 - share)),
            Some((upper, share)),
        ];
        for (disc, share) in shares
            .into_iter()
            .flatten()
            .filter(|(_, share)| *share > 0.0)
        {
            self = self.with_wrench(Wrench {
                disc,
                point: [0.0, 0.0, arc_length - origins[disc]],
                force: force.map(|component| share * component),
                moment: moment.map(|component| share * component),
                frame,
            })?;
        }
        Ok(self)
    }

    /// These loads with a force per length of the backbone (N/m), world frame. Every disc carries
    /// that of half the backbone to each neighbour.
    ///
    /// # Errors
    /// [`LoadsError`] for components that are not finite.
    pub fn with_line_load(mut self, force_per_length: [f64; 3]) -> Result<Self, LoadsError> {
        finite("line load (N/m)", &force_per_length)?;
        self.line = force_per_length.into();
        Ok(self)
    }

    /// The superposition `(1 - part)` of these loads and `part` of `goal`.
    pub(crate) fn towards(&self, goal: &Self, part: f64) -> Self {
        if part == 1.0 || self == goal {
            return goal.clone();
        }
        let shares = [(self, 1.0 - part), (goal, part)];
        let mass: f64 = shares.iter().map(|(l, share)| share * l.payload.mass).sum();
        let moment: Vector3<f64> = (shares.iter())
            .map(|(l, share)| Vector3::from(l.payload.offset) * (share * l.payload.mass))
            .sum();
        let offset = if mass > 0.0 {
            std::array::from_fn(|axis| moment[axis] / mass)
        } else {
            goal.payload.offset
        };
        let scaled = |wrench: &Wrench, share: f64| Wrench {
            force: wrench.force.map(|f| share * f),
            moment: wrench.moment.map(|m| share * m),
            ..*wrench
        };
        Self {
            payload: Payload { mass, offset },
            wrenches: (shares.iter())
                .flat_map(|(l, share)| l.wrenches.iter().map(|w| scaled(w, *share)))
                .collect(),
            line: self.line.lerp(&goal.line, part),
        }
    }

    /// Whether every wrench acts on a disc that `robot` has.
    ///
    /// # Errors
    /// [`LoadsError::Disc`] for the first that does not.
    pub fn check(&self, robot: &Robot) -> Result<(), LoadsError> {
        let discs = robot.discs().len();
        match self.wrenches.iter().find(|wrench| wrench.disc >= discs) {
            Some(Wrench { disc, .. }) => Err(LoadsError::Disc { disc: *disc, discs }),
            None => Ok(()),
        }
    }

    /// The payload.
    pub fn tip_payload(&self) -> Payload {
        self.payload
    }

    /// The wrenches.
    pub fn wrenches(&self) -> &[Wrench] {
        &self.wrenches
    }

    /// Force per length of the backbone, world frame (N/m).
    pub fn line_load(&self) -> Vector3<f64> {
        self.line
    }
}

fn finite(what: &'static str, values: &[f64]) -> Result<(), LoadsError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(LoadsError::NotFinite { what, value }),
        None => Ok(()),
    }
}
