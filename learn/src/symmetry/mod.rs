//! A robot's symmetries in what cameras see of it, and data by one representative of each class.
//!
//! All images of a condition under a robot's symmetries are one class, and their clouds are images of each other. A network
//! that learns one representative of each class learns all: a condition is replaced by its class's representative
//! ([`Symmetries::canonical`](tdcr_sim::symmetry::Symmetries::canonical)) and its cloud is moved alike, before normalisation; a
//! predicted cloud is moved back. For the paper's robots, whose three tendons may be permuted, that makes the task six times
//! smaller. That is a [`Reduction`].
//!
//! It holds where cameras see images of the robot as images of each other: where the base in sight is symmetric too, and
//! the cameras look from all sides. Whether they do is measured ([`Recipe::symmetries`](crate::data::Recipe::symmetries)).
//! Where they see nearly the same, as the paper's ring of 8 cameras turned by 120 degrees, the network is told which of the
//! views it is to predict.

mod reduction;
mod seen;

pub use reduction::{Reduced, Reduction};
pub use seen::{Agreement, Loss, SeenSymmetries};

use serde::{Deserialize, Serialize};

/// Whether a network learns one representative of each class of conditions that a robot's symmetries make alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SymmetryUse {
    /// Where the clouds have the symmetries.
    Auto,
    /// No: it learns every condition.
    #[default]
    None,
}

impl SymmetryUse {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Auto, Self::None];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::None => "none",
        }
    }
}
