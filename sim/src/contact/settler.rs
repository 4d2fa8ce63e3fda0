//! From command to equilibrium among obstacles.

use super::equations::{Equations, Minimisation};
use super::friction::Bristle;
use super::law::{Law, Response};
use super::near_pairs::PairNeighbourhood;
use super::{
    Activity, Contact, ContactEquilibrium, ContactError, ContactSensitivity, Partner, Sliding,
};
use crate::chain::Configuration;
use crate::energy::following::follows;
use crate::energy::{DeadForces, Potential};
use crate::geometry::Beads;
use crate::robot::{Command, Loads, Robot, Tendon};
use crate::scene::Scene;
use crate::sensitivity::SensitivityError;
use crate::solve::{MAX_CORRECTIONS, length_errors, newton};
use crate::statics::{Examined, Settler, Stability};

use nalgebra::Vector3;

/// The first barrier, and the last (J), for each N m of the tolerance of a robot's moments.
const FIRST_BARRIER: f64 = 3e5;
const LAST_BARRIER: f64 = 1e-5;
/// The first where a configuration near the equilibrium is given.
const NEAR_BARRIER: f64 = 1e1;
/// Share of the barrier that the next one is at most.
const NEXT: f64 = 0.03;
/// Residual (N m) at which a barrier (J) that is not the last counts as solved.
const LOOSE: f64 = 100.0;
/// Distance of two surfaces (m) from which on they do not count as touching, for each metre of the robot.
const TOUCHING: f64 = 3e-6;
/// How many times its surfaces' distance a contact is pressed in that is sure to bear force: derivatives then differ from those of
/// exact contact by this share at most.
const STRICT: f64 = 1e3;
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
}

