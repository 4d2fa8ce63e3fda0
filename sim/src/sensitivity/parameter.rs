//! What an equilibrium can be differentiated by, and how the model moves with it.

use nalgebra::Vector3;
use thiserror::Error;

use super::value::shift;
use crate::energy::DeadForces;
use crate::robot::{Body, Drive, Loads, MassSpec, Robot, RobotSpec};

/// A number that an equilibrium depends on. Derivatives are per unit given here. Those of the robot,
/// not of its command and loads, have a value in its specification: [`RobotSpec::value`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// Bending stiffness of all joints of a module about a disc's x or y axis (N m/rad).
    Bending(usize, Axis),
    /// Torsion stiffness of all joints of a module (N m/rad).
    Torsion(usize),
    /// Density of a module's discs (kg/m³), all alike.
    Density(usize),
    /// Distance of all holes of a body from its z axis (m): of the base, or of the module of a disc.
    HoleRadius(Body),
    /// Place of one hole of a body along its x or y axis (m): of the base, or of all discs of the
    /// module of a disc.
    Hole(Body, usize, Axis),
    /// Distance between the discs of a module (m).
    Pitch(usize),
}

/// An axis of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The x axis.
    X,
    /// The y axis.
    Y,
    /// The z axis.
    Z,
}

/// Why an equilibrium has no such derivative.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SensitivityError {
    /// Not settled: there is no equilibrium to differentiate.
    #[error("the robot has not settled (residual {0:e} N m): there is nothing to differentiate")]
    NotSettled(f64),
    /// The equilibrium is on the brink of instability, where derivatives are infinite.
    #[error("the equilibrium is not stable: its Hessian is not positive definite")]
    Unstable,
    /// The robot has no such parameter.
    #[error("robot `{robot}` has no parameter {parameter:?}: {reason}")]
    Parameter {
        /// Name of the robot.
        robot: String,
        /// The parameter.
        parameter: Parameter,
        /// Why.
        reason: &'static str,
    },
}

impl Axis {
    /// The axes, in order.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// Its number: 0, 1 or 2.
    pub fn index(self) -> usize {
        self as usize
    }

    fn unit(self) -> Vector3<f64> {
        Vector3::ith(self.index(), 1.0)
    }
}

/// How the compiled model moves for a unit change of one parameter.
#[derive(Clone, Debug)]
pub(super) struct ModelTangent {
    /// Command of each tendon.
    pub command: Vec<f64>,
    /// Stiffness of each tendon with its drive.
    pub stiffness: Vec<f64>,
    /// Ends of each segment, in their bodies' frames.
    pub segments: Vec<[Vector3<f64>; 2]>,
    /// Ends of each span.
    pub spans: Vec<[Vector3<f64>; 2]>,
    /// Joint offset of each disc, in the frame of the body below.
    pub joint_offsets: Vec<Vector3<f64>>,
    /// Backbone stiffness of each joint, about the disc's axes.
    pub backbone: Vec<Vector3<f64>>,
    /// Dead forces.
    pub dead: DeadForces,
    /// Moment on each disc, world frame.
    pub moments: Vec<Vector3<f64>>,
}

impl ModelTangent {
    pub fn zero(robot: &Robot) -> Self {
        let n = robot.discs.len();
        Self {
            command: vec![0.0; robot.tendons.len()],
            stiffness: vec![0.0; robot.tendons.len()],
            segments: vec![[Vector3::zeros(); 2]; robot.segments.len()],
            spans: vec![[Vector3::zeros(); 2]; robot.spans.len()],
            joint_offsets: vec![Vector3::zeros(); n],
            backbone: vec![Vector3::zeros(); n],
            dead: DeadForces::new(robot),
            moments: vec![Vector3::zeros(); n],
        }
    }

