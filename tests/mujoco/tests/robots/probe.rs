//! A robot in MuJoCo: put it where ours settles, and ask MuJoCo what it finds there.

use nalgebra::{DMatrix, DVector, Quaternion, UnitQuaternion, Vector3};
use tdcr_mujoco::{Data, Model};
use tdcr_sim::chain::Configuration;
use tdcr_sim::robot::{Command, Loads, Robot};

use crate::paper;

/// Largest force (N m) at which MuJoCo's own equilibrium counts as found.
const TOLERANCE: f64 = 1e-10;

/// The robot as a MuJoCo model.
pub fn model(robot: &Robot) -> Model {
    Model::from_xml(&paper::mjcf(&robot.spec().name)).unwrap()
}

/// A robot in MuJoCo under a command and loads.
pub struct Probe<'a> {
    data: Data<'a>,
    discs: usize,
    gravity: Vector3<f64>,
}

impl<'a> Probe<'a> {
    /// The robot in its straight pose, at rest.
    pub fn new(model: &'a Model, robot: &Robot, command: &Command, loads: &Loads) -> Self {
        let mut data = model.data().unwrap();
        data.ctrl_mut().copy_from_slice(command.as_slice());
        let (discs, gravity) = (robot.discs().len(), robot.spec().gravity.into());
        let mut probe = Self {
            data,
            discs,
            gravity,
        };
        probe.load(loads);
        probe
    }

    /// Hangs other loads on the robot.
    pub fn load(&mut self, loads: &Loads) {
        let weight = self.gravity * loads.tip_payload().mass;
        self.data
            .set_xfrc_applied(&disc_name(self.discs - 1), weight, Vector3::zeros())
            .unwrap();
    }

    /// Pushes a disc at its origin with a force (N) and a moment (N m), world axes.
    pub fn push(&mut self, disc: usize, force: Vector3<f64>, moment: Vector3<f64>) {
        (self.data)
            .set_xfrc_applied(&disc_name(disc), force, moment)
            .unwrap();
    }

    /// Gives other commands to the tendons.
    pub fn command(&mut self, command: &Command) {
        self.data.ctrl_mut().copy_from_slice(command.as_slice());
    }

    /// Sets the joints in motion, without moving them: rates in the discs' frames (rad/s).
    pub fn set_in_motion(&mut self, velocity: &[f64]) {
        self.data.qvel_mut().copy_from_slice(velocity);
        self.data.forward();
    }

    /// Brings poses up to date with the joints.
    pub fn look(&mut self) {
        self.data.forward();
    }

    /// Lays the robot to rest in a configuration.
    pub fn place(&mut self, configuration: &Configuration) {
        for (qpos, joint) in self
            .data
            .qpos_mut()
            .chunks_exact_mut(4)
            .zip(&configuration.0)
        {
            qpos.copy_from_slice(&[joint.w, joint.i, joint.j, joint.k]);
        }
        self.data.qvel_mut().fill(0.0);
        self.data.forward();
    }

    /// Lays the robot to rest at MuJoCo's coordinates.
    pub fn place_at(&mut self, qpos: &[f64]) {
        self.data.qpos_mut().copy_from_slice(qpos);
        self.data.qvel_mut().fill(0.0);
        self.data.forward();
    }

    /// Largest force on a joint (N m) at rest in a configuration.
    pub fn force_at(&mut self, configuration: &Configuration) -> f64 {
        self.place(configuration);
        DVector::from_column_slice(self.data.qfrc_smooth()).amax()
    }

    /// Lets time pass.
    pub fn step(&mut self, steps: usize) {
        for _ in 0..steps {
            self.data.step();
        }
    }

    /// Newton's method on MuJoCo's own forces, their Jacobian by central differences, from where the
    /// robot is.
    pub fn refine(&mut self) {
        let mut configuration = self.configuration();
        for _ in 0..60 {
            let force = self.forces(&configuration);
            if force.amax() <= TOLERANCE {
                return;
            }
            let dofs = force.len();
            let mut jacobian = DMatrix::zeros(dofs, dofs);
            for (coordinate, mut column) in jacobian.column_iter_mut().enumerate() {
                let mut turn = DVector::zeros(dofs);
                turn[coordinate] = 1e-6;
                let ahead = self.forces(&turned(&configuration, &turn));
                let behind = self.forces(&turned(&configuration, &-turn));
                column.copy_from(&((ahead - behind) / 2e-6));
            }
            let mut step = jacobian.lu().solve(&-force).unwrap();
            step *= (0.3 / step.amax()).min(1.0);
            configuration = turned(&configuration, &step);
        }
        panic!("MuJoCo's forces were not brought to zero");
    }

    /// Position (m) and orientation of a disc in the world.
    pub fn disc_pose(&self, disc: usize) -> (Vector3<f64>, UnitQuaternion<f64>) {
        let name = disc_name(disc);
        (
            self.data.body_position(&name).unwrap(),
            self.data.body_orientation(&name).unwrap(),
        )
    }

    /// What MuJoCo says.
    pub fn data(&self) -> &Data<'a> {
        &self.data
    }

    fn configuration(&self) -> Configuration {
        let joint = |q: &[f64]| Quaternion::new(q[0], q[1], q[2], q[3]);
        let joints = self.data.qpos().chunks_exact(4).map(joint);
        Configuration(joints.map(UnitQuaternion::from_quaternion).collect())
    }

    fn forces(&mut self, configuration: &Configuration) -> DVector<f64> {
        self.place(configuration);
        DVector::from_column_slice(self.data.qfrc_smooth())
    }
}

/// The configuration with each joint turned by three coordinates (rad) in its disc's own frame.
fn turned(configuration: &Configuration, turn: &DVector<f64>) -> Configuration {
    let turns = turn.as_slice().chunks_exact(3);
    let turns = turns.map(|t| UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(t)));
    Configuration(
        configuration
            .0
            .iter()
            .zip(turns)
            .map(|(q, t)| q * t)
            .collect(),
    )
}

/// Largest difference of corresponding entries.
pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    (DVector::from_column_slice(a) - DVector::from_column_slice(b)).amax()
}

fn disc_name(disc: usize) -> String {
    format!("disc{disc}")
}