impl Start {
    /// The first barrier (J), for each N m of the tolerance.
    fn barrier(self) -> f64 {
        match self {
            Self::Straight => FIRST_BARRIER,
            Self::Near | Self::Before => NEAR_BARRIER,
        }
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
    equations: Equations,
    /// Where there are no obstacles.
    free: Settler,
    weight: DeadForces,
    /// The command, with the rest lengths of tendons whose length is commanded corrected.
    command: Vec<f64>,
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
            free: Settler::new(robot),
            weight: DeadForces::new(robot),
            command: vec![0.0; robot.tendons().len()],
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
            if self.take_free() {
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
            if self.take_free() {
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
    /// Contacts with obstacles of some friction resist sliding from where they were at the last equilibrium, those that are new from
    /// where they first touch: the path is one of small steps. Where a robot settles otherwise its contacts bear no friction.
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
        if self.is_free() {
            self.free.follow(command, loads);
            if self.take_free() {
                return Ok(&self.result);
            }
            let before = self.result.equilibrium.configuration.clone();
            self.equations.iterate.set(&before);
        }
        self.solve(command, loads, Start::Before)?;
        self.equations.stick_bristles();
        Ok(&self.result)
    }

    /// Prepares to differentiate the last equilibrium, of `command` and `loads`.
    ///
    /// # Errors
    /// [`SensitivityError`] if the robot has not settled, or not stably; [`SensitivityError::Slipping`] for a contact that slips.
    pub fn sensitivity(
        &self,
        command: &Command,
        loads: &Loads,
    ) -> Result<ContactSensitivity, SensitivityError> {
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
        // There the solver without contact has solved, which has no barrier.
        let found_free = self.result.barrier == 0.0;
        if found_free {
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

    /// Takes over where the robot settled without obstacles, if it does not touch itself there: then that is where it settles.
    fn take_free(&mut self) -> bool {
        let found = self.free.equilibrium();
        if found.converged && self.equations.overlaps_itself(&found.configuration) {
            return false;
        }
        self.equations.clear();
        let out = &mut self.result;
        out.equilibrium.clone_from(found);
        out.contacts.clear();
        (out.complementarity, out.penetration, out.barrier) = (0.0, 0.0, 0.0);
        true
    }

    /// Settles `command` from wherever the iterate stands: the barrier falls from the first to the last, each solve starting from the one
    /// before (Nocedal and Wright, Numerical Optimization, ch. 19.1).
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
        let robot = &self.equations.robot;
        self.weight.set(robot, loads);
        self.command.copy_from_slice(command.as_slice());
        self.tolerance = (robot.moment_tolerance())
            .max(robot.load_rounding(loads))
            .max(self.equations.rounding());
        let last = LAST_BARRIER * self.tolerance;
        let (solved, mut iterations) =
            self.rest(command, start, [start.barrier() * self.tolerance, last]);
        // An unstable equilibrium is left as far as a larger barrier reaches.
        let mut stability = solved.then(|| self.equations.stability());
        for _ in 0..MAX_SADDLES {
            if stability != Some(Stability::Unstable) || !self.equations.leave_saddle() {
                break;
            }
            let (solved, steps) = self.rest(command, start, [NEAR_BARRIER * self.tolerance, last]);
            iterations += steps;
            stability = solved.then(|| self.equations.stability());
        }
        Ok(self.report(stability, iterations))
    }

    /// Solves under barriers (J) from the first to the last, friction and commanded lengths in it. Whether that is solved, and the
    /// number of steps.
    fn rest(&mut self, command: &Command, start: Start, barriers: [f64; 2]) -> (bool, usize) {
        let (mut solved, mut iterations) = self.hold(command, barriers);
        for lag in 0.. {
            if !solved || start != Start::Before || !self.equations.rubs() {
                break;
            }
            // Until friction is bounded by the normal forces that it leads to.
            self.equations.press_bristles();
            let (still, steps) = self.hold(command, [barriers[1]; 2]);
            iterations += steps;
            solved = still && lag < MAX_LAGS;
            if steps == 0 {
                break;
            }
        }
        (solved, iterations)
    }

    /// The same with the friction that there is.
    fn hold(&mut self, command: &Command, [first, last]: [f64; 2]) -> (bool, usize) {
        let (solved, iterations) = self.lower_barrier(first, last);
        let holds = (self.equations.robot.tendons().iter()).any(Tendon::holds_length);
        if !solved || !holds {
            return (solved, iterations);
        }
        let (solved, steps) = self.hold_lengths(command);
        (solved, iterations + steps)
    }

    /// Solves under barriers (J) from the first to the last. Whether the last is solved, and the number of steps.
    fn lower_barrier(&mut self, first: f64, last: f64) -> (bool, usize) {
        let (mut barrier, mut iterations) = (first, 0);
        while barrier > last * (1.0 + 1e-9) {
            let loose = self.tolerance.max(LOOSE * barrier);
            iterations += self.descend(barrier, loose).1;
            // Nothing near: the barrier changes nothing.
            if self.equations.is_alone() {
                break;
            }
            // The nearer to the solution, the less a step changes it (Nocedal and Wright, ch. 19.3).
            barrier *= NEXT.min(barrier / (FIRST_BARRIER * self.tolerance));
        }
        let (solved, steps) = self.descend(last, self.tolerance);
        (solved, iterations + steps)
    }

    /// Minimises the energy under a barrier (J) until the residual is within a tolerance (N m). Whether that was reached, and the
    /// number of steps.
    fn descend(&mut self, barrier: f64, tolerance: f64) -> (bool, usize) {
        (self.equations.barrier, self.equations.tolerance) = (barrier, tolerance);
        self.equations.is_found = false;
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
            let (solved, steps) = self.descend(self.equations.barrier, self.tolerance);
            iterations += steps;
            if !solved {
                break;
            }
        }
        (false, iterations)
    }

    fn report(&mut self, stability: Option<Stability>, iterations: usize) -> &ContactEquilibrium {
        // The last step of a solve that failed was taken back.
        self.equations.press();
        let equations = &self.equations;
        let out = &mut self.result.equilibrium;
        out.take_over(&equations.iterate.configuration, &equations.iterate.posture);
        (out.tendon_tensions).copy_from_slice(&equations.expansion.tensions);
        out.residual = equations.expansion.residual();
        out.iterations = iterations;
        out.stability = stability.filter(|_| out.is_finite());
        out.examined = out.stability.map(|_| Examined::Energy);
        out.converged = matches!(out.stability, Some(Stability::Stable | Stability::Neutral));
        self.result.barrier = equations.barrier;
        self.report_contacts();
        &self.result
    }

    fn report_contacts(&mut self) {
        let (equations, out) = (&self.equations, &mut self.result);
        let touching = TOUCHING * equations.robot.reach();
        out.contacts.clear();
        (out.complementarity, out.penetration) = (0.0, 0.0);
        let chain = &equations.iterate.posture.chain;
        let mut bristles: Vec<_> = equations.bristles.iter().collect();
        for near in &equations.neighbourhood.near {
            let law = equations.law(near);
            let response = law.at(near.gap);
            let centre = chain.centres[near.bead.disc] + near.arm;
            let normal = near.normal.try_normalize(0.0).unwrap_or(near.normal);
            let contact = Contact {
                disc: near.bead.disc,
                partner: Partner::Obstacle(near.obstacle),
                point: centre - normal * (near.gap + near.bead.radius),
                normal,
                gap: near.gap,
                force: near.normal * response.force,
                activity: Activity::Weak,
                sliding: Sliding::Free,
            };
            // That of the first of the faces that a bead touches.
            let own = |bristle: &&Bristle| bristle.is_of(&near.bead, near.obstacle);
            let bristle = bristles.iter().position(own);
            let contact = match bristle.map(|own| bristles.swap_remove(own)) {
                Some(bristle) => contact.rubbed(bristle, &centre),
                None => contact,
            };
            out.add(contact, &law, &response, touching);
        }
        let law = equations.own_law();
        for near in equations.near_pairs() {
            let response = law.at(near.gap);
            let [bead, other] = near.beads;
            let contact = Contact {
                disc: bead.disc,
                partner: Partner::Disc(other.disc),
                point: near.centres[1] + near.normal * other.radius,
                normal: near.normal,
                gap: near.gap,
                force: near.normal * response.force,
                activity: Activity::Weak,
                sliding: Sliding::Free,
            };
            out.add(contact, &law, &response, touching);
        }
    }
}

impl Contact {
    /// With the force of its bristle, where the bead's centre is at a position.
    fn rubbed(self, bristle: &Bristle, position: &Vector3<f64>) -> Self {
        Self {
            force: self.force + bristle.response(position).0,
            sliding: match bristle.slips(position) {
                true => Sliding::Slips,
                false => Sliding::Sticks,
            },
            ..self
        }
    }
}

impl ContactEquilibrium {
    /// Takes a contact into account, and into the list if its surfaces are within `touching` (m) of each other.
    fn add(&mut self, contact: Contact, law: &Law, response: &Response, touching: f64) {
        let pressed_in = law.compliance * response.force;
        let apart = law.barrier / response.force;
        let product = response.force * (contact.gap + pressed_in);
        self.complementarity = self.complementarity.max(product.abs());
        self.penetration = self.penetration.max(-contact.gap);
        if apart > touching {
            return;
        }
        let activity = match pressed_in > STRICT * apart {
            true => Activity::Strict,
            false => Activity::Weak,
        };
        self.contacts.push(Contact {
            activity,
            ..contact
        });
    }
}
