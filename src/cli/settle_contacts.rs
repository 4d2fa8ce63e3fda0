//! What a robot touches, as `tdcr settle` and `tdcr simulate` say it.

use std::fmt::Write;

use serde::Serialize;
use tdcr::report::counted;
use tdcr::sim::contact::{Activity, Contact, ContactSettler, Sliding};
use tdcr::sim::scene::Scene;
use tdcr::sim::tendon_friction::ContactPath;

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

/// One contact.
#[derive(Serialize)]
pub(super) struct ContactJson {
    /// From 0.
    disc: usize,
    /// Name of the obstacle, absent where another disc is touched.
    #[serde(skip_serializing_if = "Option::is_none")]
    obstacle: Option<String>,
    /// The disc that is touched, from 0, absent where it is an obstacle.
    #[serde(skip_serializing_if = "Option::is_none")]
    other_disc: Option<usize>,
    /// On what is touched, world frame (m).
    point: [f64; 3],
    /// Outward.
    normal: [f64; 3],
    /// Of the undeformed surfaces (m).
    gap: f64,
    /// On the disc, world axes (N).
    force: [f64; 3],
    /// `free`, `sticks` or `slips`.
    sliding: &'static str,
    /// `strict`, or `weak` where derivatives are one-sided.
    activity: &'static str,
}

impl ContactJson {
    /// What is touched, in words.
    fn partner(&self) -> String {
        match (&self.obstacle, self.other_disc) {
            (None, Some(disc)) => format!("disc {disc}"),
            (obstacle, _) => obstacle.clone().unwrap_or_default(),
        }
    }

    /// A contact in a scene.
    pub fn of(contact: &Contact, scene: &Scene) -> Self {
        Self {
            disc: contact.disc,
            obstacle: (contact.partner.obstacle())
                .map(|obstacle| scene.obstacles()[obstacle].name.clone()),
            other_disc: contact.partner.disc(),
            point: contact.point.into(),
            normal: contact.normal.into(),
            gap: contact.gap,
            force: contact.force.into(),
            sliding: match contact.sliding {
                Sliding::Free => "free",
                Sliding::Sticks => "sticks",
                Sliding::Slips => "slips",
            },
            activity: match contact.activity {
                Activity::Strict => "strict",
                Activity::Weak => "weak",
            },
        }
    }

    /// Size of the force (N).
    pub fn strength(&self) -> f64 {
        self.force.iter().map(|f| f * f).sum::<f64>().sqrt()
    }
}

impl Surroundings {
    /// Of the last equilibrium; none where nothing can be touched.
    pub fn of(settler: &ContactSettler) -> Option<Self> {
        let (scene, found) = (settler.scene(), settler.found());
        (!scene.is_empty()).then(|| Self {
            contacts: (found.contacts.iter())
                .map(|contact| ContactJson::of(contact, scene))
                .collect(),
            complementarity: found.complementarity,
            penetration: found.penetration,
            shape_error: settler.beads().shape_error(),
        })
    }

    /// Where a path with friction has come to; none where nothing can be touched.
    pub fn on_path(path: &ContactPath, shape_error: f64) -> Option<Self> {
        let scene = path.scene();
        let [complementarity, penetration] = path.contact_errors()?;
        Some(Self {
            contacts: (path.contacts().iter())
                .map(|contact| ContactJson::of(contact, scene))
                .collect(),
            complementarity,
            penetration,
            shape_error,
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
            "\ndisc  touches               x (m)      y (m)      z (m)   gap (um)  force (N)\n",
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
                contact.partner(),
                1e6 * contact.gap
            );
        }
    }
}
