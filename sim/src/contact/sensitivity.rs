//! Derivatives of an equilibrium among obstacles.
//!
//! The force `F` of a contact on a point `p` changes with the obstacle's motion, a displacement `d` of its origin `o` and a rotation
//! `r`, by `S u + r x F`, `u = d + r x (p - o)`: `S` is what a displacement of the point diminishes the force by. A motion of the base
//! is the opposite motion of everything else: obstacles, weights, loads of the world frame. The implicit function theorem does the rest, as in
//! [`crate::sensitivity`].

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::equations::Equations;
use super::law::by_compliance;
use super::near_pairs::NearPair;
use super::surfaces::Surfaces;
use crate::chain::Chain;
pub use crate::dynamics::ObstacleGradient;
use crate::energy::{DeadForces, twist};
use crate::pose::{PoseTangent, levers};
use crate::robot::{Command, Loads};
use crate::sensitivity::{OnRod, PressedPoint, Sensitivity, SensitivityError};
use crate::statics::Equilibrium;

/// The factorised system of an equilibrium among obstacles, with which it is differentiated.
///
/// Where a contact is only just touching ([`super::Activity::Weak`]) derivatives differ from one side to the other; these are in
/// between.
#[derive(Clone, Debug)]
pub struct ContactSensitivity {
    sensitivity: Sensitivity,
    chain: Chain,
    base: Vector3<f64>,
    contacts: Vec<Pressed>,
    /// Of each disc the force that keeps its direction (N), and its couples (N m): [`DeadForces::wrenches`].
    dead: Vec<(Vector3<f64>, Option<Matrix3<f64>>)>,
    /// Of each disc the moment that keeps its direction (N m), which only a robot without obstacles bears.
    moments: Vec<Vector3<f64>>,
    /// Origin of each obstacle (m).
    origins: Vec<Vector3<f64>>,
}

/// One contact, as derivatives take it.
#[derive(Clone, Debug)]
struct Pressed {
    disc: usize,
    /// [`Bead::along_rod`](crate::geometry::Bead::along_rod) of its bead.
    along_rod: f64,
    obstacle: usize,
    /// Whether it is the normal force of a contact; else it is friction.
    is_normal: bool,
    /// Where it acts (m), and its force on the robot (N), world axes.
    point: Vector3<f64>,
    force: Vector3<f64>,
    /// By what a displacement of the point diminishes the force (N/m).
    stiffness: Matrix3<f64>,
    /// Change of the force by the compliance (N²/m).
    by_compliance: Vector3<f64>,
}

/// Derivatives of a cost by what is around a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneGradient {
    /// By a displacement (m) of the robot's base and a rotation about its origin (rad), world axes.
    pub base: PoseTangent,
    /// Of each obstacle of the scene.
    pub obstacles: Vec<ObstacleGradient>,
}

impl ContactSensitivity {
    /// Of the equilibrium that was found by these equations.
    pub(super) fn new(
        equations: &Equations,
        command: &Command,
        loads: &Loads,
        found: &Equilibrium,
    ) -> Result<Self, SensitivityError> {
        let (robot, scene) = (&equations.robot, &equations.scene);
        // Not the iterate's, which without obstacles has not moved.
        let mut chain = Chain::new(robot);
        chain.place(robot, &found.configuration);
        let of = |obstacle: usize| scene.obstacles()[obstacle].compliance;
        // Those between discs have been refused.
        let sticking = equations.bristles.iter().filter_map(|bristle| {
            let Surfaces::Obstacle(bead, obstacle) = bristle.surfaces() else {
                return None;
            };
            let (force, stiffness) = bristle.response(&bristle.way(&chain));
            Some(Pressed {
                along_rod: bead.along_rod,
                disc: bead.disc,
                obstacle,
                is_normal: false,
                point: bristle.acts_at(&chain),
                force,
                stiffness,
                by_compliance: by_compliance(of(obstacle), force * -bristle.stiffness),
            })
        });
        let contacts: Vec<Pressed> = (equations.neighbourhood.near.iter())
            .map(|near| {
                let response = equations.law(near).at(near.gap);
                Pressed {
                    along_rod: near.bead.along_rod,
                    disc: near.bead.disc,
                    obstacle: near.obstacle,
                    is_normal: true,
                    point: chain.centres[near.bead.disc] + near.arm,
                    force: near.normal * response.force,
                    stiffness: near.stiffness(&response),
                    by_compliance: by_compliance(
                        of(near.obstacle),
                        near.normal * response.by_compliance,
                    ),
                }
            })
            .chain(sticking)
            .collect();
        let on_rods = (contacts.iter().filter_map(Pressed::on_rod))
            .chain(
                equations
                    .near_pairs()
                    .iter()
                    .flat_map(|near| on_rods_of(equations, near)),
            )
            .collect();
        let pressing = (&equations.pressing, on_rods);
        let sensitivity = Sensitivity::pressed(robot, command, loads, found, pressing)?;
        let mut dead = DeadForces::new(robot);
        dead.set(robot, loads);
        let discs = chain.positions.len();
        Ok(Self {
            sensitivity,
            base: robot.base(),
            contacts,
            dead: (0..discs).map(|disc| dead.wrench(disc, &chain)).collect(),
            moments: loads.world_moments(discs),
            origins: (scene.obstacles().iter())
                .map(|obstacle| obstacle.pose.translation.vector)
                .collect(),
            chain,
        })
    }

