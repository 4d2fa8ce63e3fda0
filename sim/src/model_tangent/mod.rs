//! How the compiled model, and with it the potential's gradient, change with each parameter.
//!
//! [`ModelTangent`] is the change of the model for a unit change of a parameter. [`Expanded`] gives the change of the
//! potential's gradient for a change of the model ([`gradient`]) and, the other way, the derivative of a cost by every number of
//! the model at once ([`cotangent`]): its product with a [`ModelTangent`] is the derivative by that parameter, so that
//! cotangents serve any number of parameters.
//!
//! Derivatives by what compiling changes (pitch, holes, densities) are differences of two compiled robots. They are exact, as
//! compiling is affine in these parameters, but for the pitch of a rod's joints, for which the step is small.

mod cotangent;
mod gradient;

pub(crate) use cotangent::{pull_back_centres, pull_back_tension};

use nalgebra::{Matrix3, Vector3};

use crate::chain::Configuration;
use crate::energy::{DeadForces, Expansion};
use crate::robot::{Axis, Disc, Drive, Loads, Parameter, ParameterError, Robot, check, shift};
use crate::tendon::Posture;

/// Step by which the pitch of a rod's joints is moved either way, as a share of it: central
/// differences of its inverse are then exact to 1e-10.
const PITCH_STEP: f64 = 1e-5;

/// The potential of a robot, expanded in one configuration: all that its derivatives by the model need.
#[derive(Clone, Copy)]
pub(crate) struct Expanded<'a> {
    pub robot: &'a Robot,
    pub q: &'a Configuration,
    pub posture: &'a Posture,
    pub expansion: &'a Expansion,
    /// The dead forces, and the following ones as they are in this posture.
    pub dead: &'a DeadForces,
    pub command: &'a [f64],
}

/// Change of the numbers that the compiled model consists of for a unit change of one parameter; or, as a cotangent, the
/// derivatives of a cost by them.
#[derive(Clone, Debug)]
pub(crate) struct ModelTangent {
    /// Command of each tendon.
    pub command: Vec<f64>,
    /// Stiffness of each tendon with its drive.
    pub stiffness: Vec<f64>,
    /// Coefficient of friction of each tendon in its holes.
    pub friction: Vec<f64>,
    /// Length of each tendon between holes of one and the same body.
    pub fixed_lengths: Vec<f64>,
    /// Ends of each segment, in their bodies' frames.
    pub segments: Vec<[Vector3<f64>; 2]>,
    /// Ends of each span.
    pub spans: Vec<[Vector3<f64>; 2]>,
    /// Joint offset of each disc, in the frame of the body below.
    pub joint_offsets: Vec<Vector3<f64>>,
    /// Stiffness of each joint: of its backbone about the disc's axes, or of its hinges.
    pub backbone: Vec<Vector3<f64>>,
    /// Dead force on the origin of each disc, world frame.
    pub at_origin: Vec<Vector3<f64>>,
    /// Mass of each disc times its centre's place from the origin, disc frame.
    pub off_origin: Vec<Vector3<f64>>,
    /// Force of the payload on the distal disc, world frame.
    pub payload: Vector3<f64>,
    /// Moment on each disc, world frame.
    pub moments: Vec<Vector3<f64>>,
    /// Inertia of each disc; the payload is part of the distal one.
    pub inertias: Vec<Inertia>,
    /// Viscous damping of each joint, and what there is more about its disc's axes.
    pub damping: Vec<f64>,
    pub extra_damping: Vec<Vector3<f64>>,
    /// Armature of each joint.
    pub armature: Vec<f64>,
}

/// Inertia of a body about the centre of its joint, in the disc's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Inertia {
    /// Mass (kg).
    pub mass: f64,
    /// Mass times its centre's place from the joint (kg m).
    pub moment: Vector3<f64>,
    /// Moments of inertia about the joint's centre (kg m²), symmetric.
    pub rotational: Matrix3<f64>,
}

impl Inertia {
    fn of_disc(disc: &Disc) -> Self {
        let about_centre = Matrix3::from_diagonal(&disc.inertia);
        let mut inertia = Self::of_point(disc.mass, &(disc.origin + disc.centre_of_mass));
        inertia.rotational += about_centre;
        inertia
    }

    /// Of a point mass at `place` from the joint.
    fn of_point(mass: f64, place: &Vector3<f64>) -> Self {
        let square = Matrix3::identity() * place.norm_squared() - place * place.transpose();
        Self {
            mass,
            moment: place * mass,
            rotational: square * mass,
        }
    }

    fn dot(&self, other: &Self) -> f64 {
        self.mass * other.mass
            + self.moment.dot(&other.moment)
            + self.rotational.dot(&other.rotational)
    }
}

