//! Forces that keep their size and direction, and so have a potential: weight, payload, line load,
//! and forces given in the world frame.

use nalgebra::Vector3;

use crate::chain::Chain;
use crate::robot::{Frame, Loads, Robot};

/// Dead forces on the discs of a robot, world frame.
#[derive(Clone, Debug)]
pub(crate) struct DeadForces {
    /// Force on the origin of each disc (N).
    pub at_origin: Vec<Vector3<f64>>,
    /// Force of the payload on the distal disc (N).
    pub payload: Vector3<f64>,
    /// Where it acts, from the centre of the disc's joint, in the disc's frame (m).
    pub payload_arm: Vector3<f64>,
}

impl DeadForces {
    /// No forces on `robot`.
    pub fn new(robot: &Robot) -> Self {
        Self {
            at_origin: vec![Vector3::zeros(); robot.discs.len()],
            payload: Vector3::zeros(),
            payload_arm: Vector3::zeros(),
        }
    }

    /// Sets the forces to the weight of `robot` and the dead forces among `loads`.
    ///
    /// # Panics
    /// If a wrench acts on a disc that the robot does not have ([`Loads::check`]).
    pub fn set(&mut self, robot: &Robot, loads: &Loads) {
        let line = loads.line_load();
        for (i, (force, disc)) in self.at_origin.iter_mut().zip(&robot.discs).enumerate() {
            let above = robot
                .discs
                .get(i + 1)
                .map_or(0.0, |next| next.offset.norm());
            *force = robot.gravity * disc.mass + line * (0.5 * (disc.offset.norm() + above));
        }
        for wrench in loads.wrenches() {
            if wrench.frame == Frame::World {
                self.at_origin[wrench.disc] += Vector3::from(wrench.force);
            }
        }
        let weight = robot.gravity * loads.tip_payload().mass;
        self.set_payload(robot, loads, weight);
    }

    /// Sets the payload's force, acting where the payload of `loads` hangs.
    pub fn set_payload(&mut self, robot: &Robot, loads: &Loads, force: Vector3<f64>) {
        self.payload = force;
        let origin = robot
            .discs
            .last()
            .map_or(Vector3::zeros(), |disc| disc.origin);
        self.payload_arm = origin + Vector3::from(loads.tip_payload().offset);
    }

    /// Their potential (J) in the poses of `chain`.
    pub fn energy(&self, chain: &Chain) -> f64 {
        let forces = self.at_origin.iter().zip(&chain.positions);
        let lifted: f64 = forces.map(|(force, position)| force.dot(position)).sum();
        let tip = chain.positions.len() - 1;
        let hung = chain.centres[tip] + chain.disc(tip) * self.payload_arm;
        -lifted - self.payload.dot(&hung)
    }
}
