//! What drives the joints: minus the gradient of the potential, and the loads that have none.

use nalgebra::{Matrix3, Vector3};

use super::interim::{self, DeadForces, Potential, Slopes};
use crate::chain::{Chain, Configuration};
use crate::robot::{Frame, Loads, Robot, Wrench};

/// The forces on one robot under one set of loads; reuses its memory.
#[derive(Clone, Debug)]
pub(super) struct Forces<'a> {
    robot: &'a Robot,
    base: Matrix3<f64>,
    dead: DeadForces,
    live: Vec<LiveWrench>,
    slopes: Slopes,
}

/// A load that has no potential: a moment, or a force that turns with its disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct LiveWrench {
    pub disc: usize,
    /// Force on the disc's origin, in the disc's frame (N).
    pub follower: Vector3<f64>,
    /// Moment (N m), and the frame that it is in.
    pub moment: Vector3<f64>,
    pub frame: Frame,
}

impl LiveWrench {
    fn of(wrench: &Wrench) -> Option<Self> {
        let follower = match wrench.frame {
            Frame::World => [0.0; 3],
            Frame::Disc => wrench.force,
        };
        let live = follower != [0.0; 3] || wrench.moment != [0.0; 3];
        live.then(|| Self {
            disc: wrench.disc,
            follower: follower.into(),
            moment: wrench.moment.into(),
            frame: wrench.frame,
        })
    }

    /// Force and moment in the world, on a disc turned to `orientation`.
    pub fn in_world(&self, orientation: &Matrix3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let moment = match self.frame {
            Frame::World => self.moment,
            Frame::Disc => orientation * self.moment,
        };
        (orientation * self.follower, moment)
    }
}

impl<'a> Forces<'a> {
    pub fn new(robot: &'a Robot) -> Self {
        Self {
            robot,
            base: *robot.base_orientation.to_rotation_matrix().matrix(),
            dead: DeadForces::new(robot),
            live: Vec::new(),
            slopes: Slopes::new(robot),
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

    /// The loads that have no potential.
    pub fn live(&self) -> &[LiveWrench] {
        &self.live
    }

    /// Torque on every joint (N m, world axes) in the configuration `q`, whose poses are in `chain`.
    pub fn torques(
        &mut self,
        q: &Configuration,
        chain: &Chain,
        command: &[f64],
        out: &mut [Vector3<f64>],
    ) {
        let potential = Potential {
            robot: self.robot,
            command,
            dead: &self.dead,
        };
        potential.gradient(q, chain, &self.base, &mut self.slopes, out);
        out.iter_mut().for_each(|torque| *torque = -*torque);
        for wrench in &self.live {
            let orientation = &interim::discs(chain)[wrench.disc];
            let (force, moment) = wrench.in_world(orientation);
            let centres = interim::centres(chain);
            let origin = centres[wrench.disc] + orientation * self.robot.discs[wrench.disc].origin;
            for (torque, centre) in out.iter_mut().zip(centres).take(wrench.disc + 1) {
                *torque += moment + (origin - centre).cross(&force);
            }
        }
    }
}
