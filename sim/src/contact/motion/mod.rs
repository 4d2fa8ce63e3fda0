//! Robots that touch obstacles, in motion.
//!
//! A step is one of a [`Stepper`] of first order with the contacts' impulses in it, which depend on the velocities at its end: a convex
//! problem that Newton's method solves in O(n) an iteration, whatever the number of contacts (`problem`). Gaps are those at the begin of
//! the step and change with the velocities to first order.

mod bounds;
mod coupled;
mod derivatives;
mod gather;
mod law;
mod objects;
mod problem;
mod reaches;
mod response;
mod start;
mod tendons;
mod ties;
mod touch;

use nalgebra::Vector3;

use self::objects::Objects;
use self::problem::{Problem, SAME_BOUND, Solved};
use self::reaches::Reaches;
use self::response::{StepResponse, mobilities_of};
use self::tendons::HeldTendon;
use self::touch::{DiscVelocities, Opposite, Side, Touch};
use super::equations::{OWN_REACH, REACH};
use super::law::STIFFEST;
use super::near::Neighbourhood;
use super::near_pairs::PairNeighbourhood;
use super::{Activity, Contact};
use crate::chain::Configuration;
use crate::dynamics::{
    DynamicsError, Energy, LARGEST_TURN, MAX_REVISIONS, Resistance, Rollout, State, Stepper,
};
use crate::geometry::Beads;
use crate::robot::{Command, Loads, Robot};
use crate::scene::{ContactLaw, Scene, SelfContact};

/// Gap within which contacts count in any step, as a share of that at rest.
const LEAST: f64 = 0.02;
/// How often a step is solved again with contacts farther away among its own, where it moved a disc so far.
const MAX_REACHES: usize = 6;
/// By how much bounds of friction may be off, for the largest of them, in a step that is taken, where a coefficient is larger than
/// those of surfaces: friction of others leaves the cone by little.
const MOST_OFF: f64 = 0.01;
const LARGE: f64 = 10.0;

/// Moves states of one robot among the obstacles of one scene. Those with a mass move along: they are the stepper's [`objects`].
/// The others stay where they are. Discs of the robot touch each other, too, but neighbours, as the scene's
/// [`SelfContact`] says. In a scene without either this is the [`Stepper`] that it is made of, to the last bit.
///
/// [`objects`]: Self::objects
///
/// ```
/// use tdcr_sim::contact::ContactStepper;
/// use tdcr_sim::dynamics::{Integrator, State, Stepper};
/// use tdcr_sim::robot::{Loads, Robot};
/// use tdcr_sim::scene::{Obstacle, Scene};
///
/// let robot = Robot::load("2m")?;
/// let post = Obstacle::cylinder("post", 0.01, 0.4)?.at([-0.06, 0.0, 0.25]);
/// let scene = Scene::new(vec![post])?;
/// let stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler)?;
/// let mut stepper = ContactStepper::new(stepper, &scene)?;
/// let mut state = State::straight(&robot);
/// let command = robot.command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])?;
/// for _ in 0..1_000 {
///     stepper.step(&mut state, &command, &Loads::default())?;
/// }
/// let force: f64 = stepper.contacts().iter().map(|contact| contact.force.norm()).sum();
/// assert!(force > 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ContactStepper {
    stepper: Stepper,
    scene: Scene,
    beads: Beads,
    /// Gap within which contacts count at rest (m).
    reach: f64,
    /// Of each disc, inverse inertance of its centre of mass in the straight pose (1/kg).
    mobilities: Vec<f64>,
    objects: Objects,
    reaches: Reaches,
    neighbourhood: Neighbourhood,
    /// How the robot touches itself.
    own: Option<OwnContacts>,
    problem: Problem,
    /// Centres of the joints at the begin of the step (m).
    centres: Vec<Vector3<f64>>,
    /// The joints' rates at the end of the step without contacts, and what contacts change of them (rad/s, world axes).
    free: Vec<Vector3<f64>>,
    change: Vec<Vector3<f64>>,
    /// Those at the begin, then at the end.
    rates: Vec<Vector3<f64>>,
    /// Motions of the discs at the begin, and at the end as far as it is known.
    starts: DiscVelocities,
    motions: DiscVelocities,
    contacts: Vec<Contact>,
    unsolved: usize,
}

/// What discs of the robot are near each other, and how they give way.
#[derive(Clone, Debug)]
struct OwnContacts {
    pairs: PairNeighbourhood,
    /// Compliance (m/N), and coefficient of friction.
    compliance: f64,
    friction: f64,
}

