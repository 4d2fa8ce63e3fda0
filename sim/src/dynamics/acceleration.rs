//! From state and command to accelerations.

use nalgebra::{Matrix3, Vector3};

use super::DynamicsError;
use super::articulated::ArticulatedBodies;
use super::forces::Forces;
use super::interim;
use super::links::{Link, Motion, PointMass, set_in_motion};
use super::state::{Energy, State};
use super::symmetric::{times, transpose_times};
use crate::chain::{Chain, Configuration};
use crate::robot::{Command, Loads, Robot};

/// The equations of motion of one robot; reuses its memory.
#[derive(Clone, Debug)]
pub(super) struct EquationsOfMotion<'a> {
    pub robot: &'a Robot,
    pub base: Matrix3<f64>,
    pub links: Vec<Link>,
    pub payload: PointMass,
    pub forces: Forces<'a>,
    pub chain: Chain,
    pub motions: Vec<Motion>,
    /// Torque on every joint but that of its armature (N m), world axes.
    pub torques: Vec<Vector3<f64>>,
    bodies: ArticulatedBodies,
    /// Acceleration of every joint (rad/s²), world axes.
    accelerations: Vec<Vector3<f64>>,
}

impl<'a> EquationsOfMotion<'a> {
    pub fn new(robot: &'a Robot) -> Result<Self, DynamicsError> {
        if let Some(tendon) = robot.tendons.iter().position(|t| t.stiffness.is_infinite()) {
            return Err(DynamicsError::Inextensible { tendon });
        }
        let n = robot.discs.len();
        Ok(Self {
            robot,
            base: *robot.base_orientation.to_rotation_matrix().matrix(),
            links: Link::all(robot),
            payload: PointMass::payload(robot, &Loads::default()),
            forces: Forces::new(robot),
            chain: Chain::new(robot),
            motions: vec![Motion::default(); n],
            torques: vec![Vector3::zeros(); n],
            bodies: ArticulatedBodies::new(n),
            accelerations: vec![Vector3::zeros(); n],
        })
    }

    /// Whether state, command and loads are of this robot.
    pub fn check(
        &self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        let dof = self.robot.dof();
        self.check_size("configuration", state.configuration.0.len(), dof / 3)?;
        self.check_size("velocity", state.velocity.len(), dof)?;
        let tendons = self.robot.tendons.len();
        self.check_size("command", command.as_slice().len(), tendons)?;
        Ok(loads.check(self.robot)?)
    }

    pub fn check_size(
        &self,
        what: &'static str,
        found: usize,
        expected: usize,
    ) -> Result<(), DynamicsError> {
        if found == expected {
            return Ok(());
        }
        Err(DynamicsError::Size {
            what,
            robot: self.robot.spec().name.clone(),
            expected,
            found,
        })
    }

    pub fn set_loads(&mut self, loads: &Loads) {
        self.payload = PointMass::payload(self.robot, loads);
        self.forces.set_loads(loads);
    }

    /// Poses, motions and torques, damping included, in a state.
    pub fn enter(&mut self, q: &Configuration, velocity: &[f64], command: &[f64]) {
        self.chain.place(self.robot, q);
        let orientations = interim::discs(&self.chain);
        set_in_motion(
            &self.links,
            &self.base,
            orientations,
            velocity,
            &mut self.motions,
        );
        self.forces
            .torques(q, &self.chain, command, &mut self.torques);
        for ((torque, link), motion) in self.torques.iter_mut().zip(&self.links).zip(&self.motions)
        {
            *torque -= motion.rate * link.damping;
        }
    }

    /// Writes the accelerations in a state, each in its disc's frame (rad/s²), to `out`:
    /// `(M + diag(armatures - armature))^-1 (torques - bias)`.
    pub fn accelerate(
        &mut self,
        q: &Configuration,
        velocity: &[f64],
        command: &[f64],
        armatures: &[f64],
        out: &mut [f64],
    ) {
        self.enter(q, velocity, command);
        let orientations = interim::discs(&self.chain);
        self.bodies.accelerate(
            &self.links,
            &self.payload,
            armatures,
            orientations,
            &self.motions,
            &self.torques,
            &mut self.accelerations,
        );
        let world = orientations.iter().zip(&self.accelerations);
        for (out, (orientation, acceleration)) in out.as_chunks_mut::<3>().0.iter_mut().zip(world) {
            *out = transpose_times(orientation, acceleration).into();
        }
    }

    /// Energy in a state.
    pub fn energy(&mut self, state: &State, command: &[f64]) -> Energy {
        self.enter(&state.configuration, &state.velocity, command);
        let orientations = interim::discs(&self.chain);
        let mut kinetic = 0.0;
        let mut below = Motion::default();
        let mut shift = Vector3::zeros();
        let last = self.links.len() - 1;
        for (i, (link, motion)) in self.links.iter().zip(&self.motions).enumerate() {
            shift += below.spin.cross(&motion.arm);
            let mut body = link.body(&orientations[i]);
            if i == last {
                body = body.with(&self.payload.body(&orientations[i]));
            }
            let spin = &motion.spin;
            kinetic += 0.5 * body.mass * shift.norm_squared()
                + shift.dot(&spin.cross(&body.moment))
                + 0.5 * spin.dot(&body.inertia.times(spin))
                + 0.5 * link.armature * motion.rate.norm_squared();
            below = *motion;
        }
        Energy {
            kinetic,
            potential: self.forces.potential(command).energy(&self.chain),
        }
    }

    /// World vectors from the discs' frames.
    pub fn to_world(&self, local: &[f64], out: &mut [Vector3<f64>]) {
        let turned = interim::discs(&self.chain)
            .iter()
            .zip(local.as_chunks::<3>().0);
        for (out, (orientation, local)) in out.iter_mut().zip(turned) {
            *out = times(orientation, &Vector3::from(*local));
        }
    }
}
