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

mod path;
mod problem;
mod target;

pub use path::{Arrival, PathPoint, ShapePath};
pub use target::{Goal, Target};

use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use thiserror::Error;

use crate::contact::{ContactEquilibrium, ContactError, ContactSettler};
use crate::robot::{Command, Loads, LoadsError, Robot};
use crate::scene::Scene;
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
    samples: Arc<[(Command, Equilibrium)]>,
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
    /// Whether that is enough, and if not, why.
    pub outcome: Outcome,
    /// Steps tried, over all starts.
    pub steps: usize,
}

/// How a search ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// Every target is met within the tolerance.
    Reached,
    /// Nothing near the command comes nearer to the targets: it is stationary. As the search is
    /// local, from the best of its starts, another command far off is not excluded.
    Unreachable {
        /// The tendons that a bound keeps from coming nearer.
        active: Vec<ActiveBound>,
        /// Frank and Wolfe's gap (m): the most that the weighted distance, the root of the weighted
        /// sum of squares, could fall by anywhere in the box of commands, were it linear. At most
        /// the tolerance.
        gap: f64,
    },
    /// The search came to a halt at a command that is not stationary, for example where tendons go
    /// slack, where equilibria vanish, or for want of steps.
    Stalled {
        /// As for [`Outcome::Unreachable`], above the tolerance.
        gap: f64,
    },
}

/// A tendon whose command is at the end of its range, and would have to go past it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActiveBound {
    /// The tendon.
    pub tendon: usize,
    /// Which end.
    pub bound: Bound,
}

/// An end of a tendon's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// The smallest command.
    Low,
    /// The largest command.
    High,
}

/// Why there is nothing to search for, or nothing to start from.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ShapeControlError {
    /// An empty list of targets.
    #[error("no target is given; expected at least one")]
    NoTarget,
    /// A target that makes no sense.
    #[error("target {index} is {target:?}: {reason}")]
    Target {
        /// Its place in the list, from 0.
        index: usize,
        /// The target.
        target: Target,
        /// What would be right.
        reason: &'static str,
    },
    /// A tolerance that is no length.
    #[error("the tolerance is {0} m; expected a finite length above 0")]
    Tolerance(f64),
    /// Loads of another robot.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// A command of another robot.
    #[error(transparent)]
    Command(#[from] crate::robot::CommandError),
    /// Among the obstacles there is nothing to settle.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// No equilibrium to start from.
    #[error("the robot settles stably under none of the {0} commands tried")]
    Unsettled(usize),
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
        let settled = match scene.is_empty() {
            true => robot.settle_batch(&commands, loads),
            false => settle_among(robot, scene, &commands, loads)?,
        };
        let tried = commands.len();
        let samples: Arc<[_]> = (commands.into_iter().zip(settled))
            .filter(|(_, equilibrium)| equilibrium.converged)
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
        let problem = self.problem(targets)?;
        problem.best_of(self.starts(targets))
    }

    /// The samples that come nearest to `targets`.
    fn starts(&self, targets: &[Target]) -> impl Iterator<Item = &(Command, Equilibrium)> {
        let cost = |sample: &(Command, Equilibrium)| {
            let weighted = |t: &Target| t.weight * t.error(&sample.1).norm_squared();
            targets.iter().map(weighted).sum::<f64>()
        };
        let mut order: Vec<(f64, usize)> = (self.samples.iter().enumerate())
            .map(|(index, sample)| (cost(sample), index))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let starts = order.into_iter().take(self.search.starts.max(1));
        starts.map(|(_, index)| &self.samples[index])
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
        let problem = self.problem(targets)?;
        let start = self.robot.command(start.as_slice())?;
        let settled = self.settled(&start)?;
        problem.best_of(std::iter::once(&(start, settled)))
    }

    /// Where the robot settles under a command, from the straight pose.
    fn settled(&self, command: &Command) -> Result<Equilibrium, ShapeControlError> {
        let mut settler = ContactSettler::new(&self.robot, &self.scene);
        Ok(settler.settle(command, &self.loads)?.equilibrium.clone())
    }

    fn problem<'p>(&'p self, targets: &'p [Target]) -> Result<Problem<'p>, ShapeControlError> {
        if targets.is_empty() {
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
        Ok(Problem {
            robot: &self.robot,
            scene: &self.scene,
            loads: &self.loads,
            search: &self.search,
            targets,
        })
    }
}

/// Where a robot settles among obstacles under each command, from the straight pose, on all cores.
fn settle_among(
    robot: &Robot,
    scene: &Scene,
    commands: &[Command],
    loads: &Loads,
) -> Result<Vec<Equilibrium>, ContactError> {
    let settle = |settler: &mut ContactSettler, command: &Command| {
        Ok(settler.settle(command, loads)?.equilibrium.clone())
    };
    (commands.par_iter())
        .map_init(|| ContactSettler::new(robot, scene), settle)
        .collect()
}
