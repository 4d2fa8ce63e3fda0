//! Shape control: the command, within the tendons' ranges, that brings discs to targets.
//!
//! Minimises the weighted sum of the targets' squared errors over the box of commands, from those of
//! a few hundred sampled commands whose shapes come nearest. Every answer is checked by settling its
//! command from the straight pose, and says whether the targets are reached, or how it knows that
//! nothing better is near. Targets that move are followed by a [`ShapePath`].
//!
//! ```
//! use tdcr_sim::inverse::shape::{Outcome, Search, ShapeController, Target};
//! use tdcr_sim::robot::{Loads, Robot};
//!
//! let robot = Robot::load("2m")?;
//! let controller = ShapeController::new(&robot, &Loads::payload(0.01)?, Search::default())?;
//! let tip = Target::tip(&robot, [0.06, 0.03, 0.31].into());
//! let found = controller.reach(&[tip])?;
//! assert_eq!(found.outcome, Outcome::Reached);
//! println!("command {:?} m", found.command.as_slice());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod apart;
mod contact_goals;
mod error;
mod gap;
mod outcome;
mod path;
mod problem;
mod residuals;
mod target;

pub use apart::Obstruction;
pub use contact_goals::{ContactGoals, Press};
pub use error::ShapeControlError;
pub use outcome::{ActiveBound, Bound, Outcome};
pub use path::{Arrival, PathPoint, ShapePath};
pub use target::{Goal, Target};

use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::contact::{Contact, ContactEquilibrium, ContactError, ContactSettler};
use crate::robot::{Command, Loads, Robot};
use crate::scene::{Nearest, Scene};
use crate::statics::Equilibrium;
use problem::{Place, Problem, shares};

/// How to search for a command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Largest error (m) of a target that counts as met.
    pub tolerance: f64,
    /// Commands drawn, besides the middle one, to find starts among.
    pub samples: usize,
    /// Seed of these draws.
    pub seed: u64,
    /// Starts at most, the nearest first. More make it less likely that a target within reach is
    /// missed; all are tried before one is called unreachable.
    pub starts: usize,
    /// Steps of one descent at most.
    pub max_steps: usize,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            tolerance: 1e-6,
            samples: 255,
            seed: 0,
            starts: 12,
            max_steps: 300,
        }
    }
}

/// Finds commands for targets of one robot under given loads. Settles its samples once, for any
/// number of targets; clones share them.
#[derive(Clone, Debug)]
pub struct ShapeController {
    robot: Robot,
    scene: Scene,
    loads: Loads,
    search: Search,
    samples: Arc<[Sample]>,
}

/// A command, and where the robot settles under it.
#[derive(Clone, Debug)]
struct Sample {
    command: Command,
    equilibrium: Equilibrium,
    contacts: Vec<Contact>,
}

/// The best command found.
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeSolution {
    /// The command, within the tendons' ranges.
    pub command: Command,
    /// Where the robot settles under it: from the straight pose, as by [`Robot::settle`], but for a
    /// [`PathPoint`]'s.
    pub equilibrium: Equilibrium,
    /// The same with what the robot touches there; `None` without obstacles.
    pub among: Option<ContactEquilibrium>,
    /// Distance left to each target (m), without weights.
    pub errors: Vec<f64>,
    /// Normal force of each press asked for (N).
    pub forces: Vec<f64>,
    /// Of the obstacles that a clearance is asked for from, the nearest; `None` without.
    pub nearest: Option<Nearest>,
    /// Whether that is enough, and if not, why.
    pub outcome: Outcome,
    /// Steps tried, over all starts.
    pub steps: usize,
}

impl ShapeController {
    /// Prepares to control `robot` under `loads`: settles the sampled commands, on all cores.
    ///
    /// # Errors
    /// [`ShapeControlError`] for loads of another robot, a tolerance that is not above 0, and a robot that
    /// settles under no sampled command.
    pub fn new(robot: &Robot, loads: &Loads, search: Search) -> Result<Self, ShapeControlError> {
        Self::among(robot, &Scene::default(), loads, search)
    }

