//! The equations of a robot that touches obstacles: Newton's method on its potential with that of the contacts.
//!
//! A contact of gap `g(p)`, `p` the centre of a bead, pushes that point with `f n`, `n` the surface's normal. A displacement `u` of
//! the point changes that by `-(s n n' - f K) u`: `s` is the contact's stiffness, `K` the surface's curvature. So the Hessian stays
//! one block for each joint and each disc, now `6 x 6` ([`Pressing`], [`ChainLu`]), whatever the number of contacts.

use nalgebra::{Matrix3, Vector3};

use super::ContactError;
use super::friction::Bristle;
use super::law::Law;
use super::near::{Near, Neighbourhood, check_outside};
use super::near_pairs::{NearPair, PairNeighbourhood};
use crate::chain::Configuration;
use crate::energy::{DeadForces, Expansion, Potential, Pressing};
use crate::factor::{ChainMatrix, Curvature, PairedLu};
use crate::geometry::Beads;
use crate::pose::motions;
use crate::robot::Robot;
use crate::scene::{Scene, SelfContact};
use crate::solve::{Iterate, System, correct_rest_lengths};

/// Largest turn of a joint in one step (rad).
const MAX_TURN: f64 = 0.5;
/// Stiffness first given to the joints where the Hessian is indefinite, for each N m of the residual (1/rad).
const STIFFENING: f64 = 0.1;
/// Attempts at making the Hessian positive definite, each four times as stiff as the one before.
const MAX_STIFFENINGS: usize = 25;
/// Share of the decrease by the linear model that a step must bring (Armijo's condition).
const ENOUGH: f64 = 1e-4;
/// Share of the energy that is rounding.
const ENERGY_ROUNDING: f64 = 1e-13;
/// Energy (J) that terms of both signs may have before they cancel, for each N m of the tolerance.
const CANCELLING: f64 = 1e7;
/// Share of the way to a surface that a bead's centre may go in one step.
const CLEARANCE: f64 = 0.7;

/// Gap within which a contact counts, as a share of the radius of the largest disc's beads.
pub(super) const REACH: f64 = 0.5;
/// The same of the robot's contacts with itself.
const OWN_REACH: f64 = 0.1;
/// Clearance that a step may always use, as a share of the reach: of beads without a radius, and of those that start inside.
const THIN: f64 = 1e-3;

/// Share of a position that is rounding.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// State and workspace of Newton's method with contacts.
#[derive(Clone, Debug)]
pub(super) struct Equations {
    pub robot: Robot,
    pub scene: Scene,
    pub beads: Beads,
    pub iterate: Iterate,
    pub expansion: Expansion,
    pub neighbourhood: Neighbourhood,
    /// The robot's contacts with itself, where there can be any.
    pub pairs: Option<PairNeighbourhood>,
    /// Contacts with obstacles that resist sliding.
    pub bristles: Vec<Bristle>,
    /// Whether those are of the iterate.
    pub is_found: bool,
    pub lu: PairedLu,
    /// Barrier (J).
    pub barrier: f64,
    /// Gap within which contacts count (m): with obstacles, and with itself.
    pub reach: f64,
    pub own_reach: f64,
    /// Largest residual (N m) that counts as solved.
    pub tolerance: f64,
    pub pressing: Pressing,
    joints: Vec<Matrix3<f64>>,
    gradient: Vec<Vector3<f64>>,
    dead: DeadForces,
}

impl Equations {
    pub fn new(robot: &Robot, scene: &Scene, beads: Beads) -> Self {
        let expansion = Expansion::new(robot);
        let n = robot.discs().len();
        let widest = (0..n).map(|disc| beads.enclosing(disc)).fold(0.0, f64::max);
        let own_reach = OWN_REACH * widest;
        let pairs = match scene.self_contact() {
            SelfContact::Ignored => None,
            SelfContact::Touching { .. } => Some(PairNeighbourhood::new(robot, &beads, own_reach)),
        };
        Self {
            robot: robot.clone(),
            scene: scene.clone(),
            pairs,
            bristles: Vec::new(),
            own_reach,
            iterate: Iterate::new(robot),
            neighbourhood: Neighbourhood::default(),
            is_found: false,
            lu: PairedLu::new(&expansion),
            barrier: 0.0,
            reach: REACH * widest,
            tolerance: robot.moment_tolerance(),
            pressing: Pressing::none(n),
            joints: vec![Matrix3::zeros(); n],
            gradient: vec![Vector3::zeros(); n],
            dead: DeadForces::new(robot),
            beads,
            expansion,
        }
    }