impl ModelTangent {
    /// Forces on the discs' origins and moments, which are none from here on.
    pub(crate) fn take_wrenches(&mut self) -> [Vec<Vector3<f64>>; 2] {
        [&mut self.at_origin, &mut self.moments].map(|wrenches| {
            let none = vec![Vector3::zeros(); wrenches.len()];
            std::mem::replace(wrenches, none)
        })
    }

    /// Adds some that were taken.
    pub(crate) fn add_wrenches(&mut self, [forces, moments]: &[Vec<Vector3<f64>>; 2]) {
        let pairs = [(&mut self.at_origin, forces), (&mut self.moments, moments)];
        for (own, others) in pairs {
            own.iter_mut()
                .zip(others)
                .for_each(|(own, other)| *own += other);
        }
    }

    /// No change.
    pub fn zero(robot: &Robot) -> Self {
        let (n, tendons) = (robot.discs().len(), robot.tendons().len());
        let none = vec![Vector3::zeros(); n];
        Self {
            command: vec![0.0; tendons],
            stiffness: vec![0.0; tendons],
            friction: vec![0.0; tendons],
            fixed_lengths: vec![0.0; tendons],
            segments: vec![[Vector3::zeros(); 2]; robot.segments().len()],
            spans: vec![[Vector3::zeros(); 2]; robot.spans().len()],
            joint_offsets: none.clone(),
            backbone: none.clone(),
            at_origin: none.clone(),
            off_origin: none.clone(),
            payload: Vector3::zeros(),
            moments: none.clone(),
            extra_damping: none,
            inertias: vec![Inertia::default(); n],
            damping: vec![0.0; n],
            armature: vec![0.0; n],
        }
    }

    /// Derivative of a cost by a parameter: its cotangent (one of the two) times the parameter's tangent.
    pub fn dot(&self, other: &Self) -> f64 {
        fn numbers(a: &[f64], b: &[f64]) -> f64 {
            a.iter().zip(b).map(|(a, b)| a * b).sum()
        }
        fn vectors(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
            a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
        }
        let inertias = self.inertias.iter().zip(&other.inertias);
        numbers(&self.command, &other.command)
            + numbers(&self.stiffness, &other.stiffness)
            + numbers(&self.friction, &other.friction)
            + numbers(&self.fixed_lengths, &other.fixed_lengths)
            + vectors(self.segments.as_flattened(), other.segments.as_flattened())
            + vectors(self.spans.as_flattened(), other.spans.as_flattened())
            + vectors(&self.joint_offsets, &other.joint_offsets)
            + vectors(&self.backbone, &other.backbone)
            + vectors(&self.at_origin, &other.at_origin)
            + vectors(&self.off_origin, &other.off_origin)
            + self.payload.dot(&other.payload)
            + vectors(&self.moments, &other.moments)
            + inertias.map(|(a, b)| a.dot(b)).sum::<f64>()
            + numbers(&self.damping, &other.damping)
            + vectors(&self.extra_damping, &other.extra_damping)
            + numbers(&self.armature, &other.armature)
    }

    /// Derivative by `parameter` of `robot` under `loads` of the cost that this is the cotangent of: the product with
    /// [`ModelTangent::new`], which of parameters that change few numbers is not formed.
    ///
    /// # Errors
    /// [`ParameterError`] for one that the robot does not have.
    pub fn by(
        &self,
        robot: &Robot,
        loads: &Loads,
        parameter: Parameter,
    ) -> Result<f64, ParameterError> {
        check_slope(robot, parameter)?;
        Ok(match parameter {
            Parameter::Command(tendon) => self.command[tendon],
            Parameter::Force(disc, axis) => self.at_origin[disc].dot(&axis.unit()),
            Parameter::Moment(disc, axis) => self.moments[disc].dot(&axis.unit()),
            Parameter::Friction(tendon) => self.friction[tendon],
            Parameter::Gain(tendon) => self.stiffness[tendon] * series(robot, tendon).0,
            Parameter::AxialStiffness(tendon) => self.stiffness[tendon] * series(robot, tendon).1,
            _ => Self::new(robot, loads, parameter)?.dot(self),
        })
    }