    /// The same among the obstacles of `scene`: every pose is settled among them, and slopes are those of the robot that
    /// touches them.
    ///
    /// Where a contact begins or ends slopes change at once, so that a search may come to a halt there
    /// ([`Outcome::Stalled`]); others of its starts go on from elsewhere.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`ShapeControlError::Contact`] for a straight robot inside an obstacle, and for loads
    /// without a potential where there are obstacles.
    pub fn among(
        robot: &Robot,
        scene: &Scene,
        loads: &Loads,
        search: Search,
    ) -> Result<Self, ShapeControlError> {
        loads.check(robot)?;
        if !(search.tolerance > 0.0 && search.tolerance.is_finite()) {
            return Err(ShapeControlError::Tolerance(search.tolerance));
        }
        let mut rng = ChaCha8Rng::seed_from_u64(search.seed);
        let mut commands = vec![robot.mean_command()];
        commands.extend((0..search.samples).map(|_| robot.random_command(&mut rng)));
        let tried = commands.len();
        let settled = match scene.is_empty() {
            true => settle_alone(robot, commands, loads),
            false => settle_among(robot, scene, commands, loads)?,
        };
        let samples: Arc<[_]> = (settled.into_iter())
            .filter(|sample| sample.equilibrium.converged)
            .collect();
        if samples.is_empty() {
            return Err(ShapeControlError::Unsettled(tried));
        }
        Ok(Self {
            robot: robot.clone(),
            scene: scene.clone(),
            loads: loads.clone(),
            search,
            samples,
        })
    }

    /// The obstacles around it.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The command under which the robot comes nearest to `targets`, as far as the search can tell:
    /// the first that meets them, or the best from all starts.
    ///
    /// # Errors
    /// [`ShapeControlError`] for no targets, or one that makes no sense; [`ShapeControlError::Unsettled`] if no
    /// start leads to a stable equilibrium.
    pub fn reach(&self, targets: &[Target]) -> Result<ShapeSolution, ShapeControlError> {
        self.reach_with(targets, &ContactGoals::default())
    }

    /// The same with `contact` asked for, too: forces to press on obstacles with, whose errors are added to those of the targets, of
    /// which there may then be none; or a clearance, which is kept first. Among the commands under which the robot keeps clear, settled
    /// from the straight pose among all obstacles, the one is sought that comes nearest. Where none was found the outcome is
    /// [`Outcome::TooNear`]; where an obstacle keeps the robot away from the targets, [`Outcome::Unreachable`] has it.
    ///
    /// ```
    /// use tdcr_sim::inverse::shape::{ContactGoals, Outcome, Press, Search, ShapeController, Target};
    /// use tdcr_sim::robot::{Loads, Robot};
    /// use tdcr_sim::scene::{Obstacle, Scene};
    ///
    /// let (robot, loads) = (Robot::load("2m")?, Loads::default());
    /// let scene = Scene::new(vec![Obstacle::cylinder("post", 0.01, 0.4)?.at([0.05, 0.03, 0.25])])?;
    /// let controller = ShapeController::among(&robot, &scene, &loads, Search::default())?;
    /// let tip = Target::tip(&robot, [-0.06, 0.03, 0.31].into());
    /// let clear = ContactGoals { clearance: Some(0.003), ..ContactGoals::default() };
    /// let found = controller.reach_with(&[tip], &clear)?;
    /// assert!(found.nearest.is_some_and(|nearest| nearest.gap >= 0.003));
    /// let push = ContactGoals { presses: vec![Press::new(0, 0.05)], ..ContactGoals::default() };
    /// let found = controller.reach_with(&[], &push)?;
    /// assert_eq!(found.outcome, Outcome::Reached);
    /// println!("{} N", found.forces[0]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`reach`](Self::reach); also for a clearance that is no distance or without obstacles, and for a force that makes no sense, or on
    /// an obstacle that is not there or can move.
    pub fn reach_with(
        &self,
        targets: &[Target],
        contact: &ContactGoals,
    ) -> Result<ShapeSolution, ShapeControlError> {
        let problem = self.problem(targets, contact)?;
        problem.best_of(problem.starts(&self.samples).into_iter())
    }

