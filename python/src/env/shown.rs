//! What drives a robot of a batch, and where it was last seen.

use nalgebra::{UnitQuaternion, Vector3};
use tdcr::sim::chain::Configuration;
use tdcr::sim::contact::{Contact, ContactSettler};
use tdcr::sim::pose::Pose;
use tdcr::sim::robot::Robot;
use tdcr::sim::simulation::{MovingRobot, Simulation};
use tdcr::sim::statics::Settler;

use crate::objects;

/// How a robot is driven.
pub(super) enum Driven {
    AtRest(Box<Settler>),
    /// At rest among obstacles.
    InContact(Box<ContactSettler>),
    InMotion(Box<MovingRobot>),
}

impl Driven {
    pub fn simulation(&mut self) -> &mut dyn Simulation {
        match self {
            Self::AtRest(settler) => settler.as_mut(),
            Self::InContact(settler) => settler.as_mut(),
            Self::InMotion(moving) => moving.as_mut(),
        }
    }

    /// A robot that moves in time.
    pub fn moving(&self) -> Option<&MovingRobot> {
        match self {
            Self::InMotion(moving) => Some(moving),
            Self::AtRest(_) | Self::InContact(_) => None,
        }
    }

    /// What it touches.
    fn contacts(&self) -> &[Contact] {
        match self {
            Self::AtRest(_) => &[],
            Self::InContact(settler) => &settler.found().contacts,
            Self::InMotion(moving) => moving.contacts(),
        }
    }
}

/// What a robot touches.
#[derive(Clone)]
pub struct Touch {
    /// Number of contacts.
    pub count: usize,
    /// Largest of their forces, and the sum of these (N).
    pub largest: f64,
    pub sum: f64,
    /// Force on each disc, world axes (N).
    pub on_discs: Vec<Vector3<f64>>,
}

impl Touch {
    fn nothing(discs: usize) -> Self {
        Self {
            count: 0,
            largest: 0.0,
            sum: 0.0,
            on_discs: vec![Vector3::zeros(); discs],
        }
    }

    fn take(&mut self, contacts: &[Contact]) {
        self.on_discs.fill(Vector3::zeros());
        (self.count, self.largest, self.sum) = (contacts.len(), 0.0, 0.0);
        for contact in contacts {
            self.on_discs[contact.disc] += contact.force;
            if let Some(other) = contact.partner.disc() {
                self.on_discs[other] -= contact.force;
            }
            let force = contact.force.norm();
            self.largest = self.largest.max(force);
            self.sum += force;
        }
    }
}

/// Where a robot was last seen: after its last advance that did not fail.
pub struct Shown {
    pub configuration: Configuration,
    pub positions: Vec<Vector3<f64>>,
    pub orientations: Vec<UnitQuaternion<f64>>,
    pub lengths: Vec<f64>,
    pub tensions: Vec<f64>,
    /// Of the joints (rad/s), three entries each; 0 where the robot does not move in time.
    pub rates: Vec<f64>,
    /// Of the tip, the mean over the last advance (m/s); 0 where the robot does not move in time.
    pub velocity: Vector3<f64>,
    pub touch: Touch,
    /// Objects of its scene, rows of [`objects::WIDTH`]; none where the robot does not move in time.
    pub objects: Vec<f64>,
}

impl Shown {
    pub fn new(robot: &Robot) -> Self {
        let (discs, tendons) = (robot.discs().len(), robot.tendons().len());
        Self {
            configuration: Configuration::straight(robot),
            positions: vec![Vector3::zeros(); discs],
            orientations: vec![UnitQuaternion::identity(); discs],
            lengths: vec![0.0; tendons],
            tensions: vec![0.0; tendons],
            rates: vec![0.0; 3 * discs],
            velocity: Vector3::zeros(),
            touch: Touch::nothing(discs),
            objects: Vec::new(),
        }
    }

    pub fn pose(&self) -> Pose<'_> {
        Pose {
            configuration: &self.configuration,
            positions: &self.positions,
            orientations: &self.orientations,
            tendon_lengths: &self.lengths,
            tendon_tensions: &self.tensions,
        }
    }

    pub fn tip(&self) -> Vector3<f64> {
        self.positions.last().copied().unwrap_or_default()
    }

    pub(super) fn take(&mut self, driven: &Driven) {
        let pose = match driven {
            Driven::AtRest(settler) => settler.pose(),
            Driven::InContact(settler) => settler.pose(),
            Driven::InMotion(moving) => {
                self.rates.copy_from_slice(&moving.state().velocity);
                moving.pose()
            }
        };
        (self.configuration.0).copy_from_slice(&pose.configuration.0);
        self.positions.copy_from_slice(pose.positions);
        self.orientations.copy_from_slice(pose.orientations);
        self.lengths.copy_from_slice(pose.tendon_lengths);
        self.tensions.copy_from_slice(pose.tendon_tensions);
        self.touch.take(driven.contacts());
        if let Some(moving) = driven.moving() {
            self.objects
                .resize(objects::WIDTH * moving.objects().len(), 0.0);
            objects::write(moving, &mut self.objects);
        }
    }
}
