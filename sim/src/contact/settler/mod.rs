//! From command to equilibrium among obstacles.

mod nearby;

use super::active::ActiveStep;
use super::descent::Minimisation;
use super::equations::Equations;
use super::law::Hardness;
use super::near_pairs::PairNeighbourhood;
use super::report::report;
use super::{Contact, ContactEquilibrium, ContactError, ContactSensitivity, Sliding};
use crate::chain::Configuration;
use crate::energy::following::follows;
use crate::energy::{DeadForces, Potential};
use crate::geometry::Beads;
use crate::robot::{Command, Loads, Robot, Tendon};
use crate::scene::Scene;
use crate::sensitivity::SensitivityError;
use crate::solve::{MAX_CORRECTIONS, length_errors, newton};
use crate::statics::{Settler, Stability};

/// The barrier of a solution (J), for each N m of the tolerance of a robot's moments.
const LAST_BARRIER: f64 = 1e-5;
/// Compliance of the softest contacts (m/N), for each square metre of the widest gap within which they count and each N m of the
/// tolerance. A push of the size of the robot's own moments presses a bead in by a fraction of its radius.
const SOFT: f64 = 1e-8;
/// Length over which the force of the softest contacts rises, for each metre of that gap.
const ROUND: f64 = 0.01;
/// Steps from the softest contacts to those that there are.
const STAGES: u32 = 3;
/// Residual at which the softest contacts count as solved, for each N m of the tolerance.
const LOOSE: f64 = 1e6;
/// How often an unstable equilibrium is left for another one.
const MAX_SADDLES: usize = 5;
/// How often the normal forces are taken over that friction is bounded by.
const MAX_LAGS: usize = 100;

/// Where a solve starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Start {
    /// From the straight pose.
    Straight,
    /// From a configuration near the equilibrium.
    Near,
    /// From the last equilibrium, from which on friction counts.
    Before,
    /// The same from beside the equilibrium that is sought, or an unstable one.
    Beside,
}

impl Start {
    /// Whether friction counts.
    fn is_on_path(self) -> bool {
        matches!(self, Self::Before | Self::Beside)
    }
}

/// Settles commands of one robot among the obstacles of one scene, one after another. In a scene without obstacles this is
/// [`Settler`].
///
/// ```
/// use tdcr_sim::contact::ContactSettler;
/// use tdcr_sim::robot::{Loads, Robot};
/// use tdcr_sim::scene::{Obstacle, Scene};
///
/// let robot = Robot::load("2m")?;
/// let post = Obstacle::cylinder("post", 0.01, 0.4)?.at([-0.06, 0.0, 0.25]);
/// let scene = Scene::new(vec![post])?;
/// let command = robot.command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])?;
/// let mut settler = ContactSettler::new(&robot, &scene);
/// let found = settler.settle(&command, &Loads::default())?;
/// assert!(found.equilibrium.converged);
/// for contact in &found.contacts {
///     println!("disc {} bears {} N", contact.disc, contact.force.norm());
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ContactSettler {
    pub(super) equations: Equations,
    active: ActiveStep,
    /// Where there are no obstacles.
    free: Settler,
    weight: DeadForces,
    /// The command, with the rest lengths of tendons whose length is commanded corrected.
    command: Vec<f64>,
    loads: Loads,
    /// The same of the last equilibrium.
    before: (Vec<f64>, Loads),
    /// Largest residual (N m).
    tolerance: f64,
    result: ContactEquilibrium,
}

impl ContactSettler {
    /// Prepares to settle `robot` in `scene`, with the collision geometry [`Beads::new`].
    pub fn new(robot: &Robot, scene: &Scene) -> Self {
        Self::with_beads(robot, scene, Beads::new(robot))
    }

    /// The same with other collision geometry of the robot.
    pub fn with_beads(robot: &Robot, scene: &Scene, beads: Beads) -> Self {
        Self {
            equations: Equations::new(robot, scene, beads),
            active: ActiveStep::new(robot),
            free: Settler::new(robot),
            weight: DeadForces::new(robot),
            command: vec![0.0; robot.tendons().len()],
            loads: Loads::default(),
            before: (vec![0.0; robot.tendons().len()], Loads::default()),
            tolerance: 0.0,
            result: ContactEquilibrium::unsettled(robot),
        }
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.equations.robot
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.equations.scene
    }

