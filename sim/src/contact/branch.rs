//! Along a path of commands on a branch of equilibria, without friction.

use super::{ContactEquilibrium, ContactError, ContactSettler};
use crate::chain::Configuration;
use crate::robot::{Command, Loads, Robot};
use crate::scene::Scene;
use crate::solve::{Continuation, turn_between};

/// Largest turn of a joint in one substep (rad): an equilibrium farther away counts as one of another branch.
const RESOLUTION: f64 = 0.02;
/// Smallest part of the way to a command that is tried in one substep.
const MIN_SUBSTEP: f64 = 1e-5;

/// Leads a robot along a sequence of commands from equilibrium to equilibrium, without any friction, and counts where it leaves its
/// branch of them.
///
/// Between two commands the way is the straight line, in loads as in commands, in substeps over which no joint turns by more than
/// 0.02 rad, each settled from the one before. Where a substep of a hundred-thousandth of the way turns a joint farther, the branch ends
/// there, and the robot snaps: it descends its energy to another equilibrium, without inertia.
///
/// With friction of tendons, of obstacles or between discs [`ContactPath`](crate::tendon_friction::ContactPath) leads; friction of the scene counts for
/// nothing here.
///
/// ```
/// use tdcr_sim::contact::BranchPath;
/// use tdcr_sim::robot::{Loads, Robot};
/// use tdcr_sim::scene::{Obstacle, Scene};
///
/// let robot = Robot::load("2m")?;
/// let post = Obstacle::cylinder("post", 0.01, 0.4)?.at([-0.06, 0.0, 0.25]);
/// let mut path = BranchPath::new(&robot, &Scene::new(vec![post])?);
/// path.advance(&robot.mean_command(), &Loads::default())?;
/// let bent = robot.command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])?;
/// let found = path.advance(&bent, &Loads::default())?;
/// assert!(found.equilibrium.converged && !found.contacts.is_empty());
/// assert_eq!(path.snaps(), 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct BranchPath {
    settler: ContactSettler,
    /// Where the last equilibrium on the path is; none before the start.
    reached: Option<Reached>,
    snaps: usize,
}

/// An equilibrium on a path.
#[derive(Clone, Debug)]
struct Reached {
    command: Command,
    loads: Loads,
    configuration: Configuration,
}

impl BranchPath {
    /// Prepares to lead `robot` in `scene`.
    pub fn new(robot: &Robot, scene: &Scene) -> Self {
        let mut scene = scene.clone();
        scene = scene.without_own_friction();
        if scene.obstacles().iter().any(|own| own.friction > 0.0) {
            (scene.obstacles_mut().iter_mut()).for_each(|own| own.friction = 0.0);
        }
        Self {
            settler: ContactSettler::new(robot, &scene),
            reached: None,
            snaps: 0,
        }
    }

    /// Leads the robot along the straight line from the last command and loads to these. The first call settles it from the straight
    /// pose.
    ///
    /// Look at whether what is returned converged: where a command could not be reached it has not, and the path goes on from the
    /// last equilibrium that was.
    ///
    /// # Errors
    /// [`ContactError`] for a straight robot inside an obstacle, at the start, and for loads without a potential where there are
    /// obstacles.
    ///
    /// # Panics
    /// As [`ContactSettler::settle`].
    pub fn advance(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&ContactEquilibrium, ContactError> {
        match self.reached.take() {
            None => {
                self.settler.settle(command, loads)?;
                self.reached = self.arrived(command, loads);
            }
            Some(start) => {
                let mut at = start.clone();
                let led = self.lead(&start, &mut at, command, loads);
                self.reached = Some(at);
                led?;
            }
        }
        Ok(self.settler.found())
    }

    /// Leads the robot from `start`, as far as it goes; `at` is then where that is.
    fn lead(
        &mut self,
        start: &Reached,
        at: &mut Reached,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), ContactError> {
        // The turn at which strides aim.
        let aim = 0.8 * RESOLUTION;
        if !self.settler.found().equilibrium.converged {
            self.go_back(at)?;
        }
        let mut parts = Continuation::new(1.0, MIN_SUBSTEP);
        while let Some(part) = parts.target() {
            let between = start.command.towards(command, part);
            let loaded = start.loads.towards(loads, part);
            self.settler.follow(&between, &loaded)?;
            let found = self.arrived(&between, &loaded);
            let turn = (found.as_ref()).map_or(f64::INFINITY, |found| {
                turn_between(&at.configuration, &found.configuration)
            });
            match found {
                Some(found) if turn <= RESOLUTION => {
                    *at = found;
                    parts.succeed(f64::clamp(aim / turn, 1.0, 2.0));
                }
                Some(found) if parts.is_least() => {
                    *at = found;
                    self.snaps += 1;
                    parts.succeed(2.0);
                }
                _ => {
                    if !parts.fail(f64::clamp(aim / turn, 0.1, 0.8)) {
                        break;
                    }
                    parts.stride = parts.stride.max(MIN_SUBSTEP);
                    self.go_back(at)?;
                }
            }
        }
        Ok(())
    }

    /// Goes back to an equilibrium on the path.
    fn go_back(&mut self, at: &Reached) -> Result<(), ContactError> {
        (self.settler).settle_from(&at.configuration, &at.command, &at.loads)?;
        Ok(())
    }

    /// The last equilibrium that was sought, of a command and loads; none where there is none.
    fn arrived(&self, command: &Command, loads: &Loads) -> Option<Reached> {
        let found = &self.settler.found().equilibrium;
        found.converged.then(|| Reached {
            command: command.clone(),
            loads: loads.clone(),
            configuration: found.configuration.clone(),
        })
    }

    /// Snaps since the start: how often the branch ended on the way.
    pub fn snaps(&self) -> usize {
        self.snaps
    }

    /// What settles the robot: where it last has, and all that can be told of that.
    pub fn settler(&self) -> &ContactSettler {
        &self.settler
    }

    /// Smallest stiffness (N m/rad) where the path has come to: see [`ContactSettler::smallest_stiffness`]. `NaN` where the last command
    /// was not reached.
    pub fn smallest_stiffness(&mut self) -> f64 {
        match &self.reached {
            Some(at) if self.settler.found().equilibrium.converged => {
                self.settler.smallest_stiffness(&at.command, &at.loads)
            }
            _ => f64::NAN,
        }
    }
}