impl OwnContacts {
    /// Of a robot that touches itself in a scene, under a law that knows of that.
    fn new(robot: &Robot, scene: &Scene, beads: &Beads) -> Option<Self> {
        let (
            SelfContact::Touching {
                compliance,
                friction,
            },
            ContactLaw::Compliant { .. },
        ) = (scene.self_contact(), scene.contact_law())
        else {
            return None;
        };
        let discs = 0..robot.discs().len();
        let widest = discs.map(|disc| beads.enclosing(disc)).fold(0.0, f64::max);
        let pairs = PairNeighbourhood::new(robot, beads, OWN_REACH * widest);
        Some(Self {
            pairs,
            compliance,
            friction,
        })
    }
}

impl ContactStepper {
    /// Steps of `stepper` among the obstacles of `scene`, with contacts that push by its [`contact_law`](Scene::contact_law), and
    /// the collision geometry [`Beads::new`].
    ///
    /// # Errors
    /// [`DynamicsError::NotAmongObstacles`] for an integrator that is not of first order, where there are obstacles;
    /// [`DynamicsError::InFluid`] for a fluid and [`ContactLaw::Impedance`], [`DynamicsError::TendonFriction`] for friction of tendons
    /// and that law, [`DynamicsError::Inextensible`] for commanded lengths of tendons without a stretch and that law;
    /// [`DynamicsError::Objects`] for objects that cannot move.
    pub fn new(stepper: Stepper, scene: &Scene) -> Result<Self, DynamicsError> {
        let beads = Beads::new(stepper.robot());
        Self::with_beads(stepper, scene, beads)
    }

