//! Forces that keep their size and direction, and so have a potential: weight, payload, line load,
//! and forces given in the world frame.
//!
//! A force `f` on a point at `r` in the frame of a disc of orientation `R` is the force on the disc's origin, and the
//! couple `R r x f` about there; so is a weight on a centre of mass. All couples of a disc together are a matrix,
//! `sum f r'`, whatever their number: their potential is `-tr(R r f')`, and gradient and Hessian follow from the
//! product of that matrix with `R'` ([`super::Lever`]).

use nalgebra::{Matrix3, Vector3};

use crate::chain::Chain;
use crate::robot::{Frame, Loads, Robot};

/// Dead forces on the discs of a robot, world frame.
#[derive(Debug)]
pub(crate) struct DeadForces {
    /// Force on the origin of each disc (N), its weight among them.
    pub at_origin: Vec<Vector3<f64>>,
    /// Gravitational acceleration, world frame (m/s²).
    pub gravity: Vector3<f64>,
    /// The couples of each disc's forces off its origin: the sum of `f r'`, forces `f` in world axes, the points' places
    /// `r` from the origin in the disc's (N m).
    couples: Vec<Matrix3<f64>>,
    /// Force of the payload on the distal disc (N).
    pub payload: Vector3<f64>,
    /// Where it acts, from the centre of the disc's joint, in the disc's frame (m).
    pub payload_arm: Vector3<f64>,
}

impl Loads {
    /// Of each of so many discs the sum of the moments that keep their direction (N m), world axes; empty where there are none.
    pub(crate) fn world_moments(&self, discs: usize) -> Vec<Vector3<f64>> {
        let mut moments = Vec::new();
        for wrench in self.wrenches() {
            if wrench.frame == Frame::World && wrench.moment != [0.0; 3] {
                moments.resize(discs, Vector3::zeros());
                moments[wrench.disc] += Vector3::from(wrench.moment);
            }
        }
        moments
    }
}

/// By hand, so that `clone_from` allocates nothing.
impl Clone for DeadForces {
    fn clone(&self) -> Self {
        Self {
            at_origin: self.at_origin.clone(),
            gravity: self.gravity,
            couples: self.couples.clone(),
            payload: self.payload,
            payload_arm: self.payload_arm,
        }
    }

    fn clone_from(&mut self, other: &Self) {
        self.at_origin.clone_from(&other.at_origin);
        self.couples.clone_from(&other.couples);
        (self.gravity, self.payload) = (other.gravity, other.payload);
        self.payload_arm = other.payload_arm;
    }
}

impl DeadForces {
    /// No forces on `robot`.
    pub fn new(robot: &Robot) -> Self {
        Self {
            at_origin: vec![Vector3::zeros(); robot.discs().len()],
            gravity: Vector3::zeros(),
            couples: vec![Matrix3::zeros(); robot.discs().len()],
            payload: Vector3::zeros(),
            payload_arm: Vector3::zeros(),
        }
    }

    /// Sets the forces to the weight of `robot` and the dead forces among `loads`.
    ///
    /// # Panics
    /// If a wrench acts on a disc that the robot does not have ([`Loads::check`]).
    pub fn set(&mut self, robot: &Robot, loads: &Loads) {
        self.gravity = robot.gravity();
        for (couple, disc) in self.couples.iter_mut().zip(robot.discs()) {
            *couple = robot.gravity() * (disc.centre_of_mass * disc.mass).transpose();
        }
        let line = loads.line_load();
        for (i, (force, disc)) in self.at_origin.iter_mut().zip(robot.discs()).enumerate() {
            let above = robot
                .discs()
                .get(i + 1)
                .map_or(0.0, |next| next.offset.norm());
            *force = robot.gravity() * disc.mass + line * (0.5 * (disc.offset.norm() + above));
        }
        for wrench in loads.wrenches() {
            if wrench.frame == Frame::World {
                let force = Vector3::from(wrench.force);
                self.at_origin[wrench.disc] += force;
                self.couples[wrench.disc] += force * Vector3::from(wrench.point).transpose();
            }
        }
        let weight = robot.gravity() * loads.tip_payload().mass;
        self.set_payload(robot, loads, weight);
    }

