//! How the compiled model changes with each parameter.
//!
//! Derivatives by what compiling changes (pitch, holes, densities) are differences of two compiled robots. They are exact, as
//! compiling is affine in these parameters, but for the pitch of a rod's joints, for which the step is small.

use nalgebra::Vector3;

use crate::energy::DeadForces;
use crate::robot::{Axis, Drive, Loads, Parameter, ParameterError, Robot, check, shift};

/// Step by which the pitch of a rod's joints is moved either way, as a share of it: central
/// differences of its inverse are then exact to 1e-10.
const PITCH_STEP: f64 = 1e-5;

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
        let n = robot.discs().len();
        Self {
            command: vec![0.0; robot.tendons().len()],
            stiffness: vec![0.0; robot.tendons().len()],
            fixed_lengths: vec![0.0; robot.tendons().len()],
            segments: vec![[Vector3::zeros(); 2]; robot.segments().len()],
            spans: vec![[Vector3::zeros(); 2]; robot.spans().len()],
            joint_offsets: vec![Vector3::zeros(); n],
            backbone: vec![Vector3::zeros(); n],
            dead: DeadForces::new(robot),
            moments: vec![Vector3::zeros(); n],
        }
    }

    /// The tangent for `parameter` of `robot` under `loads`.
    pub fn new(robot: &Robot, loads: &Loads, parameter: Parameter) -> Result<Self, ParameterError> {
        check(robot.spec(), parameter)?;
        let mut tangent = Self::zero(robot);
        match parameter {
            Parameter::Command(tendon) => tangent.command[tendon] = 1.0,
            Parameter::Payload => {
                tangent.dead.set_payload(robot, loads, robot.gravity());
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
            // They resist motion alone.
            Parameter::Damping(_) | Parameter::Armature(_) => {}
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
                && let Some(backbone) = &robot.discs()[disc].backbone
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
        // The robot on either side of the parameter's value, laid out.
        let [low, high] = steps.map(|by| {
            let mut spec = robot.spec().clone();
            shift(&mut spec, parameter, by);
            let robot = Robot::lay_out(spec);
            let mut dead = DeadForces::new(&robot);
            dead.set(&robot, loads);
            (robot, dead)
        });
        // Differences of what the layout has: ends of pieces, lengths, places, forces, stiffnesses.
        let ends = |from: [&Vector3<f64>; 2], to: [&Vector3<f64>; 2]| {
            [from, to].map(|[low, high]| (high - low) * per_unit)
        };
        for (i, tangent) in self.segments.iter_mut().enumerate() {
            let (a, b) = (&low.0.segments()[i], &high.0.segments()[i]);
            *tangent = ends([&a.from, &b.from], [&a.to, &b.to]);
        }
        for (i, tangent) in self.spans.iter_mut().enumerate() {
            let (a, b) = (&low.0.spans()[i], &high.0.spans()[i]);
            *tangent = ends([&a.from, &b.from], [&a.to, &b.to]);
        }
        for (length, tendon) in self.fixed_lengths.iter_mut().zip(robot.tendons()) {
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
            *tangent = (high.0.discs()[i].joint_offset - low.0.discs()[i].joint_offset) * per_unit;
        }
        for (i, force) in self.dead.at_origin.iter_mut().enumerate() {
            *force = (high.1.at_origin[i] - low.1.at_origin[i]) * per_unit;
        }
        for (i, off_origin) in self.dead.off_origin.iter_mut().enumerate() {
            *off_origin = (high.1.off_origin[i] - low.1.off_origin[i]) * per_unit;
        }
        for (i, stiffness) in self.backbone.iter_mut().enumerate() {
            let joints = [&low.0, &high.0].map(|robot| robot.discs()[i].backbone);
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
