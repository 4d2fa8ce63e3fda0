//! Forces that keep their size and direction, and so have a potential: weight, payload, line load,
//! and forces given in the world frame.
//!
//! A disc's weight is a force on its origin, and where its centre of mass lies elsewhere, at `c` in its
//! frame, also the couple `R c x m g` about there.

use nalgebra::{Matrix3, Vector3};

use crate::chain::Chain;
use crate::robot::{Frame, Loads, Robot};

/// Dead forces on the discs of a robot, world frame.
#[derive(Clone, Debug)]
pub(crate) struct DeadForces {
    /// Force on the origin of each disc (N), its weight among them.
    pub at_origin: Vec<Vector3<f64>>,
    /// Gravitational acceleration, world frame (m/s²).
    pub gravity: Vector3<f64>,
    /// Mass of each disc times its centre's place from the origin, disc frame (kg m).
    pub off_origin: Vec<Vector3<f64>>,
    /// Force of the payload on the distal disc (N).
    pub payload: Vector3<f64>,
    /// Where it acts, from the centre of the disc's joint, in the disc's frame (m).
    pub payload_arm: Vector3<f64>,
}

impl DeadForces {
    /// No forces on `robot`.
    pub fn new(robot: &Robot) -> Self {
        Self {
            at_origin: vec![Vector3::zeros(); robot.discs().len()],
            gravity: Vector3::zeros(),
            off_origin: vec![Vector3::zeros(); robot.discs().len()],
            payload: Vector3::zeros(),
            payload_arm: Vector3::zeros(),
        }
    }

    /// Sets the forces to the weight of `robot` and the dead forces among `loads`.
    ///
    /// # Panics
    /// If a wrench acts on a disc that the robot does not have ([`Loads::check`]).
    pub fn set(&mut self, robot: &Robot, loads: &Loads) {
        self.gravity = robot.gravity();
        for (off_origin, disc) in self.off_origin.iter_mut().zip(robot.discs()) {
            *off_origin = disc.centre_of_mass * disc.mass;
        }
        let line = loads.line_load();
        for (i, (force, disc)) in self.at_origin.iter_mut().zip(robot.discs()).enumerate() {
            let above = robot
                .discs()
                .get(i + 1)
                .map_or(0.0, |next| next.offset.norm());
            *force = robot.gravity() * disc.mass + line * (0.5 * (disc.offset.norm() + above));
        }
        for wrench in loads.wrenches() {
            if wrench.frame == Frame::World {
                self.at_origin[wrench.disc] += Vector3::from(wrench.force);
            }
        }
        let weight = robot.gravity() * loads.tip_payload().mass;
        self.set_payload(robot, loads, weight);
    }

    /// Sets the payload's force, acting where the payload of `loads` hangs.
    pub fn set_payload(&mut self, robot: &Robot, loads: &Loads, force: Vector3<f64>) {
        self.payload = force;
        let origin = robot
            .discs()
            .last()
            .map_or(Vector3::zeros(), |disc| disc.origin);
        self.payload_arm = origin + Vector3::from(loads.tip_payload().offset);
    }

    /// Mass of a disc times its centre's place from the origin, world axes (kg m); `None` where that
    /// is in the origin.
    #[inline(always)]
    pub fn off_origin(&self, disc: usize, orientation: &Matrix3<f64>) -> Option<Vector3<f64>> {
        let off_origin = &self.off_origin[disc];
        (*off_origin != Vector3::zeros()).then(|| orientation * off_origin)
    }

    /// Their potential (J) in the poses of `chain`.
    pub fn energy(&self, chain: &Chain) -> f64 {
        let forces = self.at_origin.iter().zip(&chain.positions);
        let lifted: f64 = forces.map(|(force, position)| force.dot(position)).sum();
        let off_origin: Vector3<f64> = (chain.orientations[1..].iter().enumerate())
            .filter_map(|(disc, orientation)| self.off_origin(disc, orientation))
            .sum();
        let tip = chain.positions.len() - 1;
        let hung = chain.centres[tip] + chain.disc(tip) * self.payload_arm;
        -lifted - self.gravity.dot(&off_origin) - self.payload.dot(&hung)
    }
}