    /// Derivatives by the command, loads, and the robot's own parameters.
    pub fn parameters(&self) -> &Sensitivity {
        &self.sensitivity
    }

    /// Change of all disc poses when an obstacle moves: its origin by `motion.position` (m), and about it by
    /// `motion.rotation` (rad).
    ///
    /// # Panics
    /// For an obstacle that the scene does not have.
    pub fn by_obstacle(&self, obstacle: usize, motion: &PoseTangent) -> Vec<PoseTangent> {
        let origin = self.origins[obstacle];
        self.moved(|contact| {
            (contact.obstacle == obstacle).then(|| contact.carried(motion, &origin))
        })
    }

    /// Change of all disc poses by an obstacle's compliance (per m/N).
    pub fn by_compliance(&self, obstacle: usize) -> Vec<PoseTangent> {
        self.moved(|contact| (contact.obstacle == obstacle).then_some(contact.by_compliance))
    }

    /// Change of all disc poses when the base moves: its origin by `motion.position` (m), and about it by
    /// `motion.rotation` (rad). The command stays: tendons move with the base.
    pub fn by_base(&self, motion: &PoseTangent) -> Vec<PoseTangent> {
        let mut wrenches = self.wrenches(|contact| Some(-contact.carried(motion, &self.base)));
        for (wrench, (force, couple)) in wrenches.iter_mut().zip(self.turned_dead(motion)) {
            wrench.position -= force;
            wrench.rotation -= couple;
        }
        for (wrench, moment) in wrenches.iter_mut().zip(&self.moments) {
            wrench.rotation -= motion.rotation.cross(moment);
        }
        let mut poses = self.settle(&wrenches);
        for (pose, position) in poses.iter_mut().zip(&self.chain.positions) {
            pose.position += motion.position + motion.rotation.cross(&(position - self.base));
            pose.rotation += motion.rotation;
        }
        poses
    }

    /// Gradient, by each disc's pose (N/m, N/rad, world axes), of the normal force with which the robot presses on an obstacle that
    /// stays where it is: of the contacts of one disc, from 0, or of all ([`ContactEquilibrium::normal_force`]).
    ///
    /// [`ContactEquilibrium::normal_force`]: super::ContactEquilibrium::normal_force
    pub fn normal_force_gradient(&self, obstacle: usize, disc: Option<usize>) -> Vec<PoseTangent> {
        self.wrenches(|contact| {
            let asked = contact.is_normal
                && contact.obstacle == obstacle
                && disc.is_none_or(|disc| disc == contact.disc);
            // The normal is the force's direction; the stiffness is symmetric.
            let normal = asked.then(|| contact.force.try_normalize(0.0)).flatten()?;
            Some(-(contact.stiffness * normal))
        })
    }

    /// Jacobian of all disc poses by the motion of an obstacle, its origin (m) and its rotation (rad): `6 n` rows as
    /// [`Sensitivity::jacobian`] has them, 6 columns.
    pub fn obstacle_jacobian(&self, obstacle: usize) -> DMatrix<f64> {
        jacobian(self.chain.positions.len(), |motion| {
            self.by_obstacle(obstacle, motion)
        })
    }

    /// The same by the motion of the base.
    pub fn base_jacobian(&self) -> DMatrix<f64> {
        jacobian(self.chain.positions.len(), |motion| self.by_base(motion))
    }