    /// What rounding of the positions leaves of the moments of contacts (N m).
    pub fn rounding(&self) -> f64 {
        let obstacles = self.scene.obstacles().iter();
        let compliances = obstacles.map(|obstacle| obstacle.compliance);
        let stiffest = compliances
            .chain(self.own_compliance())
            .map(|compliance| Law::new(1.0, compliance, 1.0).compliance)
            .fold(f64::INFINITY, f64::min);
        ROUNDING * self.robot.reach().powi(2) / stiffest
    }

    pub fn law(&self, near: &Near) -> Law {
        let compliance = self.scene.obstacles()[near.obstacle].compliance;
        Law::new(self.barrier, compliance, self.reach)
    }

    fn own_compliance(&self) -> Option<f64> {
        match self.scene.self_contact() {
            SelfContact::Ignored => None,
            SelfContact::Touching { compliance } => Some(compliance),
        }
    }

    /// The law of the robot's contacts with itself.
    pub fn own_law(&self) -> Law {
        let compliance = self.own_compliance().unwrap_or_default();
        Law::new(self.barrier, compliance, self.own_reach)
    }

    /// The robot's contacts with itself.
    pub fn near_pairs(&self) -> &[NearPair] {
        self.pairs.as_ref().map_or(&[], |pairs| &pairs.near)
    }

    /// Whether nothing is near.
    pub fn is_alone(&self) -> bool {
        self.neighbourhood.near.is_empty() && self.near_pairs().is_empty()
    }

    /// Whether the robot overlaps itself in a configuration.
    pub fn overlaps_itself(&mut self, configuration: &Configuration) -> bool {
        let Some(pairs) = &mut self.pairs else {
            return false;
        };
        self.iterate.set(configuration);
        pairs.overlaps(&self.beads, &self.iterate.posture.chain)
    }

    /// Whether there is friction.
    pub fn rubs(&self) -> bool {
        self.scene
            .obstacles()
            .iter()
            .any(|obstacle| obstacle.friction > 0.0)
    }

    /// Takes over what the contacts press at the iterate: bristles bear as much as that lets them, and beads that have come to touch get
    /// one where they are.
    pub fn press_bristles(&mut self) {
        let chain = &self.iterate.posture.chain;
        let mut pressed: Vec<(Bristle, Vector3<f64>)> = Vec::new();
        for near in &self.neighbourhood.near {
            let obstacle = &self.scene.obstacles()[near.obstacle];
            if obstacle.friction == 0.0 {
                continue;
            }
            let force = near.normal * self.law(near).at(near.gap).force;
            let of_near = |other: &Bristle| other.is_of(&near.bead, near.obstacle);
            // A bead in a corner of a mesh touches several faces.
            if let Some((_, sum)) = pressed.iter_mut().find(|(bristle, _)| of_near(bristle)) {
                *sum += force;
                continue;
            }
            let known = self
                .bristles
                .iter()
                .find(|bristle| of_near(bristle))
                .copied();
            let position = chain.centres[near.bead.disc] + near.arm;
            let new = || Bristle::new(near.bead, near.obstacle, obstacle.compliance, &position);
            pressed.push((known.unwrap_or_else(new), force));
        }
        self.bristles.clear();
        for (mut bristle, force) in pressed {
            let Some(normal) = force.try_normalize(0.0) else {
                continue;
            };
            let friction = self.scene.obstacles()[bristle.obstacle].friction;
            bristle.press(normal, friction * force.norm());
            self.bristles.push(bristle);
        }
    }

    /// Lets what slipped stick where it is.
    pub fn stick_bristles(&mut self) {
        let chain = &self.iterate.posture.chain;
        for bristle in &mut self.bristles {
            let position = bristle.position(chain);
            bristle.stick(&position);
        }
    }

    /// Forgets all contacts.
    pub fn clear(&mut self) {
        self.pressing.clear();
        self.neighbourhood.near.clear();
        self.bristles.clear();
        if let Some(pairs) = &mut self.pairs {
            pairs.near.clear();
        }
    }

    /// Finds the contacts at the iterate.
    fn find(&mut self) {
        let chain = &self.iterate.posture.chain;
        self.neighbourhood
            .find(&self.beads, &self.scene, chain, self.reach);
        if let Some(pairs) = &mut self.pairs {
            pairs.find(&self.beads, chain, self.own_reach);
        }
        self.is_found = true;
    }

    /// Refuses an iterate in which the centre of a bead is inside an obstacle.
    pub fn check_outside(&self) -> Result<(), ContactError> {
        let chain = &self.iterate.posture.chain;
        check_outside(&self.beads, &self.scene, |bead| {
            chain.positions[bead.disc] + chain.disc(bead.disc) * bead.centre
        })
    }

