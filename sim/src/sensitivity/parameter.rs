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
    /// Young's modulus of a module's rod (Pa).
    Youngs(usize),
    /// Distance of all holes of a body from its z axis (m): of the base, or of the module of a disc.
    HoleRadius(Body),
    /// Place of one hole of a body along its x or y axis (m), before any clocking: of the base, or of
    /// all discs of the module of a disc.
    Hole(Body, usize, Axis),
    /// Distance between the discs of a module (m).
    Pitch(usize),
}

/// Step by which the pitch of a rod's joints is moved either way, as a share of it: central
/// differences of its inverse are then exact to 1e-10.
const PITCH_STEP: f64 = 1e-5;

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
    /// Length of each tendon between holes of one and the same body.
    pub fixed_lengths: Vec<f64>,
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
            fixed_lengths: vec![0.0; robot.tendons.len()],
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
            Parameter::Youngs(module) => tangent.stiffen_rod(robot, module),
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

    /// A rod's stiffness is in proportion to its Young's modulus.
    fn stiffen_rod(&mut self, robot: &Robot, module: usize) {
        let Some(rod) = robot.spec().modules[module].rod else {
            return;
        };
        for (disc, stiffness) in self.backbone.iter_mut().enumerate() {
            if robot.spec().module_of(disc) == Some(module)
                && let Some(backbone) = &robot.discs[disc].backbone
            {
                *stiffness = backbone.stiffness() / rod.youngs;
            }
        }
    }

    /// Places and masses depend on these parameters by affine maps, so the difference of two compiled
    /// robots is their derivative. Only where the pitch moves the joints of a rod are there squares
    /// (of its mass' places) and inverses (its stiffness), for which a small step is taken.
    fn move_spec(&mut self, robot: &Robot, loads: &Loads, parameter: Parameter) {
        let steps = match parameter {
            Parameter::Pitch(module) if robot.spec().modules[module].rod.is_some() => {
                let small = PITCH_STEP * robot.spec().modules[module].pitch;
                [-small, small]
            }
            _ => [0.0, 1.0],
        };
        let per_unit = 1.0 / (steps[1] - steps[0]);
        let [low, high] = steps.map(|by| {
            let mut spec = robot.spec().clone();
            shift(&mut spec, parameter, by);
            let robot = Robot::lay_out(spec);
            let mut dead = DeadForces::new(&robot);
            dead.set(&robot, loads);
            (robot, dead)
        });
        let ends = |from: [&Vector3<f64>; 2], to: [&Vector3<f64>; 2]| {
            [from, to].map(|[low, high]| (high - low) * per_unit)
        };
        for (i, tangent) in self.segments.iter_mut().enumerate() {
            let (a, b) = (&low.0.segments[i], &high.0.segments[i]);
            *tangent = ends([&a.from, &b.from], [&a.to, &b.to]);
        }
        for (i, tangent) in self.spans.iter_mut().enumerate() {
            let (a, b) = (&low.0.spans[i], &high.0.spans[i]);
            *tangent = ends([&a.from, &b.from], [&a.to, &b.to]);
        }
        for (length, tendon) in self.fixed_lengths.iter_mut().zip(&robot.tendons) {
            for pair in tendon
                .route
                .windows(2)
                .filter(|pair| pair[0].0 == pair[1].0)
            {
                let across = |robot: &Robot| robot.hole(pair[1]) - robot.hole(pair[0]);
                let direction = across(robot).try_normalize(0.0).unwrap_or_default();
                *length += direction.dot(&(across(&high.0) - across(&low.0))) * per_unit;
            }
        }
        for (i, tangent) in self.joint_offsets.iter_mut().enumerate() {
            *tangent = (high.0.discs[i].joint_offset - low.0.discs[i].joint_offset) * per_unit;
        }
        for (i, force) in self.dead.at_origin.iter_mut().enumerate() {
            *force = (high.1.at_origin[i] - low.1.at_origin[i]) * per_unit;
        }
        for (i, off_origin) in self.dead.off_origin.iter_mut().enumerate() {
            *off_origin = (high.1.off_origin[i] - low.1.off_origin[i]) * per_unit;
        }
        for (i, stiffness) in self.backbone.iter_mut().enumerate() {
            let joints = [&low.0, &high.0].map(|robot| robot.discs[i].backbone);
            if let [Some(low), Some(high)] = joints {
                *stiffness = (high.stiffness() - low.stiffness()) * per_unit;
            }
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
                Some(false) if spec.modules[module].rod.is_some() => {
                    "the stiffness is that of the module's rod, which has a Young's modulus"
                }
                Some(false) => "the module has no backbone",
                Some(true) => return Ok(()),
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
