//! The equations of a robot that touches obstacles: Newton's method on its potential with that of the contacts.
//!
//! A contact of gap `g(p)`, `p` the centre of a bead, pushes that point with `f n`, `n` the surface's normal. A displacement `u` of
//! the point changes that by `-(s n n' - f K) u`: `s` is the contact's stiffness, `K` the surface's curvature. So the Hessian stays
//! one block for each joint and each disc, now `6 x 6` ([`Pressing`], [`ChainLu`]), whatever the number of contacts.

use nalgebra::{Matrix3, Vector3};

use super::ContactError;
use super::friction::Bristle;
use super::law::{Hardness, Law};
use super::near::{Near, Neighbourhood, check_outside};
use super::near_pairs::{NearPair, PairNeighbourhood};
use super::surfaces::Surfaces;
use crate::chain::Configuration;
use crate::energy::{DeadForces, Expansion, Potential, Pressing};
use crate::factor::{ChainMatrix, Curvature, PairedLu, project};
use crate::geometry::Beads;
use crate::robot::Robot;
use crate::scene::{Scene, SelfContact};
use crate::solve::{Iterate, correct_rest_lengths};

/// Largest turn of a joint in one step (rad).
pub(super) const MAX_TURN: f64 = 0.5;
/// Stiffness first given to the joints where the Hessian is indefinite, for each N m of the residual (1/rad).
const STIFFENING: f64 = 0.1;
/// Attempts at making the Hessian positive definite, each four times as stiff as the one before.
const MAX_STIFFENINGS: usize = 25;

/// Gap within which a contact counts, as a share of the radius of the largest disc's beads.
pub(super) const REACH: f64 = 0.5;
/// The same of the robot's contacts with itself.
pub(super) const OWN_REACH: f64 = 0.1;

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
    /// Contacts that resist sliding.
    pub bristles: Vec<Bristle>,
    /// Whether those are of the iterate.
    pub is_found: bool,
    pub lu: PairedLu,
    /// How hard contacts are.
    pub hardness: Hardness,
    /// Gap within which contacts count (m): with obstacles, and with itself.
    pub reach: f64,
    pub own_reach: f64,
    /// [`Robot::moment_tolerance`] (N m).
    pub own_tolerance: f64,
    /// Largest residual (N m) that counts as solved.
    pub tolerance: f64,
    pub pressing: Pressing,
    pub joints: Vec<Matrix3<f64>>,
    pub gradient: Vec<Vector3<f64>>,
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
            hardness: Hardness::default(),
            reach: REACH * widest,
            tolerance: robot.moment_tolerance(),
            own_tolerance: robot.moment_tolerance(),
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
        ROUNDING * self.robot.reach().powi(2) / self.hardest()
    }

    /// The least compliance of the robot's contacts (m/N).
    pub fn hardest(&self) -> f64 {
        let obstacles = self.scene.obstacles().iter();
        let compliances = obstacles.map(|obstacle| obstacle.compliance);
        compliances
            .chain(self.own_compliance())
            .map(|compliance| Law::new(1.0, compliance, 1.0).compliance)
            .fold(f64::INFINITY, f64::min)
    }

    pub fn law(&self, near: &Near) -> Law {
        self.law_of(near, self.hardness)
    }

    pub fn law_of(&self, near: &Near, hardness: Hardness) -> Law {
        let obstacle = &self.scene.obstacles()[near.obstacle];
        self.begin(hardness.law(obstacle.compliance, self.reach))
    }

    fn own_compliance(&self) -> Option<f64> {
        match self.scene.self_contact() {
            SelfContact::Ignored => None,
            SelfContact::Touching { compliance, .. } => Some(compliance),
        }
    }

    /// The law of the robot's contacts with itself.
    pub fn own_law(&self) -> Law {
        self.own_law_of(self.hardness)
    }

    pub fn own_law_of(&self, hardness: Hardness) -> Law {
        let compliance = self.own_compliance().unwrap_or_default();
        self.begin(hardness.law(compliance, self.own_reach))
    }

    /// How a law begins at its reach: smoothly where it keeps a barrier.
    fn begin(&self, law: Law) -> Law {
        match self.scene.smoothing() > 0.0 {
            true => law.beginning_smoothly(),
            false => law,
        }
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

    /// Forgets all contacts.
    pub fn clear(&mut self) {
        self.pressing.clear();
        self.neighbourhood.clear();
        self.bristles.clear();
        if let Some(pairs) = &mut self.pairs {
            pairs.near.clear();
        }
    }

    /// Finds the contacts at the iterate.
    pub fn find(&mut self) {
        let chain = &self.iterate.posture.chain;
        self.neighbourhood
            .find(&self.beads, &self.scene, chain, |_, _| self.reach);
        if let Some(pairs) = &mut self.pairs {
            pairs.find(&self.beads, chain, |_, _| self.own_reach);
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
    pub fn energy(&self, potential: &Potential) -> f64 {
        let Iterate {
            configuration,
            posture,
            ..
        } = &self.iterate;
        potential.energy(configuration, posture) + self.touching_energy()
    }

    /// That of the contacts alone.
    pub fn touching_energy(&self) -> f64 {
        let chain = &self.iterate.posture.chain;
        let near = self.neighbourhood.near.iter();
        let contacts = near.map(|near| self.law(near).energy(near.gap));
        let own = self.own_law();
        let pairs = self.near_pairs().iter().map(|pair| own.energy(pair.gap));
        let sliding = self.bristles.iter();
        let sliding = sliding.map(|bristle| bristle.energy(&bristle.way(chain)));
        contacts.chain(pairs).chain(sliding).sum()
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
            let (force, stiffness) = bristle.response(&bristle.way(&posture.chain));
            match bristle.surfaces() {
                Surfaces::Obstacle(bead, _) => {
                    let point = (bead.disc, bead.centre);
                    self.pressing.push(posture, point, force, &stiffness);
                }
                Surfaces::Discs(beads) => {
                    let pair = bristle.pair(&beads, &posture.chain);
                    self.pressing.push_pair(pair, force);
                }
            }
        }
        let own = self.own_law();
        for pair in self.pairs.iter().flat_map(|pairs| &pairs.near) {
            let response = own.at(pair.gap);
            self.pressing
                .push_pair(pair.pressed(&response), pair.normal * response.force);
        }
    }

    /// Gradient and Hessian at the iterate, under `potential` and the contacts that are found there.
    pub fn expand(&mut self, potential: &Potential) {
        self.press();
        self.expand_pressed(potential);
    }

    /// The same under the forces that there are.
    pub fn expand_pressed(&mut self, potential: &Potential) {
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

    /// The gradient alone (N m), by the joints' turns along what hinges allow, under `potential` and the forces that there are.
    pub fn grade_pressed(&mut self, potential: &Potential) {
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
        let (tensions, out) = (&mut self.expansion.tensions, &mut self.gradient);
        pressed.gradient(configuration, posture, tensions, out);
        project(&posture.chain.hinges, out);
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
    pub fn factorise_positive(&mut self) {
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
}
