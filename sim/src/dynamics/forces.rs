//! What drives the joints: minus the gradient of the potential, and the loads that have none.

use nalgebra::{Matrix3, Vector3};

use crate::chain::{Chain, Configuration};
use crate::energy::{DeadForces, Potential};
use crate::robot::{Frame, Loads, Robot, Wrench};
use crate::tendon::Posture;

/// The forces on one robot under one set of loads; reuses its memory.
#[derive(Clone, Debug)]
pub(super) struct Forces<'a> {
    robot: &'a Robot,
    dead: DeadForces,
    /// The loads that have no potential.
    pub live: Vec<LiveWrench>,
    tensions: Vec<f64>,
}

/// A load that has no potential: a moment, or a force that turns with its disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct LiveWrench {
    /// The disc that it acts on.
    pub disc: usize,
    /// Whether it turns with the disc.
    pub frame: Frame,
    /// Force on the disc's origin (N); none in the world frame, where it has a potential.
    force: Vector3<f64>,
    /// Moment (N m).
    moment: Vector3<f64>,
}

impl LiveWrench {
    fn of(wrench: &Wrench) -> Option<Self> {
        let force = match wrench.frame {
            Frame::World => [0.0; 3],
            Frame::Disc => wrench.force,
        };
        let live = force != [0.0; 3] || wrench.moment != [0.0; 3];
        live.then(|| Self {
            disc: wrench.disc,
            frame: wrench.frame,
            force: force.into(),
            moment: wrench.moment.into(),
        })
    }

    /// Force on the disc's origin and moment, world axes.
    pub fn in_world(&self, orientation: &Matrix3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        match self.frame {
            Frame::World => (self.force, self.moment),
            Frame::Disc => (orientation * self.force, orientation * self.moment),
        }
    }

    fn add(&self, chain: &Chain, torques: &mut [Vector3<f64>]) {
        let (force, moment) = self.in_world(chain.disc(self.disc));
        let origin = chain.positions[self.disc];
        for (torque, centre) in torques.iter_mut().zip(&chain.centres).take(self.disc + 1) {
            *torque += moment + (origin - centre).cross(&force);
        }
    }
}

impl<'a> Forces<'a> {
    pub fn new(robot: &'a Robot) -> Self {
        Self {
            robot,
            dead: DeadForces::new(robot),
            live: Vec::new(),
            tensions: vec![0.0; robot.tendons.len()],
        }
    }

    /// Sets the loads, which must act on discs that the robot has.
    pub fn set_loads(&mut self, loads: &Loads) {
        self.dead.set(self.robot, loads);
        self.live.clear();
        self.live
            .extend(loads.wrenches().iter().filter_map(LiveWrench::of));
    }

    /// The potential under `command`.
    pub fn potential<'b>(&'b self, command: &'b [f64]) -> Potential<'b> {
        Potential {
            robot: self.robot,
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
            robot: self.robot,
            command,
            dead: &self.dead,
        };
        potential.gradient(q, posture, &mut self.tensions, out);
        out.iter_mut().for_each(|torque| *torque = -*torque);
        self.live
            .iter()
            .for_each(|wrench| wrench.add(&posture.chain, out));
    }
}