    /// The tangent for `parameter` of `robot` under `loads`.
    pub fn new(
        robot: &Robot,
        loads: &Loads,
        parameter: Parameter,
    ) -> Result<Self, SensitivityError> {
        check(robot.spec(), parameter)?;
        let mut tangent = Self::zero(robot);
        match parameter {
            Parameter::Command(tendon) => tangent.command[tendon] = 1.0,
            Parameter::Payload => {
                tangent.dead.set_payload(robot, loads, robot.gravity);
            }
            Parameter::Force(disc, axis) => tangent.dead.at_origin[disc] = axis.unit(),
            Parameter::Moment(disc, axis) => tangent.moments[disc] = axis.unit(),
            Parameter::Gain(t) => tangent.stiffness[t] = series(robot, t).0,
            Parameter::AxialStiffness(t) => tangent.stiffness[t] = series(robot, t).1,
            Parameter::Bending(module, axis) => tangent.stiffen(robot, module, axis),
            Parameter::Torsion(module) => tangent.stiffen(robot, module, Axis::Z),
            Parameter::Density(_)
            | Parameter::HoleRadius(_)
            | Parameter::Hole(..)
            | Parameter::Pitch(_) => tangent.move_spec(robot, loads, parameter),
        }
        Ok(tangent)
    }

    fn stiffen(&mut self, robot: &Robot, module: usize, axis: Axis) {
        for (disc, stiffness) in self.backbone.iter_mut().enumerate() {
            if robot.spec().module_of(disc) == Some(module) {
                *stiffness = axis.unit();
            }
        }
    }

    /// Places and masses depend on these parameters by affine maps, so the difference of two compiled
    /// robots is their derivative.
    fn move_spec(&mut self, robot: &Robot, loads: &Loads, parameter: Parameter) {
        let [low, high] = [0.0, 1.0].map(|by| {
            let mut spec = robot.spec().clone();
            shift(&mut spec, parameter, by);
            let robot = Robot::lay_out(spec);
            let mut dead = DeadForces::new(&robot);
            dead.set(&robot, loads);
            (robot, dead)
        });
        let ends =
            |from: [&Vector3<f64>; 2], to: [&Vector3<f64>; 2]| [from[1] - from[0], to[1] - to[0]];
        for (i, tangent) in self.segments.iter_mut().enumerate() {
            let (a, b) = (&low.0.segments[i], &high.0.segments[i]);
            *tangent = ends([&a.from, &b.from], [&a.to, &b.to]);
        }
        for (i, tangent) in self.spans.iter_mut().enumerate() {
            let (a, b) = (&low.0.spans[i], &high.0.spans[i]);
            *tangent = ends([&a.from, &b.from], [&a.to, &b.to]);
        }
        for (i, tangent) in self.joint_offsets.iter_mut().enumerate() {
            *tangent = high.0.discs[i].joint_offset - low.0.discs[i].joint_offset;
        }
        for (i, force) in self.dead.at_origin.iter_mut().enumerate() {
            *force = high.1.at_origin[i] - low.1.at_origin[i];
        }
    }
}

/// Derivatives of the stiffness of drive and tendon in series by the gain and by the axial stiffness.
fn series(robot: &Robot, tendon: usize) -> (f64, f64) {
    let spec = robot.spec().tendons()[tendon];
    match (spec.drive, spec.axial_stiffness) {
        (Drive::Gain(gain), Some(axial)) => {
            let sum = gain + axial;
            ((axial / sum).powi(2), (gain / sum).powi(2))
        }
        (Drive::Gain(_), None) => (1.0, 0.0),
        (Drive::Length, Some(_)) => (0.0, 1.0),
        _ => (0.0, 0.0),
    }
}

/// Whether the robot has the parameter.
pub(super) fn check(spec: &RobotSpec, parameter: Parameter) -> Result<(), SensitivityError> {
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
                Some(false) => "the module has no backbone",
                Some(true) => return Ok(()),
            }
        }
        Parameter::Density(module) => match spec.modules.get(module).map(|module| &module.mass) {
            None => "no such module",
            Some(MassSpec::Rigid(_)) => "the module's masses are not given by a density",
            Some(MassSpec::Density(_)) => return Ok(()),
        },
        Parameter::Pitch(module) if module >= spec.modules.len() => "no such module",
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
    Err(SensitivityError::Parameter {
        robot: spec.name.clone(),
        parameter,
        reason,
    })
}
