//! What the joints transmit: the free body of everything above a joint, by Newton's and Euler's laws.
//!
//! At rest, what the body below exerts on a disc through their joint holds the balance to everything else that acts on that
//! disc and on those above: weights, payload, line load, wrenches, and the pulls of the tendons on the holes. The moment
//! about a ball joint's centre is what its backbone and limit bear; the force, compression by the tendons included, is what
//! the joint has to hold.
//!
//! ```
//! use tdcr_sim::reactions::joint_reactions;
//! use tdcr_sim::robot::{Loads, Robot};
//!
//! let robot = Robot::load("2m")?;
//! let loads = Loads::payload(0.02)?;
//! let settled = robot.settle(&robot.mean_command(), &loads);
//! let reactions = joint_reactions(&robot, &settled.pose(), &loads)?;
//! // The tendons press the joints together: the body below pushes the disc up.
//! assert!(reactions[0].force.z > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The tension of a tendon is the same all along it ([`Pose::tendon_tensions`]) unless there is friction in its holes: then each
//! piece has its own ([`tensions`](crate::tendon_friction::TendonProfile::tensions)), and [`joint_reactions_with_friction`] takes those.

use nalgebra::Vector3;

use crate::chain::{Chain, Configuration};
use crate::energy::following::{follower, follows};
use crate::energy::{DeadForces, twist};
use crate::pose::Pose;
use crate::robot::{Body, Loads, LoadsError, Robot};
use crate::tendon_friction::FrictionState;

/// What the body below exerts on a disc through the ball joint between them, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointReaction {
    /// Centre of the joint (m).
    pub centre: Vector3<f64>,
    /// Force (N).
    pub force: Vector3<f64>,
    /// Moment about the centre (N m): that of the joint's backbone and limit.
    pub moment: Vector3<f64>,
}

/// The reaction of every joint of `robot` at rest in `pose` under `loads`, from the base up, without friction of the tendons.
/// O(n) time. In motion, the forces that accelerate the discs are not in it.
///
/// # Errors
/// [`LoadsError`] for a wrench on a disc that the robot does not have.
///
/// # Panics
/// If the pose is of another robot.
pub fn joint_reactions(
    robot: &Robot,
    pose: &Pose,
    loads: &Loads,
) -> Result<Vec<JointReaction>, LoadsError> {
    reactions(robot, pose.configuration, loads, |tendon, _| {
        pose.tendon_tensions[tendon]
    })
}

/// The same where a path with friction has come to, each piece of a tendon with the tension that it has there.
///
/// # Errors
/// As [`joint_reactions`].
///
/// # Panics
/// If the state is of another robot.
pub fn joint_reactions_with_friction(
    robot: &Robot,
    state: &FrictionState,
    loads: &Loads,
) -> Result<Vec<JointReaction>, LoadsError> {
    let configuration = &state.equilibrium.configuration;
    reactions(robot, configuration, loads, |tendon, place| {
        state.tendons[tendon].tensions[place]
    })
}

fn reactions(
    robot: &Robot,
    configuration: &Configuration,
    loads: &Loads,
    tension: impl Fn(usize, usize) -> f64,
) -> Result<Vec<JointReaction>, LoadsError> {
    loads.check(robot)?;
    let mut chain = Chain::new(robot);
    chain.place(robot, configuration);
    let mut acting = Acting::on(robot, &chain, loads);
    for (tendon, model) in robot.tendons().iter().enumerate() {
        for (place, ends) in model.route.windows(2).enumerate() {
            if ends[0].0 == ends[1].0 {
                continue;
            }
            let [from, to] = [ends[0], ends[1]].map(|end| {
                let disc = disc_of(end.0);
                (disc, chain.point(robot, disc, &robot.hole(end)))
            });
            let direction = (to.1 - from.1).try_normalize(0.0).unwrap_or_default();
            let pull = direction * tension(tendon, place);
            acting.add(&chain, from, pull);
            acting.add(&chain, to, -pull);
        }
    }
    Ok(acting.balanced(&chain))
}

fn disc_of(body: Body) -> Option<usize> {
    match body {
        Body::Base => None,
        Body::Disc(disc) => Some(disc),
    }
}

/// Force on each disc, and moment about its joint's centre, of everything but the joints.
struct Acting {
    forces: Vec<Vector3<f64>>,
    moments: Vec<Vector3<f64>>,
}

impl Acting {
    /// Weight and loads.
    fn on(robot: &Robot, chain: &Chain, loads: &Loads) -> Self {
        let n = robot.discs().len();
        let mut acting = Self {
            forces: vec![Vector3::zeros(); n],
            moments: vec![Vector3::zeros(); n],
        };
        let mut dead = DeadForces::new(robot);
        dead.set(robot, loads);
        for (disc, force) in dead.at_origin.iter().enumerate() {
            acting.add(chain, (Some(disc), chain.positions[disc]), *force);
            if let Some(couple) = dead.couple(disc, chain.disc(disc)) {
                acting.moments[disc] -= twist(&couple);
            }
        }
        if let Some(tip) = n.checked_sub(1) {
            let hung = chain.centres[tip] + chain.disc(tip) * dead.payload_arm;
            acting.add(chain, (Some(tip), hung), dead.payload);
        }
        for wrench in loads.wrenches().iter().filter(|wrench| follows(wrench)) {
            let disc = wrench.disc;
            let (force, moment) = follower(wrench, chain.disc(disc));
            acting.add(chain, (Some(disc), chain.positions[disc]), force);
            acting.moments[disc] += moment;
        }
        acting
    }

    /// Adds a force on a point of a disc; none on the base.
    fn add(&mut self, chain: &Chain, point: (Option<usize>, Vector3<f64>), force: Vector3<f64>) {
        if let (Some(disc), point) = point {
            self.forces[disc] += force;
            self.moments[disc] += (point - chain.centres[disc]).cross(&force);
        }
    }

    /// What balances it at each joint, from the tip down.
    fn balanced(&self, chain: &Chain) -> Vec<JointReaction> {
        let mut above = JointReaction {
            centre: Vector3::zeros(),
            force: Vector3::zeros(),
            moment: Vector3::zeros(),
        };
        let terms = self.forces.iter().zip(&self.moments).zip(&chain.centres);
        let mut reactions: Vec<_> = (terms.rev())
            .map(|((force, moment), centre)| {
                // The disc above bears on this one with the opposite of its reaction.
                let arm = above.centre - centre;
                above = JointReaction {
                    centre: *centre,
                    moment: above.moment + arm.cross(&above.force) - moment,
                    force: above.force - force,
                };
                above
            })
            .collect();
        reactions.reverse();
        reactions
    }
}