    /// Adds a force (N, world axes) on a point of a disc, from its origin in its frame (m).
    pub fn push(&mut self, disc: usize, point: &Vector3<f64>, force: &Vector3<f64>) {
        self.at_origin[disc] += force;
        self.couples[disc] += force * point.transpose();
    }

    /// Sets the payload's force, acting where the payload of `loads` hangs.
    pub fn set_payload(&mut self, robot: &Robot, loads: &Loads, force: Vector3<f64>) {
        self.payload = force;
        let origin = robot
            .discs()
            .last()
            .map_or(Vector3::zeros(), |disc| disc.origin);
        self.payload_arm = origin + Vector3::from(loads.tip_payload().offset);
    }

    /// The couples of a disc of this orientation: the sum of `f (R r)'` in world axes (N m); `None` where all forces
    /// act on the origin.
    #[inline(always)]
    pub fn couple(&self, disc: usize, orientation: &Matrix3<f64>) -> Option<Matrix3<f64>> {
        let couple = &self.couples[disc];
        (*couple != Matrix3::zeros()).then(|| couple * orientation.transpose())
    }

    /// Of a disc the force on its origin (N), and the couples about there, the sum of `f r'` in world axes (N m), `None` where all forces
    /// act on the origin; the payload's among them.
    pub fn wrench(&self, disc: usize, chain: &Chain) -> (Vector3<f64>, Option<Matrix3<f64>>) {
        let orientation = chain.disc(disc);
        let (force, couples) = (self.at_origin[disc], self.couple(disc, orientation));
        if disc + 1 < self.at_origin.len() {
            return (force, couples);
        }
        let hung = chain.centres[disc] + orientation * self.payload_arm;
        let own = self.payload * (hung - chain.positions[disc]).transpose();
        (
            force + self.payload,
            Some(couples.unwrap_or_default() + own),
        )
    }

    /// Derivatives by a rotation of the base (rad, world axes) of a cost that has these derivatives by a force on each disc's origin and by a
    /// moment: seen from the base, dead `wrenches` ([`DeadForces::wrench`]) and `moments` ([`Loads::world_moments`]) turn the other way.
    pub fn pull_back_base(
        wrenches: impl IntoIterator<Item = (Vector3<f64>, Option<Matrix3<f64>>)>,
        moments: &[Vector3<f64>],
        cotangents: impl IntoIterator<Item = [Vector3<f64>; 2]>,
    ) -> Vector3<f64> {
        let dead = wrenches.into_iter().zip(cotangents).enumerate();
        dead.map(|(disc, ((force, couples), [by_force, by_moment]))| {
            let couples = couples.map_or_else(Vector3::zeros, |couples| {
                couples.tr_mul(&by_moment) - by_moment * couples.trace()
            });
            let moment = moments.get(disc).map(|moment| moment.cross(&by_moment));
            couples - force.cross(&by_force) - moment.unwrap_or_default()
        })
        .sum()
    }

    /// Their potential (J) in the poses of `chain`.
    pub fn energy(&self, chain: &Chain) -> f64 {
        let forces = self.at_origin.iter().zip(&chain.positions);
        let lifted: f64 = forces.map(|(force, position)| force.dot(position)).sum();
        let off_origin: f64 = (chain.orientations[1..].iter().enumerate())
            .filter_map(|(disc, orientation)| self.couple(disc, orientation))
            .map(|couple| couple.trace())
            .sum();
        let tip = chain.positions.len() - 1;
        let hung = chain.centres[tip] + chain.disc(tip) * self.payload_arm;
        -lifted - off_origin - self.payload.dot(&hung)
    }
}