    /// Energy (J) at the iterate, where the contacts have been found.
    fn energy(&self, potential: &Potential) -> f64 {
        let Iterate {
            configuration,
            posture,
            ..
        } = &self.iterate;
        let near = self.neighbourhood.near.iter();
        let contacts = near.map(|near| self.law(near).energy(near.gap));
        let own = self.own_law();
        let pairs = self.near_pairs().iter().map(|pair| own.energy(pair.gap));
        let sliding = self.bristles.iter();
        let sliding = sliding.map(|bristle| bristle.energy(&bristle.position(&posture.chain)));
        let touching = contacts.chain(pairs).chain(sliding);
        potential.energy(configuration, posture) + touching.sum::<f64>()
    }

    /// The contacts at the iterate, and their forces.
    pub fn press(&mut self) {
        if !self.is_found {
            self.find();
        }
        self.pressing.clear();
        for near in &self.neighbourhood.near {
            let response = self.law(near).at(near.gap);
            self.pressing.push(
                &self.iterate.posture,
                (near.bead.disc, near.bead.centre),
                near.normal * response.force,
                &near.stiffness(&response),
            );
        }
        for bristle in &self.bristles {
            let posture = &self.iterate.posture;
            let (force, stiffness) = bristle.response(&bristle.position(&posture.chain));
            let point = (bristle.bead.disc, bristle.bead.centre);
            self.pressing.push(posture, point, force, &stiffness);
        }
        let own = self.own_law();
        for pair in self.pairs.iter().flat_map(|pairs| &pairs.near) {
            let response = own.at(pair.gap);
            self.pressing
                .push_pair(pair.pressed(&response), response.force);
        }
    }

    /// Gradient and Hessian at the iterate, under `potential` and the contacts that are found there.
    pub fn expand(&mut self, potential: &Potential) {
        self.press();
        self.dead.clone_from(potential.dead);
        self.pressing.add_to(&mut self.dead);
        let pressed = Potential {
            dead: &self.dead,
            ..*potential
        };
        let Iterate {
            configuration,
            posture,
            ..
        } = &self.iterate;
        pressed.expand(configuration, posture, &mut self.expansion);
    }

    /// Factorises the Hessian with `stiffness` (N m/rad) added to every joint.
    pub fn factorise(&mut self, stiffness: f64) -> Option<Curvature> {
        self.joints.fill(Matrix3::identity() * stiffness);
        let matrix = ChainMatrix {
            expansion: &self.expansion,
            scale: 1.0,
            centres: &self.iterate.posture.chain.centres,
            joints: &self.joints,
            bodies: &self.pressing.forms,
        };
        self.lu.factorise(&matrix, &self.pressing.pairs)
    }

    /// Factorises the Hessian, where it is not positive definite with the joints stiffened alike until it is.
    fn factorise_positive(&mut self) {
        if self.factorise(0.0) == Some(Curvature::Positive) {
            return;
        }
        let mut stiffness = STIFFENING * self.expansion.residual().max(self.tolerance);
        for _ in 0..MAX_STIFFENINGS {
            if self.factorise(stiffness) == Some(Curvature::Positive) {
                break;
            }
            stiffness *= 4.0;
        }
    }

    /// Moves the rest lengths of tendons that are longer than they should be by `errors` (tendon, m): see [`correct_rest_lengths`].
    pub fn correct_rest_lengths(&mut self, errors: &[(usize, f64)], rest: &mut [f64]) {
        self.factorise(0.0);
        let (lu, none) = (&self.lu, vec![Vector3::zeros(); self.joints.len()]);
        correct_rest_lengths(&self.expansion, errors, rest, |moments, turns| {
            lu.solve(moments, &none, turns);
        });
    }