    /// Derivatives of a cost by the base and all obstacles, given those by each disc's pose: one solve.
    ///
    /// # Panics
    /// If there is not one cotangent for each disc.
    pub fn vjp(&self, cotangents: &[PoseTangent]) -> SceneGradient {
        assert_eq!(
            cotangents.len(),
            self.chain.positions.len(),
            "one for each disc"
        );
        let motions = self.sensitivity.adjoint_motions(cotangents);
        let mut gradient = SceneGradient {
            base: PoseTangent::default(),
            obstacles: vec![ObstacleGradient::default(); self.origins.len()],
        };
        for contact in &self.contacts {
            let motion = &motions[contact.disc];
            let arm = contact.point - self.chain.positions[contact.disc];
            let moved = motion.position + motion.rotation.cross(&arm);
            let force = contact.stiffness * moved;
            let couple = contact.force.cross(&moved);
            let own = &mut gradient.obstacles[contact.obstacle];
            let from = contact.point - self.origins[contact.obstacle];
            own.pose.position += force;
            own.pose.rotation += from.cross(&force) + couple;
            own.compliance += contact.by_compliance.dot(&moved);
            gradient.base.position -= force;
            gradient.base.rotation -= (contact.point - self.base).cross(&force) + couple;
        }
        let virtual_motions = motions.iter().map(|own| [own.position, own.rotation]);
        gradient.base.rotation +=
            DeadForces::pull_back_base(self.dead.iter().copied(), &self.moments, virtual_motions);
        for (cotangent, position) in cotangents.iter().zip(&self.chain.positions) {
            gradient.base.position += cotangent.position;
            gradient.base.rotation +=
                (position - self.base).cross(&cotangent.position) + cotangent.rotation;
        }
        gradient
    }

    /// Change of the disc poses when the forces of contacts change.
    fn moved(&self, change: impl Fn(&Pressed) -> Option<Vector3<f64>>) -> Vec<PoseTangent> {
        self.settle(&self.wrenches(change))
    }

    /// Changes of the contacts' forces, on the discs' origins.
    fn wrenches(&self, change: impl Fn(&Pressed) -> Option<Vector3<f64>>) -> Vec<PoseTangent> {
        let mut wrenches = vec![PoseTangent::default(); self.chain.positions.len()];
        for contact in &self.contacts {
            if let Some(force) = change(contact) {
                let wrench = &mut wrenches[contact.disc];
                wrench.position += force;
                wrench.rotation +=
                    (contact.point - self.chain.positions[contact.disc]).cross(&force);
            }
        }
        wrenches
    }

    /// Change of the discs' poses by wrenches on their origins.
    fn settle(&self, wrenches: &[PoseTangent]) -> Vec<PoseTangent> {
        self.sensitivity.yielding(&levers(&self.chain, wrenches))
    }

    /// Change of the dead forces and couples when all of them turn.
    fn turned_dead(
        &self,
        motion: &PoseTangent,
    ) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> {
        let turn = motion.rotation;
        self.dead.iter().map(move |(force, couples)| {
            let turned = couples.map(|couples| -twist(&(turn.cross_matrix() * couples)));
            (turn.cross(force), turned.unwrap_or_default())
        })
    }
}

impl Pressed {
    /// The same if its bead moves along its disc.
    fn on_rod(&self) -> Option<OnRod> {
        (self.along_rod > 0.0).then_some(OnRod {
            bead: PressedPoint {
                disc: self.disc,
                position: self.point,
            },
            share: self.along_rod,
            force: self.force,
            stiffness: self.stiffness,
            partner: None,
        })
    }

    /// Change of the force when the obstacle moves about a point as `motion` says.
    fn carried(&self, motion: &PoseTangent, about: &Vector3<f64>) -> Vector3<f64> {
        let displacement = motion.position + motion.rotation.cross(&(self.point - about));
        self.stiffness * displacement + motion.rotation.cross(&self.force)
    }
}

/// A contact of the robot with itself, for each of its beads that moves along its disc.
fn on_rods_of(equations: &Equations, near: &NearPair) -> impl Iterator<Item = OnRod> {
    let response = equations.own_law().at(near.gap);
    let pair = near.pressed(&response);
    let points = [0, 1].map(|side| PressedPoint {
        disc: near.beads[side].disc,
        position: near.centres[side],
    });
    let (beads, force) = (near.beads, near.normal * response.force);
    [(0, 1.0), (1, -1.0)]
        .into_iter()
        .filter_map(move |(side, sign)| {
            (beads[side].along_rod > 0.0).then_some(OnRod {
                bead: points[side],
                share: beads[side].along_rod,
                force: force * sign,
                stiffness: pair.form(),
                partner: Some(points[1 - side]),
            })
        })
}

fn jacobian(discs: usize, poses: impl Fn(&PoseTangent) -> Vec<PoseTangent>) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(6 * discs, 6);
    for column in 0..6 {
        let mut motion = PoseTangent::default();
        match column {
            0..3 => motion.position[column] = 1.0,
            _ => motion.rotation[column - 3] = 1.0,
        }
        for (disc, pose) in poses(&motion).iter().enumerate() {
            for axis in 0..3 {
                jacobian[(6 * disc + axis, column)] = pose.position[axis];
                jacobian[(6 * disc + 3 + axis, column)] = pose.rotation[axis];
            }
        }
    }
    jacobian
}