    /// The same with other collision geometry of the robot.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_beads(
        mut stepper: Stepper,
        scene: &Scene,
        beads: Beads,
    ) -> Result<Self, DynamicsError> {
        let n = stepper.robot().discs().len();
        let mut mobilities = Vec::new();
        let own = OwnContacts::new(stepper.robot(), scene, &beads);
        if !scene.obstacles().is_empty() || own.is_some() {
            stepper.check_reacting()?;
            if let ContactLaw::Impedance(_) = scene.contact_law() {
                if let Some(tendon) = stepper.first_held() {
                    return Err(DynamicsError::Inextensible { tendon });
                }
                if stepper.robot().spec().fluid.is_some() {
                    return Err(DynamicsError::InFluid);
                }
                if let Some(tendon) = stepper.first_rubbing() {
                    return Err(DynamicsError::TendonFriction { tendon });
                }
                mobilities = mobilities_of(&mut stepper)?;
            }
        }
        let gravity = stepper.robot().gravity();
        let objects = Objects::new(scene, gravity, stepper.timestep())?;
        let zeros = vec![Vector3::zeros(); n];
        let reach = REACH * (0..n).map(|disc| beads.enclosing(disc)).fold(0.0, f64::max);
        Ok(Self {
            reach,
            reaches: Reaches::new(stepper.robot(), &beads, LEAST * reach),
            stepper,
            scene: scene.clone(),
            beads,
            mobilities,
            objects,
            neighbourhood: Neighbourhood::default(),
            own,
            problem: Problem::default(),
            centres: Vec::with_capacity(n),
            free: zeros.clone(),
            change: zeros.clone(),
            rates: zeros,
            starts: DiscVelocities::default(),
            motions: DiscVelocities::default(),
            contacts: Vec::new(),
            unsolved: 0,
        })
    }

    /// The stepper without obstacles.
    pub fn stepper(&self) -> &Stepper {
        &self.stepper
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        self.stepper.robot()
    }

    /// The scene as it stands: objects are where they are now.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The robot's collision geometry.
    pub fn beads(&self) -> &Beads {
        &self.beads
    }

    /// What the robot touched in the last step, by obstacles and discs: the mean forces over the step, at the points where they acted at
    /// its begin, and the gaps at its end to first order. Empty before the first.
    pub fn contacts(&self) -> &[Contact] {
        &self.contacts
    }

    /// Number of steps, since this stepper was made, whose contact forces were not found to full precision: with friction, of which the
    /// bounds do not follow from the normal forces to 1e-6 of the largest.
    pub fn unsolved(&self) -> usize {
        self.unsolved
    }

    /// Moves `state` by one time step under `command` and `loads`, both constant meanwhile.
    ///
    /// # Errors
    /// As [`Stepper::step`]; [`DynamicsError::FrictionNotFound`], which leaves the state as it was.
    pub fn step(
        &mut self,
        state: &mut State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        self.forget();
        if self.scene.obstacles().is_empty() && self.own.is_none() {
            return self.stepper.step(state, command, loads);
        }
        self.stepper.begin(state, command, loads)?;
        let unsolved = self.unsolved;
        let mut left = MAX_REVISIONS;
        self.find(state, command, loads)?;
        // What touches the robot changes what its tendons do in their holes.
        while left > 0 && self.stepper.rub_again(state, loads, &self.change) {
            left -= 1;
            self.find(state, command, loads)?;
        }
        // It changes the tensions that hold lengths, too, which give the joints stiffness in implicit steps.
        let touches = self.problem.touches.iter().any(Touch::acts);
        if touches && self.stepper.hold_again(state, command, loads)? {
            self.find(state, command, loads)?;
        }
        if left == 0 || self.unsolved > unsolved {
            self.unsolved = unsolved + 1;
        }
        (self.objects).take(&self.problem.movables, &self.problem.touches);
        self.stepper.finish(state, command, &self.change)?;
        if !self.objects.are_none() {
            self.objects.step()?;
            self.follow_objects();
        }
        Ok(())
    }

    /// Loads the contacts of the tendons in their holes: [`Stepper::set_deflections`].
    ///
    /// # Errors
    /// As [`Stepper::set_deflections`].
    pub fn set_deflections(
        &mut self,
        configuration: &Configuration,
        command: &Command,
        deflections: &[Vec<f64>],
    ) -> Result<(), DynamicsError> {
        (self.stepper).set_deflections(configuration, command, deflections)
    }

    /// The states after each step of `rollout`, at the start of which the servos have come to the first command.
    ///
    /// # Errors
    /// [`DynamicsError`] of the first step that fails.
    pub fn rollout(&mut self, rollout: &Rollout) -> Result<Vec<State>, DynamicsError> {
        let timestep = self.stepper.timestep();
        if let Some(first) = rollout.commands.first() {
            self.set_deflections(&rollout.start.configuration, first, &[])?;
        }
        rollout.states(
            &self.stepper.robot().clone(),
            timestep,
            |state, command, loads| self.step(state, command, loads),
        )
    }

    /// Energy of `state` under `command` and `loads`, with that of pressed surfaces of [`ContactLaw::Compliant`] in the potential.
    ///
    /// # Errors
    /// As [`Stepper::energy`].
    pub fn energy(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<Energy, DynamicsError> {
        let mut energy = self.stepper.energy(state, command, loads)?;
        if let ContactLaw::Compliant { .. } = self.scene.contact_law() {
            let chain = &self.stepper.posture().chain;
            let (beads, scene) = (&self.beads, &self.scene);
            self.neighbourhood
                .find(beads, scene, chain, |_, _| self.reach);
            for near in &self.neighbourhood.near {
                let compliance = self.scene.obstacles()[near.obstacle].compliance;
                energy.potential += 0.5 * near.gap.min(0.0).powi(2) / compliance.max(STIFFEST);
            }
            if let Some(own) = &mut self.own {
                own.pairs.find(beads, chain, |_, _| 0.0);
                for near in &own.pairs.near {
                    energy.potential += 0.5 * near.gap.powi(2) / own.compliance.max(STIFFEST);
                }
            }
        }
        Ok(energy)
    }

    /// Nothing is touched.
    fn forget(&mut self) {
        self.contacts.clear();
        self.problem.touches.clear();
        self.problem.movables.all.clear();
    }

    /// Finds the contacts of the step that was begun from `state`, and what they change the rates by.
    fn find(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        self.forget();
        let (resistance, free, rates) = (self.resistance(), &mut self.free, &mut self.rates);
        (self.stepper).free_rates((state, command), resistance, free, rates);
        self.change.fill(Vector3::zeros());
        self.problem.tendons.clear();
        (self.problem.tendons).extend(HeldTendon::all(&self.stepper));
        // A step that turns a joint too far is refused, whatever is touched in it.
        if self.is_resolved(&self.free) {
            self.touch(loads)?;
            self.report();
        }
        Ok(())
    }

    /// What the velocities are found with. MuJoCo finds the forces with the inertias alone, and then takes the step with them.
    fn resistance(&self) -> Resistance {
        match self.scene.contact_law() {
            ContactLaw::Compliant { .. } => Resistance::Step,
            ContactLaw::Impedance(_) => Resistance::Inertia,
        }
    }

    /// Finds the contacts of the step that was begun, and what they change the rates by.
    fn touch(&mut self, loads: &Loads) -> Result<(), DynamicsError> {
        // A damper pushes a bead that would touch within its relaxation time.
        let window = self.stepper.timestep() + self.scene.contact_law().relaxation();
        self.centres.clear();
        let chain = &self.stepper.posture().chain;
        self.centres.extend_from_slice(&chain.centres);
        self.starts.set(&self.centres, &self.rates);
        self.motions.set(&self.centres, &self.free);
        let mut solved = Solved::NOTHING;
        for _ in 0..MAX_REACHES {
            // What no disc reaches in the step does nothing in it.
            let (reaches, motions, centres) = (&mut self.reaches, &self.motions, &self.centres);
            reaches.set(window, motions, &self.objects, &self.problem.movables);
            let chain = &self.stepper.posture().chain;
            let (beads, scene) = (&self.beads, &self.scene);
            (self.neighbourhood).find(beads, scene, chain, |obstacle, disc| {
                reaches.of_obstacle(obstacle, disc)
            });
            if let Some(own) = &mut self.own {
                let reach = |discs, distance| reaches.of_discs(discs, distance, motions, centres);
                own.pairs.find(beads, chain, reach);
            }
            self.motions.set(&self.centres, &self.free);
            self.set_touches();
            if self.problem.touches.is_empty() {
                self.change.fill(Vector3::zeros());
                return Ok(());
            }
            solved = self.solve(loads);
            // Contacts may move a disc farther than it would have moved, to where others are.
            let rates = self.rates.iter_mut().zip(&self.free).zip(&self.change);
            rates.for_each(|((rate, free), change)| *rate = free + change);
            self.motions.set(&self.centres, &self.rates);
            let objects = (&self.objects, &self.problem.movables);
            let own = self.own.as_ref().map(|own| &own.pairs);
            let found = (&self.neighbourhood, own);
            if (self.reaches).cover(&self.motions, &self.centres, objects, found)
                || !self.is_resolved(&self.rates)
            {
                break;
            }
        }
        self.check(solved)
    }

    /// Counts a step that is not solved to full precision, and refuses one whose friction, of a large coefficient, is another than its
    /// contacts bear.
    fn check(&mut self, solved: Solved) -> Result<(), DynamicsError> {
        let Solved { found, off } = solved;
        self.unsolved += usize::from(!found || off > SAME_BOUND);
        let is_large = (self.problem.touches.iter()).any(|touch| touch.friction > LARGE);
        match off > MOST_OFF && is_large {
            false => Ok(()),
            true => Err(DynamicsError::FrictionNotFound {
                off,
                timestep: self.stepper.timestep(),
            }),
        }
    }

    /// Whether a step resolves a motion of these rates.
    fn is_resolved(&self, rates: &[Vector3<f64>]) -> bool {
        let h = self.stepper.timestep();
        rates.iter().all(|rate| rate.norm() * h <= LARGEST_TURN)
    }

    /// Solves the problem, and takes the change of the rates.
    fn solve(&mut self, loads: &Loads) -> Solved {
        let resistance = self.resistance();
        let mut robot = StepResponse {
            stepper: &mut self.stepper,
            loads,
            resistance,
        };
        let solved = self.problem.solve(&self.centres, &mut robot);
        let stepper = robot.stepper;
        let h = stepper.timestep();
        stepper.set_held_tensions(self.problem.tendons.iter().map(|tendon| tendon.whole() / h));
        match resistance {
            Resistance::Step => self.change.copy_from_slice(&self.problem.change),
            Resistance::Inertia => {
                let impulses = self.problem.impulses();
                stepper.respond::<false>(loads, Resistance::Step, impulses, &mut self.change);
            }
        }
        solved
    }

    fn report(&mut self) {
        let (h, chain) = (self.stepper.timestep(), &self.stepper.posture().chain);
        let touches = self.problem.touches.iter().filter(|touch| touch.acts());
        for touch in touches {
            let Side::Disc(disc) = touch.on else { continue };
            let mut velocity = self.motions.of(disc, &touch.arm);
            if let Some(Opposite { object, arm }) = &touch.against {
                velocity -= self.problem.movables.all[*object].velocity(arm);
            }
            if let Some((other, arm)) = &touch.other {
                velocity -= self.motions.of(*other, arm);
            }
            self.contacts.push(Contact {
                disc,
                partner: touch.partner,
                point: chain.centres[disc] + touch.arm,
                normal: touch.normal,
                gap: touch.gap + h * touch.gradient.dot(&velocity),
                force: touch.impulse / h,
                activity: Activity::Strict,
                sliding: touch.sliding(),
            });
        }
    }
}