    /// A path of targets that the robot is led along without jumps. Its first targets are sought as by
    /// [`ShapeController::reach`].
    pub fn path(&self) -> ShapePath {
        ShapePath::new(self, None)
    }

    /// A path that starts where the robot settles under `start`, from the straight pose.
    ///
    /// # Errors
    /// [`ShapeControlError`] for a command of another robot, or under which it does not settle.
    pub fn path_from(&self, start: &Command) -> Result<ShapePath, ShapeControlError> {
        let start = self.robot.command(start.as_slice())?;
        let settled = self.settled(&start)?;
        if !settled.converged {
            return Err(ShapeControlError::Unsettled(1));
        }
        let x = shares(&self.robot, &start);
        Ok(ShapePath::new(self, Some(Place { x, settled })))
    }

    /// The command near `start` under which the robot comes nearest to `targets`. To follow targets
    /// that move without jumps, see [`ShapeController::path`].
    ///
    /// # Errors
    /// As [`ShapeController::reach`]; also for a command of another robot.
    pub fn reach_from(
        &self,
        targets: &[Target],
        start: &Command,
    ) -> Result<ShapeSolution, ShapeControlError> {
        let asked = ContactGoals::default();
        let problem = self.problem(targets, &asked)?;
        let command = self.robot.command(start.as_slice())?;
        let start = Sample {
            equilibrium: self.settled(&command)?,
            command,
            contacts: Vec::new(),
        };
        problem.best_of(std::iter::once(&start))
    }

    /// Where the robot settles under a command, from the straight pose.
    fn settled(&self, command: &Command) -> Result<Equilibrium, ShapeControlError> {
        let mut settler = ContactSettler::new(&self.robot, &self.scene);
        Ok(settler.settle(command, &self.loads)?.equilibrium.clone())
    }

    fn problem<'p>(
        &'p self,
        targets: &'p [Target],
        contact: &'p ContactGoals,
    ) -> Result<Problem<'p>, ShapeControlError> {
        self.check(targets, contact)?;
        Ok(Problem::new(self, targets, contact))
    }

    fn check(&self, targets: &[Target], contact: &ContactGoals) -> Result<(), ShapeControlError> {
        if targets.is_empty() && contact.presses.is_empty() {
            return Err(ShapeControlError::NoTarget);
        }
        for (index, target) in targets.iter().enumerate() {
            if let Some(reason) = target.fault(&self.robot) {
                return Err(ShapeControlError::Target {
                    index,
                    target: *target,
                    reason,
                });
            }
        }
        for (index, press) in contact.presses.iter().enumerate() {
            if let Some(reason) = press.fault(&self.robot, &self.scene) {
                return Err(ShapeControlError::Press {
                    index,
                    press: *press,
                    reason,
                });
            }
        }
        if let Some(clearance) = contact.clearance {
            if !(clearance >= 0.0 && clearance.is_finite()) {
                return Err(ShapeControlError::Clearance(clearance));
            }
            if self.scene.obstacles().is_empty() {
                return Err(ShapeControlError::NoObstacle);
            }
        }
        Ok(())
    }
}

/// Where a robot without obstacles settles under each command.
fn settle_alone(robot: &Robot, commands: Vec<Command>, loads: &Loads) -> Vec<Sample> {
    let settled = robot.settle_batch(&commands, loads);
    let sample = |(command, equilibrium)| Sample {
        command,
        equilibrium,
        contacts: Vec::new(),
    };
    commands.into_iter().zip(settled).map(sample).collect()
}

/// Where a robot settles among obstacles under each command, from the straight pose, on all cores.
fn settle_among(
    robot: &Robot,
    scene: &Scene,
    commands: Vec<Command>,
    loads: &Loads,
) -> Result<Vec<Sample>, ContactError> {
    let settle = |settler: &mut ContactSettler, command: Command| {
        let found = settler.settle(&command, loads)?;
        Ok(Sample {
            equilibrium: found.equilibrium.clone(),
            contacts: found.contacts.clone(),
            command,
        })
    };
    (commands.into_par_iter())
        .map_init(|| ContactSettler::new(robot, scene), settle)
        .collect()
}
