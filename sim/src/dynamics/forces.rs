//! What drives the joints: minus the gradient of the potential, and the loads that have none.

use nalgebra::Vector3;

use crate::chain::Configuration;
use crate::energy::following::{follower, follows};
use crate::energy::{DeadForces, Potential};
use crate::robot::{Loads, Robot, Wrench};
use crate::tendon::Posture;

/// The forces on one robot under one set of loads; reuses its memory.
#[derive(Clone, Debug)]
pub(super) struct Forces {
    robot: Robot,
    pub dead: DeadForces,
    /// The wrenches that have a part without a potential.
    followers: Vec<Wrench>,
    tensions: Vec<f64>,
}

impl Forces {
    pub fn new(robot: &Robot) -> Self {
        Self {
            robot: robot.clone(),
            dead: DeadForces::new(robot),
            followers: Vec::new(),
            tensions: vec![0.0; robot.tendons().len()],
        }
    }

    /// Sets the loads, which must act on discs that the robot has.
    pub fn set_loads(&mut self, loads: &Loads) {
        self.dead.set(&self.robot, loads);
        self.followers.clear();
        let following = loads.wrenches().iter().filter(|wrench| follows(wrench));
        self.followers.extend(following);
    }

    /// The potential under `command`.
    pub fn potential<'b>(&'b self, command: &'b [f64]) -> Potential<'b> {
        Potential {
            robot: &self.robot,
            command,
            dead: &self.dead,
        }
    }

    /// Torque on every joint (N m, world axes) at `q`, whose posture is `posture`.
    pub fn torques(
        &mut self,
        q: &Configuration,
        posture: &Posture,
        command: &[f64],
        out: &mut [Vector3<f64>],
    ) {
        let potential = Potential {
            robot: &self.robot,
            command,
            dead: &self.dead,
        };
        potential.gradient(q, posture, &mut self.tensions, out);
        out.iter_mut().for_each(|torque| *torque = -*torque);
        let chain = &posture.chain;
        for wrench in &self.followers {
            let (force, moment) = follower(wrench, chain.disc(wrench.disc));
            let origin = chain.positions[wrench.disc];
            for (torque, centre) in out.iter_mut().zip(&chain.centres).take(wrench.disc + 1) {
                *torque += moment + (origin - centre).cross(&force);
            }
        }
    }
}