    /// The tangent for `parameter` of `robot` under `loads`.
    ///
    /// # Errors
    /// [`ParameterError`] for one that the robot does not have.
    pub fn new(robot: &Robot, loads: &Loads, parameter: Parameter) -> Result<Self, ParameterError> {
        check_slope(robot, parameter)?;
        let mut tangent = Self::zero(robot);
        match parameter {
            Parameter::Command(tendon) => tangent.command[tendon] = 1.0,
            Parameter::Payload => tangent.hang(robot, loads),
            Parameter::Force(disc, axis) => tangent.at_origin[disc] = axis.unit(),
            Parameter::Moment(disc, axis) => tangent.moments[disc] = axis.unit(),
            Parameter::Friction(t) => tangent.friction[t] = 1.0,
            Parameter::Gain(t) => tangent.stiffness[t] = series(robot, t).0,
            Parameter::AxialStiffness(t) => tangent.stiffness[t] = series(robot, t).1,
            Parameter::Bending(module, axis) => tangent.stiffen(robot, module, axis),
            Parameter::Torsion(module) => tangent.stiffen(robot, module, Axis::Z),
            Parameter::HingeStiffness(module, hinge) => {
                tangent.stiffen(robot, module, Axis::ALL[hinge])
            }
            Parameter::Youngs(module) => tangent.stiffen_rod(robot, module),
            Parameter::Density(_)
            | Parameter::HoleRadius(_)
            | Parameter::Hole(..)
            | Parameter::Pitch(_) => tangent.move_spec(robot, loads, parameter),
            Parameter::Damping(module) => tangent.damping = joints_of(robot, module),
            Parameter::Armature(module) => tangent.armature = joints_of(robot, module),
        }
        Ok(tangent)
    }

    /// The payload's weight, and its inertia as a point mass.
    fn hang(&mut self, robot: &Robot, loads: &Loads) {
        let mut dead = DeadForces::new(robot);
        dead.set_payload(robot, loads, robot.gravity());
        self.payload = dead.payload;
        if let Some(tip) = self.inertias.last_mut() {
            *tip = Inertia::of_point(1.0, &dead.payload_arm);
        }
    }

    fn stiffen(&mut self, robot: &Robot, module: usize, axis: Axis) {
        for (disc, stiffness) in self.backbone.iter_mut().enumerate() {
            if robot.spec().module_of(disc) == Some(module) {
                *stiffness = axis.unit();
            }
        }
    }

    /// A rod's stiffness, and its damping with it, is in proportion to its Young's modulus.
    fn stiffen_rod(&mut self, robot: &Robot, module: usize) {
        let Some(rod) = robot.spec().modules[module].rod else {
            return;
        };
        for disc in 0..robot.discs().len() {
            if robot.spec().module_of(disc) == Some(module)
                && let Some(backbone) = &robot.discs()[disc].backbone
            {
                self.backbone[disc] = backbone.stiffness() / rod.youngs;
                let damping = rod.damping.of_joint(backbone) / rod.youngs;
                self.damping[disc] = damping.min();
                self.extra_damping[disc] = damping.add_scalar(-damping.min());
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
        for (i, force) in self.at_origin.iter_mut().enumerate() {
            *force = (high.1.at_origin[i] - low.1.at_origin[i]) * per_unit;
        }
        for (i, off_origin) in self.off_origin.iter_mut().enumerate() {
            let [low, high] = [&low.0, &high.0].map(|robot| {
                let disc = &robot.discs()[i];
                disc.centre_of_mass * disc.mass
            });
            *off_origin = (high - low) * per_unit;
        }
        for (i, inertia) in self.inertias.iter_mut().enumerate() {
            let [low, high] = [&low.0, &high.0].map(|robot| Inertia::of_disc(&robot.discs()[i]));
            *inertia = Inertia {
                mass: (high.mass - low.mass) * per_unit,
                moment: (high.moment - low.moment) * per_unit,
                rotational: (high.rotational - low.rotational) * per_unit,
            };
        }
        for (i, damping) in self.damping.iter_mut().enumerate() {
            let [low, high] = [&low.0, &high.0].map(|robot| &robot.discs()[i]);
            *damping = (high.damping - low.damping) * per_unit;
            self.extra_damping[i] = (high.extra_damping - low.extra_damping) * per_unit;
        }
        for (i, stiffness) in self.backbone.iter_mut().enumerate() {
            let joints = [&low.0, &high.0].map(|robot| robot.discs()[i].backbone);
            if let [Some(low), Some(high)] = joints {
                *stiffness = (high.stiffness() - low.stiffness()) * per_unit;
            }
        }
    }
}

/// Whether the robot has the parameter, and derivatives by it.
fn check_slope(robot: &Robot, parameter: Parameter) -> Result<(), ParameterError> {
    check(robot.spec(), parameter)?;
    match parameter {
        Parameter::Friction(_) if robot.spec().value(parameter)? == 0.0 => {
            Err(ParameterError::Missing {
                robot: robot.spec().name.clone(),
                parameter,
                reason: "its coefficient is 0, where the law of friction has a kink and no derivative",
            })
        }
        _ => Ok(()),
    }
}

/// 1 for the joints of a module, 0 for the others.
fn joints_of(robot: &Robot, module: usize) -> Vec<f64> {
    let of_module = |disc| f64::from(u8::from(robot.spec().module_of(disc) == Some(module)));
    (0..robot.discs().len()).map(of_module).collect()
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
