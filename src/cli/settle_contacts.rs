//! What a settled robot touches, as `tdcr settle` says it.

use std::fmt::Write;

use serde::Serialize;
use tdcr::report::counted;
use tdcr::sim::contact::{Activity, Contact, ContactSettler};
use tdcr::sim::scene::Scene;

/// The contacts of an equilibrium in a scene, and how exact they are.
#[derive(Serialize)]
pub(super) struct Surroundings {
    contacts: Vec<ContactJson>,
    /// Largest product of a force and a distance of surfaces (J).
    complementarity: f64,
    /// Deepest overlap of the undeformed shapes (m).
    penetration: f64,
    /// Of the beads that stand for the discs (m).
    shape_error: f64,
}

/// A contact of a robot.
#[derive(Serialize)]
pub(super) struct ContactJson {
    /// From 0.
    disc: usize,
    /// Its name.
    obstacle: String,
    /// On the obstacle, world frame (m).
    point: [f64; 3],
    /// Outward.
    normal: [f64; 3],
    /// Of the undeformed surfaces (m).
    gap: f64,
    /// On the robot, world axes (N).
    force: [f64; 3],
    /// `strict`, or `weak` where derivatives are one-sided.
    activity: &'static str,
}

impl ContactJson {
    /// A contact with an obstacle of `scene`.
    pub fn new(contact: &Contact, scene: &Scene) -> Self {
        Self {
            disc: contact.disc,
            obstacle: scene.obstacles()[contact.obstacle].name.clone(),
            point: contact.point.into(),
            normal: contact.normal.into(),
            gap: contact.gap,
            force: contact.force.into(),
            activity: match contact.activity {
                Activity::Strict => "strict",
                Activity::Weak => "weak",
            },
        }
    }

    /// Size of the force (N).
    fn strength(&self) -> f64 {
        self.force.iter().map(|f| f * f).sum::<f64>().sqrt()
    }
}

impl Surroundings {
    /// Of the last equilibrium; none in a scene without obstacles.
    pub fn of(settler: &ContactSettler) -> Option<Self> {
        let (scene, found) = (settler.scene(), settler.found());
        let contact = |contact: &Contact| ContactJson::new(contact, scene);
        (!scene.obstacles().is_empty()).then(|| Self {
            contacts: found.contacts.iter().map(contact).collect(),
            complementarity: found.complementarity,
            penetration: found.penetration,
            shape_error: settler.beads().shape_error(),
        })
    }

    /// How many contacts there are.
    pub fn count(&self) -> usize {
        self.contacts.len()
    }

    /// Largest force of a contact (N), 0 without one.
    pub fn largest_force(&self) -> f64 {
        (self.contacts.iter().map(ContactJson::strength)).fold(0.0, f64::max)
    }

    /// Adds them to a text.
    pub fn write(&self, text: &mut String) {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{}; complementarity {:.1e} J, deepest penetration {:.1e} m; beads are within {:.1} mm of the discs",
            counted(self.contacts.len(), "contact"),
            self.complementarity,
            self.penetration,
            1e3 * self.shape_error
        );
        if self.contacts.is_empty() {
            return;
        }
        text.push_str(
            "\ndisc  obstacle              x (m)      y (m)      z (m)   gap (um)  force (N)\n",
        );
        for contact in &self.contacts {
            let [x, y, z] = contact.point;
            let force = contact.strength();
            let weak = match contact.activity {
                "weak" => "  weak: derivatives are one-sided",
                _ => "",
            };
            let _ = writeln!(
                text,
                "{:4}  {:16} {x:10.6} {y:10.6} {z:10.6} {:10.4} {force:10.5}{weak}",
                contact.disc,
                contact.obstacle,
                1e6 * contact.gap
            );
        }
    }
}
