//! What a contact is between.

use crate::geometry::Bead;
use crate::scene::Scene;

/// The two surfaces of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Surfaces {
    /// A bead, and an obstacle by its number.
    Obstacle(Bead, usize),
    /// Beads of two discs.
    Discs([Bead; 2]),
}

impl Surfaces {
    /// Whether these are of the same disc and obstacle, or of the same two discs.
    pub fn are_beside(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Obstacle(bead, obstacle), Self::Obstacle(beside, of)) => {
                bead.disc == beside.disc && obstacle == of
            }
            _ => self.discs().is_some() && self.discs() == other.discs(),
        }
    }

    /// The discs, if there are two.
    pub fn discs(&self) -> Option<[usize; 2]> {
        match self {
            Self::Obstacle(..) => None,
            Self::Discs(beads) => Some(beads.map(|bead| bead.disc)),
        }
    }

    /// Their coefficient of friction in a scene.
    pub fn friction(&self, scene: &Scene) -> f64 {
        match self {
            Self::Obstacle(_, obstacle) => scene.obstacles()[*obstacle].friction,
            Self::Discs(_) => scene.self_contact().friction(),
        }
    }
}