    /// Shortens the step such that no bead's centre passes a surface: of those in the list none comes nearer than a share of the way
    /// along the normal, which is exact for convex obstacles; others are farther away than any bead moves.
    pub fn keep_clear(&mut self) {
        let motions = motions(&self.iterate.posture.chain.centres, &self.iterate.step);
        let mut factor: f64 = 1.0;
        let mut limit = |most: f64, allowed: f64| {
            if most * factor > allowed {
                factor = allowed / most;
            }
        };
        let mut farthest = vec![0.0; motions.len()];
        for (disc, (turn, shift)) in motions.iter().enumerate() {
            let arm = self.beads.enclosing(disc) + self.robot.discs()[disc].origin.norm();
            farthest[disc] = shift.norm() + turn.norm() * arm;
            limit(farthest[disc], self.neighbourhood.free[disc]);
        }
        for near in &self.neighbourhood.near {
            let (turn, shift) = motions[near.bead.disc];
            let approach = -near.normal.dot(&(shift + turn.cross(&near.arm)));
            let clearance = (near.gap + near.bead.radius).max(THIN * self.reach);
            limit(approach, CLEARANCE * clearance);
        }
        for apart in self.pairs.iter().flat_map(|pairs| &pairs.apart) {
            let [below, above] = apart.discs;
            if farthest[below] + farthest[above] > apart.distance {
                limit(self.most_apart(&motions, apart.discs), apart.distance);
            }
        }
        for near in self.near_pairs() {
            let [first, second] = [0, 1].map(|i| {
                let disc = near.beads[i].disc;
                let (turn, shift) = motions[disc];
                shift + turn.cross(&(near.centres[i] - self.iterate.posture.chain.centres[disc]))
            });
            let approach = near.normal.dot(&(second - first));
            let within = 0.5 * (near.beads[0].radius + near.beads[1].radius);
            let clearance = (near.gap + within).max(THIN * self.own_reach);
            limit(approach, CLEARANCE * clearance);
        }
        if factor < 1.0 {
            self.iterate
                .step
                .iter_mut()
                .for_each(|turn| *turn *= factor);
        }
    }

    /// The most that a point of one disc is displaced from the other disc (m).
    fn most_apart(
        &self,
        motions: &[(Vector3<f64>, Vector3<f64>)],
        [below, above]: [usize; 2],
    ) -> f64 {
        let centres = &self.iterate.posture.chain.centres;
        let [(turn, shift), (other_turn, other_shift)] = [motions[below], motions[above]];
        let carried = shift + turn.cross(&(centres[above] - centres[below]));
        let arm = self.beads.enclosing(above) + self.robot.discs()[above].origin.norm();
        (other_shift - carried).norm() + (other_turn - turn).norm() * arm
    }
}

/// A minimisation under one potential and barrier.
pub(super) struct Minimisation<'a> {
    equations: &'a mut Equations,
    potential: &'a Potential<'a>,
    /// Energy (J) at the start of the step, where it is known.
    energy: Option<f64>,
}

/// The energy to first order along a step.
pub(super) struct Slope {
    /// Derivative of the energy (J) by the share of the step.
    slope: f64,
    /// Differences of the energy (J) below this are rounding.
    rounding: f64,
}

impl<'a> Minimisation<'a> {
    pub fn new(equations: &'a mut Equations, potential: &'a Potential<'a>) -> Self {
        Self {
            equations,
            potential,
            energy: None,
        }
    }
}

impl System for Minimisation<'_> {
    type Model = Slope;
    const MAX_STEPS: usize = 200;
    const MAX_TRIALS: usize = 30;

    fn iterate(&mut self) -> &mut Iterate {
        &mut self.equations.iterate
    }

    fn is_solved(&mut self) -> bool {
        self.equations.expand(self.potential);
        self.equations.expansion.residual() <= self.equations.tolerance
    }

    fn newton_step(&mut self) -> Slope {
        let equations = &mut *self.equations;
        let energy = *self
            .energy
            .get_or_insert_with(|| equations.energy(self.potential));
        equations.is_found = false;
        equations.factorise_positive();
        let expansion = &equations.expansion;
        let step = &mut equations.iterate.step;
        let (joint, disc) = (&expansion.joint_gradient, &expansion.disc_gradient);
        equations.lu.solve(joint, disc, step);
        step.iter_mut().for_each(|turn| *turn = -*turn);
        equations.iterate.limit_step(MAX_TURN);
        equations.keep_clear();
        equations.expansion.gradient(&mut equations.gradient);
        let turns = equations.iterate.step.iter().zip(&equations.gradient);
        let cancelling = CANCELLING * equations.tolerance.max(equations.robot.moment_tolerance());
        Slope {
            slope: turns.map(|(step, gradient)| step.dot(gradient)).sum(),
            rounding: ENERGY_ROUNDING * energy.abs().max(cancelling),
        }
    }

    fn accepts(&mut self, model: &Slope, share: f64) -> bool {
        self.equations.find();
        let energy = self.equations.energy(self.potential);
        let before = self.energy.unwrap_or(energy);
        let accepted = energy <= before + ENOUGH * share * model.slope.min(0.0) + model.rounding;
        match accepted {
            true => self.energy = Some(energy),
            false => self.equations.is_found = false,
        }
        accepted
    }
}