    /// The robot's collision geometry.
    pub fn beads(&self) -> &Beads {
        &self.equations.beads
    }

    /// For each disc the first above it that it can touch, which it can all from there on; `None` where discs pass through each
    /// other.
    pub fn touchable(&self) -> Option<&[usize]> {
        self.equations.pairs.as_ref().map(PairNeighbourhood::first)
    }

    /// Where the robot last settled; before that, the straight pose, not converged.
    pub fn found(&self) -> &ContactEquilibrium {
        &self.result
    }

    /// Settles the robot under `command` and `loads` from the straight pose. Look at whether it converged.
    ///
    /// # Errors
    /// [`ContactError`] for a straight robot inside an obstacle, and for loads without a potential where there are obstacles.
    ///
    /// # Panics
    /// If the command or the loads are of another robot, with fewer tendons or more discs; so do the functions below.
    pub fn settle(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&ContactEquilibrium, ContactError> {
        if self.is_free() {
            self.free.settle(command, loads);
            if self.take_free(command, loads) {
                return Ok(&self.result);
            }
        }
        self.equations.iterate.set_straight();
        self.equations.bristles.clear();
        self.equations.check_outside()?;
        self.solve(command, loads, Start::Straight)
    }

    /// Settles the robot from the configuration `start`, near the equilibrium: the way to go on when the base or an obstacle has moved.
    /// What is inside an obstacle there comes out the nearest way.
    ///
    /// # Errors
    /// [`ContactError::Loads`] for loads without a potential, where there are obstacles.
    ///
    /// # Panics
    /// If `start` has another number of joints than the robot.
    pub fn settle_from(
        &mut self,
        start: &Configuration,
        command: &Command,
        loads: &Loads,
    ) -> Result<&ContactEquilibrium, ContactError> {
        if self.is_free() {
            self.free.settle_from(start, command, loads);
            if self.take_free(command, loads) {
                return Ok(&self.result);
            }
        }
        self.equations.iterate.set(start);
        self.equations.bristles.clear();
        self.solve(command, loads, Start::Near)
    }

    /// Settles the robot from its last equilibrium: the way to follow one equilibrium along a path of commands. Before anything has
    /// settled, the same as [`settle`](Self::settle).
    ///
    /// Contacts with obstacles of some friction, and those between discs where the scene has that, resist sliding from where they were at
    /// the last equilibrium, those that are new from where they first touch: the path is one of small steps. Where a robot settles otherwise its contacts bear no friction, nor
    /// do those of a scene with [smoothing](Scene::with_smoothing), as its surfaces push each other before they touch.
    ///
    /// # Errors
    /// As [`settle`](Self::settle) where nothing has settled, else as [`settle_from`](Self::settle_from).
    pub fn follow(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&ContactEquilibrium, ContactError> {
        if !self.result.equilibrium.converged {
            return self.settle(command, loads);
        }
        if self.is_free() && !self.is_held() {
            self.free.follow(command, loads);
            if self.take_free(command, loads) {
                return Ok(&self.result);
            }
            let before = self.result.equilibrium.configuration.clone();
            self.equations.iterate.set(&before);
            self.equations.find();
        }
        if self.scene().smoothing() > 0.0 {
            return self.solve(command, loads, Start::Near);
        }
        self.solve(command, loads, Start::Before)?;
        self.equations.stick_bristles();
        Ok(&self.result)
    }

    /// Prepares to differentiate the last equilibrium, of `command` and `loads`.
    ///
    /// # Errors
    /// [`SensitivityError`] if the robot has not settled, or not stably; [`SensitivityError::Slipping`] for a contact that slips,
    /// [`SensitivityError::SelfFriction`] for one between discs that has friction.
    pub fn sensitivity(
        &self,
        command: &Command,
        loads: &Loads,
    ) -> Result<ContactSensitivity, SensitivityError> {
        let mut rubbing = self.equations.bristles.iter();
        if let Some([disc, other]) = rubbing.find_map(|bristle| bristle.surfaces().discs()) {
            return Err(SensitivityError::SelfFriction { disc, other });
        }
        let slips = |contact: &&Contact| contact.sliding == Sliding::Slips;
        if let Some(contact) = self.result.contacts.iter().find(slips) {
            return Err(SensitivityError::Slipping {
                disc: contact.disc,
                obstacle: contact.partner.obstacle().unwrap_or_default(),
            });
        }
        ContactSensitivity::new(&self.equations, command, loads, &self.result.equilibrium)
    }

    /// Smallest eigenvalue of the Hessian of the energy by the joints' turns at the last equilibrium of `command` and `loads`, with the
    /// contacts' stiffness in it (N m/rad): see [`Robot::smallest_stiffness`]. `NaN` if it cannot be computed.
    pub fn smallest_stiffness(&mut self, command: &Command, loads: &Loads) -> f64 {
        let found = &self.result.equilibrium;
        // Without a barrier what does not touch does not press.
        if self.result.barrier == 0.0 && self.result.contacts.is_empty() {
            return self.robot().smallest_stiffness(command, loads, found);
        }
        if !found.converged {
            return f64::NAN;
        }
        self.equations.smallest_stiffness()
    }

    fn is_free(&self) -> bool {
        self.equations.scene.obstacles().is_empty()
    }

    /// Whether friction between discs may hold the robot where it rests.
    fn is_held(&self) -> bool {
        self.equations.rubs_itself() && !self.result.contacts.is_empty()
    }

    /// Takes over where the robot settled without obstacles, if it does not touch itself there: then that is where it settles.
    fn take_free(&mut self, command: &Command, loads: &Loads) -> bool {
        let found = self.free.equilibrium();
        if found.converged && self.equations.overlaps_itself(&found.configuration) {
            return false;
        }
        self.equations.clear();
        self.command.copy_from_slice(command.as_slice());
        self.loads.clone_from(loads);
        let out = &mut self.result;
        out.equilibrium.clone_from(found);
        out.contacts.clear();
        (out.complementarity, out.penetration, out.barrier) = (0.0, 0.0, 0.0);
        true
    }

    /// Settles `command` from wherever the iterate stands.
    fn solve(
        &mut self,
        command: &Command,
        loads: &Loads,
        start: Start,
    ) -> Result<&ContactEquilibrium, ContactError> {
        if let Some(wrench) = loads.wrenches().iter().find(|wrench| follows(wrench)) {
            return Err(ContactError::Loads { disc: wrench.disc });
        }
        if start == Start::Before && self.equations.rubs() {
            self.equations.press_bristles();
        }
        self.equations.neighbourhood.clear();
        let robot = &self.equations.robot;
        self.weight.set(robot, loads);
        self.before.0.copy_from_slice(&self.command);
        self.before.1.clone_from(&self.loads);
        self.command.copy_from_slice(command.as_slice());
        self.loads.clone_from(loads);
        self.tolerance = (self.equations.own_tolerance)
            .max(robot.load_rounding(loads))
            .max(self.equations.rounding());
        let (solved, mut iterations) = self.rest(command, start);
        // An unstable equilibrium is left for another one.
        let mut stability = solved.then(|| self.equations.stability());
        for _ in 0..MAX_SADDLES {
            if stability != Some(Stability::Unstable) || !self.equations.leave_saddle() {
                break;
            }
            let start = match start {
                Start::Straight | Start::Near => Start::Near,
                Start::Before | Start::Beside => Start::Beside,
            };
            let (solved, steps) = self.rest(command, start);
            iterations += steps;
            stability = solved.then(|| self.equations.stability());
        }
        report(&mut self.equations, stability, iterations, &mut self.result);
        Ok(&self.result)
    }

    /// Solves from where a solve starts, friction and commanded lengths in it: along a path by the balance with an active set, and where that
    /// leads nowhere down the energy, with bounds of friction that follow. Whether that is solved, and the number of steps.
    fn rest(&mut self, command: &Command, start: Start) -> (bool, usize) {
        let mut iterations = 0;
        let rubs = !self.equations.bristles.is_empty();
        // Rest lengths are corrected at the end of a solve: what slides for want of that would stay.
        if start == Start::Before && rubs && !self.holds_lengths() {
            let (led, steps) = self.balance_rubbing();
            if led {
                return (true, steps);
            }
            iterations = steps;
        }
        let (mut solved, steps) = self.hold(command, start);
        iterations += steps;
        for lag in 0.. {
            if !solved || !start.is_on_path() || !self.equations.rubs() {
                break;
            }
            // Until friction is bounded by the normal forces that it leads to.
            self.equations.press_bristles();
            let (still, steps) = self.hold(command, Start::Beside);
            iterations += steps;
            solved = still && lag < MAX_LAGS;
            if steps == 0 {
                break;
            }
        }
        (solved, iterations)
    }

    /// The same with the friction that there is.
    fn hold(&mut self, command: &Command, start: Start) -> (bool, usize) {
        let (solved, iterations) = match start {
            Start::Straight => self.harden(),
            Start::Near | Start::Before | Start::Beside => self.descend_near(start),
        };
        if !solved || !self.holds_lengths() {
            return (solved, iterations);
        }
        let (solved, steps) = self.hold_lengths(command);
        (solved, iterations + steps)
    }

    /// Whether the length of any tendon is commanded.
    fn holds_lengths(&self) -> bool {
        let tendons = self.equations.robot.tendons();
        tendons.iter().any(Tendon::holds_length)
    }

    /// The barrier of the solution (J).
    fn last_barrier(&self) -> f64 {
        f64::max(LAST_BARRIER * self.tolerance, self.scene().smoothing())
    }

    /// Solves against soft contacts, and against harder ones from there. Whether it is solved, and the number of steps.
    fn harden(&mut self) -> (bool, usize) {
        let equations = &self.equations;
        let (size, scale) = (equations.reach, equations.own_tolerance);
        let last = self.last_barrier();
        let hardest = equations.hardest();
        let softness = (SOFT * size * size / scale).max(hardest);
        let barrier = ((ROUND * size).powi(2) / softness).max(last);
        let mut iterations = 0;
        for stage in 0..STAGES {
            let along = f64::from(stage) / f64::from(STAGES);
            let hardness = Hardness {
                barrier: between(barrier, last, along),
                softness: between(softness, hardest, along),
            };
            if stage > 0 {
                iterations += usize::from(self.equations.predict(hardness));
            }
            let loose = LOOSE * self.tolerance * hardness.softness / softness;
            let (_, steps) = self.descend(hardness, loose.max(self.tolerance));
            iterations += steps;
            // Nothing near: how hard contacts are changes nothing.
            if self.equations.is_alone() {
                break;
            }
        }
        if !self.equations.is_alone() {
            iterations += usize::from(self.equations.predict(Hardness::of_barrier(last)));
        }
        let (solved, steps) = self.descend(Hardness::of_barrier(last), self.tolerance);
        self.refine(solved, iterations + steps)
    }

    /// Minimises the energy with contacts of a hardness until the residual is within a tolerance (N m). Whether that was reached, and the
    /// number of steps.
    fn descend(&mut self, hardness: Hardness, tolerance: f64) -> (bool, usize) {
        self.equations.set_hardness(hardness, tolerance);
        let robot = self.equations.robot.clone();
        let potential = Potential {
            robot: &robot,
            command: &self.command,
            dead: &self.weight,
        };
        newton(&mut Minimisation::new(&mut self.equations, &potential))
    }

    /// Corrects the rest lengths of the tendons whose length is commanded until they have it.
    fn hold_lengths(&mut self, command: &Command) -> (bool, usize) {
        let mut iterations = 0;
        for _ in 0..MAX_CORRECTIONS {
            let equations = &self.equations;
            let tolerance = equations.robot.length_tolerance();
            let lengths = &equations.iterate.posture.lengths;
            let state = |t: usize| (lengths[t], equations.expansion.tensions[t]);
            let (robot, goal) = (&equations.robot, command.as_slice());
            let rest = &mut self.command;
            let Some(errors) = length_errors(robot, goal, tolerance, rest, state) else {
                return (true, iterations);
            };
            (self.equations).correct_rest_lengths(&errors, &mut self.command);
            let (solved, steps) = self.descend(self.equations.hardness, self.tolerance);
            iterations += steps;
            if !solved {
                break;
            }
        }
        (false, iterations)
    }
}

/// Between two numbers, by their logarithms.
fn between(first: f64, last: f64, along: f64) -> f64 {
    first * (last / first).powf(along)
}
