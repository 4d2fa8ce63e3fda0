//! What a robot, its command and its loads are made of, as numbers: each has a name and a unit.

use std::fmt;

use nalgebra::Vector3;
use thiserror::Error;

use super::{Body, Drive, MassSpec, RobotSpec};

/// A number that an equilibrium or a motion depends on. Derivatives are per unit given here. Those of
/// the robot, not of its command and loads, have a value in its specification: [`RobotSpec::value`].
/// Each has a name as text, [`Parameter::key`], and a kind, of which all else is known: [`Parameter::kind`].
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parameter {
    /// The command of a tendon (m, or N for a tension drive).
    Command(usize),
    /// Mass of the tip payload (kg).
    Payload,
    /// A force on a disc's origin along an axis of the world (N).
    Force(usize, Axis),
    /// A moment on a disc about an axis of the world (N m).
    Moment(usize, Axis),
    /// Gain kp of a tendon's drive (N/m).
    Gain(usize),
    /// Axial stiffness of a tendon (N/m).
    AxialStiffness(usize),
    /// Coefficient of friction of a tendon in its holes. Equilibria without friction do not depend on it.
    Friction(usize),
    /// Bending stiffness of all joints of a module about a disc's x or y axis (N m/rad).
    Bending(usize, Axis),
    /// Torsion stiffness of all joints of a module (N m/rad).
    Torsion(usize),
    /// Stiffness of one hinge of all joints of a module (N m/rad), counted from the body below.
    HingeStiffness(usize, usize),
    /// Density of a module's discs (kg/m³), all alike.
    Density(usize),
    /// Young's modulus of a module's rod (Pa).
    Youngs(usize),
    /// Distance of all holes of a body from its z axis (m): of the base, or of the module of a disc.
    HoleRadius(Body),
    /// Place of one hole of a body along its x or y axis (m), before any clocking: of the base, or of
    /// all discs of the module of a disc.
    Hole(Body, usize, Axis),
    /// Distance between the discs of a module (m).
    Pitch(usize),
    /// Viscous damping of all joints of a module, or of all their hinges (N m s/rad). Equilibria do not depend on it.
    Damping(usize),
    /// Armature inertia of all joints of a module, or of all their hinges (kg m²). Equilibria do not depend on it.
    Armature(usize),
}

/// An axis of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Axis {
    /// The x axis.
    X,
    /// The y axis.
    Y,
    /// The z axis.
    Z,
}

/// Why a robot does not have a parameter, or a value of it, or not two of them at once.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ParameterError {
    /// The robot does not have it.
    #[error("robot `{robot}` has no parameter `{}`: {reason}", .parameter.key())]
    Missing {
        /// Name of the robot.
        robot: String,
        /// The parameter.
        parameter: Parameter,
        /// Why.
        reason: &'static str,
    },
    /// Two that stand for the same numbers of the robot, so that neither can change while the other does not.
    #[error(
        "parameters `{}` and `{}` of robot `{robot}` overlap: {both}; expected one of them",
        .first.key(), .second.key()
    )]
    Overlap {
        /// Name of the robot.
        robot: String,
        /// The one that was named first.
        first: Parameter,
        /// The other one.
        second: Parameter,
        /// What both stand for.
        both: String,
    },
}

impl Axis {
    /// The axes, in order.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// Its number: 0, 1 or 2.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Unit vector along the axis.
    pub(crate) fn unit(self) -> Vector3<f64> {
        Vector3::ith(self.index(), 1.0)
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(["x", "y", "z"][self.index()])
    }
}

/// Whether the robot has the parameter.
pub(crate) fn check(spec: &RobotSpec, parameter: Parameter) -> Result<(), ParameterError> {
    let holes = |body| spec.holes(body).map(|holes| holes.positions());
    let tendon = |t: usize| spec.tendons().get(t).copied();
    let reason = match parameter {
        Parameter::Command(t) if tendon(t).is_none() => "no such tendon",
        Parameter::Gain(t) => match tendon(t).map(|spec| spec.drive) {
            None => "no such tendon",
            Some(Drive::Gain(_)) => return Ok(()),
            Some(_) => "the tendon's drive has no gain",
        },
        Parameter::AxialStiffness(t) => match tendon(t).map(|spec| spec.axial_stiffness) {
            None => "no such tendon",
            Some(None) => "the tendon is inextensible",
            Some(Some(_)) => return Ok(()),
        },
        Parameter::Friction(t) => match tendon(t).map(|spec| spec.friction) {
            None => "no such tendon",
            Some(None) => "the tendon has no friction",
            Some(Some(_)) => return Ok(()),
        },
        Parameter::Force(disc, _) | Parameter::Moment(disc, _) if disc >= spec.disc_count() => {
            "no such disc"
        }
        Parameter::Bending(_, Axis::Z) => "bending is about x or y",
        Parameter::Bending(module, _) | Parameter::Torsion(module) => {
            match spec
                .modules
                .get(module)
                .map(|module| module.backbone.is_some())
            {
                None => "no such module",
                Some(false) if spec.modules[module].rod.is_some() => {
                    "the stiffness is that of the module's rod, which has a Young's modulus"
                }
                Some(false) => "the module has no backbone",
                Some(true) => return Ok(()),
            }
        }
        Parameter::HingeStiffness(module, hinge) => {
            match spec.modules.get(module).map(|module| &module.joint) {
                None => "no such module",
                Some(None) => "the module's joints are not hinges",
                Some(Some(joint)) if joint.all(|joint| hinge < joint.hinges.len()) => return Ok(()),
                Some(Some(_)) => "no such hinge",
            }
        }
        Parameter::Youngs(module) => match spec.modules.get(module).map(|module| module.rod) {
            None => "no such module",
            Some(None) => "the module has no rod",
            Some(Some(_)) => return Ok(()),
        },
        Parameter::Density(module) => match spec.modules.get(module).map(|module| &module.mass) {
            None => "no such module",
            Some(MassSpec::Rigid(_)) => "the module's masses are not given by a density",
            Some(MassSpec::Density(_) | MassSpec::Solid(_)) => return Ok(()),
        },
        Parameter::Pitch(module) | Parameter::Damping(module) | Parameter::Armature(module)
            if module >= spec.modules.len() =>
        {
            "no such module"
        }
        Parameter::HoleRadius(body) => match holes(body) {
            None => "no such body",
            Some(holes) if holes.iter().any(|[x, y]| x.hypot(*y) == 0.0) => {
                "a hole on the axis has no direction to move in"
            }
            Some(_) => return Ok(()),
        },
        Parameter::Hole(_, _, Axis::Z) => "holes move along x or y",
        Parameter::Hole(body, hole, _) if holes(body).is_none_or(|holes| hole >= holes.len()) => {
            "no such hole"
        }
        _ => return Ok(()),
    };
    Err(ParameterError::Missing {
        robot: spec.name.clone(),
        parameter,
        reason,
    })
}
