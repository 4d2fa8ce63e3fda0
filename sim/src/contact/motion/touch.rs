//! A point of contact as the velocity problem has it: what it acts on, and its impulse by its velocity.

use nalgebra::{Matrix3, Vector3};

use super::super::{Partner, Sliding};
use super::law::Push;
use crate::geometry::Bead;

/// Sliding velocity (m/s) up to which a contact sticks: it creeps by as much at most.
pub(super) const STICK: f64 = 1e-6;

/// What a contact acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// A disc.
    Disc(usize),
    /// An object, by its place in the problem.
    Object(usize),
}

/// What a contact is known by from step to step: a bead near an obstacle, or an object near another or near what is fixed. Several have
/// one name where a bead is near two faces, or an object stands on four points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Name {
    Bead(Bead, usize),
    Objects(usize, Option<usize>),
    Discs(Bead, Bead),
}

/// The object that a contact acts on the other way, by its place in the problem, and where, from its centre of mass (m).
#[derive(Clone, Copy, Debug)]
pub(super) struct Opposite {
    pub object: usize,
    pub arm: Vector3<f64>,
}

/// A point at which a disc touches, or an object, or soon may.
#[derive(Clone, Copy, Debug)]
pub(super) struct Touch {
    pub name: Name,
    /// What the impulse acts on, and which object the opposite one acts on, if any.
    pub on: Side,
    pub against: Option<Opposite>,
    /// The other disc that the opposite impulse acts on, if any, and where, from the centre of its joint (m).
    pub other: Option<(usize, Vector3<f64>)>,
    /// What a disc touches.
    pub partner: Partner,
    /// Gap (m) at the begin of the step, and its gradient by the bead's centre.
    pub gap: f64,
    pub gradient: Vector3<f64>,
    /// That gradient's direction.
    pub normal: Vector3<f64>,
    /// The point from the centre of the disc's joint, or from that of the object's mass, world axes (m).
    pub arm: Vector3<f64>,
    pub push: Push,
    /// Coefficient of friction, and the bound of its impulse (N s).
    pub friction: f64,
    pub bound: f64,
    /// Velocity without contacts, and with (m/s).
    pub free: Vector3<f64>,
    pub velocity: Vector3<f64>,
    /// The impulse that the velocities are of (N s).
    pub impulse: Vector3<f64>,
}

/// What a contact does at its velocity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Response {
    pub impulse: Vector3<f64>,
    pub inertance: Matrix3<f64>,
}

impl Response {
    /// Whether there is an impulse, or would be at other velocities.
    pub fn acts(&self) -> bool {
        self.impulse != Vector3::zeros() || self.inertance != Matrix3::zeros()
    }
}

impl Touch {
    /// Impulse along the gradient at a velocity (N s).
    pub fn pressed(&self, velocity: &Vector3<f64>) -> f64 {
        self.push.inertance * (self.push.speed - self.gradient.dot(velocity)).max(0.0)
    }

    /// The impulse at a velocity.
    pub fn impulse_at(&self, velocity: &Vector3<f64>) -> Vector3<f64> {
        let mut impulse = self.gradient * self.pressed(velocity);
        if self.bound > 0.0 {
            let sliding = velocity - self.normal * self.normal.dot(velocity);
            impulse -= sliding * (self.bound / sliding.norm().max(STICK));
        }
        impulse
    }

    pub fn response(&self) -> Response {
        let velocity = &self.velocity;
        let mut inertance = Matrix3::zeros();
        if self.pressed(velocity) > 0.0 {
            inertance += self.gradient * self.gradient.transpose() * self.push.inertance;
        }
        if self.bound > 0.0 {
            let sliding = velocity - self.normal * self.normal.dot(velocity);
            let speed = sliding.norm();
            let mut across = Matrix3::identity() - self.normal * self.normal.transpose();
            if speed > STICK {
                let along = sliding / speed;
                across -= along * along.transpose();
            }
            inertance += across * (self.bound / speed.max(STICK));
        }
        Response {
            impulse: self.impulse_at(velocity),
            inertance,
        }
    }

    /// Directions of length 1 in which a change of its velocity diminishes the impulse along them, and by how much (kg), of a contact
    /// whose gradient is of length 1: the parts of its inertance.
    pub fn axes(&self) -> [(Vector3<f64>, f64); 3] {
        let normal = match self.pressed(&self.velocity) > 0.0 {
            true => self.push.inertance,
            false => 0.0,
        };
        let sliding = self.velocity - self.normal * self.normal.dot(&self.velocity);
        let speed = sliding.norm();
        // Friction that slides does not change with the speed.
        let (along, held) = match speed > STICK {
            true => (sliding / speed, 0.0),
            false => {
                let least = self.normal.iamin();
                let aside = self.normal.cross(&Vector3::ith(least, 1.0));
                (aside.normalize(), self.bound / STICK)
            }
        };
        let across = self.normal.cross(&along);
        [
            (self.normal, normal),
            (along, held),
            (across, self.bound / speed.max(STICK)),
        ]
    }

    /// Whether it slides at its velocity.
    pub fn sliding(&self) -> Sliding {
        let along = self.velocity - self.normal * self.normal.dot(&self.velocity);
        match self.friction > 0.0 {
            true if along.norm() > STICK => Sliding::Slips,
            true => Sliding::Sticks,
            false => Sliding::Free,
        }
    }

    /// Whether it does anything.
    pub fn acts(&self) -> bool {
        self.impulse != Vector3::zeros()
    }
}

/// Turns (rad/s) of discs and velocities of their joints' centres (m/s), world axes.
#[derive(Clone, Debug, Default)]
pub(super) struct DiscVelocities(pub Vec<(Vector3<f64>, Vector3<f64>)>);

impl DiscVelocities {
    /// Sets them to those of the joints' `rates`.
    pub fn set(&mut self, centres: &[Vector3<f64>], rates: &[Vector3<f64>]) {
        let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
        let mut below = centres.first().copied().unwrap_or_default();
        self.0.clear();
        self.0
            .extend(rates.iter().zip(centres).map(|(rate, centre)| {
                shift += turn.cross(&(centre - below));
                below = *centre;
                turn += rate;
                (turn, shift)
            }));
    }

    /// Velocity of a point of a disc (m/s), at `arm` from its joint's centre.
    pub fn of(&self, disc: usize, arm: &Vector3<f64>) -> Vector3<f64> {
        let (turn, shift) = self.0[disc];
        shift + turn.cross(arm)
    }
}
