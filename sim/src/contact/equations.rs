//! The equations of a robot that touches obstacles: Newton's method on its potential with that of the contacts.
//!
//! A contact of gap `g(p)`, `p` the centre of a bead, pushes that point with `f n`, `n` the surface's normal. A displacement `u` of
//! the point changes that by `-(s n n' - f K) u`: `s` is the contact's stiffness, `K` the surface's curvature. So the Hessian stays
//! one block for each joint and each disc, now `6 x 6` ([`Pressing`], [`ChainLu`]), whatever the number of contacts.

use nalgebra::{Matrix3, Vector3};

use super::ContactError;
use super::law::Law;
use super::near::{Near, Neighbourhood};
use crate::energy::{DeadForces, Expansion, Potential, Pressing};
use crate::factor::{ChainLu, ChainMatrix, Curvature, Side};
use crate::geometry::Beads;
use crate::robot::Robot;
use crate::scene::Scene;
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
    /// Whether that is of the iterate.
    pub is_found: bool,
    pub lu: ChainLu,
    /// Barrier (J).
    pub barrier: f64,
    /// Gap within which contacts count (m).
    pub reach: f64,
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
        Self {
            robot: robot.clone(),
            scene: scene.clone(),
            iterate: Iterate::new(robot),
            neighbourhood: Neighbourhood::default(),
            is_found: false,
            lu: ChainLu::new(&expansion),
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
        let stiffest = obstacles
            .map(|obstacle| Law::new(1.0, obstacle.compliance, 1.0).compliance)
            .fold(f64::INFINITY, f64::min);
        ROUNDING * self.robot.reach().powi(2) / stiffest
    }

    pub fn law(&self, near: &Near) -> Law {
        let compliance = self.scene.obstacles()[near.obstacle].compliance;
        Law::new(self.barrier, compliance, self.reach)
    }

    /// Finds the contacts at the iterate.
    fn find(&mut self) {
        let chain = &self.iterate.posture.chain;
        self.neighbourhood
            .find(&self.beads, &self.scene, chain, self.reach);
        self.is_found = true;
    }

    /// Refuses an iterate in which the centre of a bead is inside an obstacle.
    pub fn check_outside(&self) -> Result<(), ContactError> {
        let chain = &self.iterate.posture.chain;
        // A bead without a radius is where it presses.
        let beads = self.beads.as_slice().iter();
        for bead in beads.filter(|bead| bead.radius > 0.0) {
            let centre = chain.positions[bead.disc] + chain.disc(bead.disc) * bead.centre;
            let mut obstacles = self.scene.obstacles().iter();
            if let Some(obstacle) = obstacles.find(|obstacle| obstacle.contains(&centre)) {
                return Err(ContactError::StartsInside {
                    disc: bead.disc,
                    obstacle: obstacle.name.clone(),
                    position: centre.into(),
                });
            }
        }
        Ok(())
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
        potential.energy(configuration, posture) + contacts.sum::<f64>()
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
        self.lu.factorise(&ChainMatrix {
            expansion: &self.expansion,
            scale: 1.0,
            centres: &self.iterate.posture.chain.centres,
            joints: &self.joints,
            bodies: &self.pressing.forms,
        })
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
            lu.solve(moments, &none, Side::Matrix, turns);
        });
    }

    /// Shortens the step such that no bead's centre passes a surface: of those in the list none comes nearer than a share of the way
    /// along the normal, which is exact for convex obstacles; others are farther away than any bead moves.
    pub fn keep_clear(&mut self) {
        let motions = disc_motions(&self.iterate);
        let mut factor: f64 = 1.0;
        for (disc, (turn, shift)) in motions.iter().enumerate() {
            let arm = self.beads.enclosing(disc) + self.robot.discs()[disc].origin.norm();
            let most = shift.norm() + turn.norm() * arm;
            let allowed = self.neighbourhood.free[disc];
            if most * factor > allowed {
                factor = allowed / most;
            }
        }
        for near in &self.neighbourhood.near {
            let (turn, shift) = motions[near.bead.disc];
            let approach = -near.normal.dot(&(shift + turn.cross(&near.arm)));
            let clearance = (near.gap + near.bead.radius).max(THIN * self.reach);
            if approach * factor > CLEARANCE * clearance {
                factor = CLEARANCE * clearance / approach;
            }
        }
        if factor < 1.0 {
            self.iterate
                .step
                .iter_mut()
                .for_each(|turn| *turn *= factor);
        }
    }
}

/// Turn (rad) of each disc and displacement (m) of the centre of its joint by the step, to first order, world axes.
fn disc_motions(iterate: &Iterate) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let centres = &iterate.posture.chain.centres;
    let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
    let mut below = centres[0];
    (iterate.step.iter().zip(centres))
        .map(|(own, centre): (&Vector3<f64>, _)| {
            shift += turn.cross(&(centre - below));
            below = *centre;
            turn += own;
            (turn, shift)
        })
        .collect()
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
        equations.lu.solve(joint, disc, Side::Matrix, step);
        step.iter_mut().for_each(|turn| *turn = -*turn);
        equations.iterate.limit_step(MAX_TURN);
        equations.keep_clear();
        equations.expansion.gradient(&mut equations.gradient);
        let turns = equations.iterate.step.iter().zip(&equations.gradient);
        let cancelling = CANCELLING * equations.robot.moment_tolerance();
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
