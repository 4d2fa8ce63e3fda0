//! What the points of a cloud consist of.

use serde::{Deserialize, Serialize};

/// Spatial dimension of a point.
pub const DIM: usize = 3;

/// What a point of a cloud consists of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Channels {
    /// A position.
    #[default]
    Xyz,
    /// A position and a colour, each channel in [0, 1].
    XyzRgb,
}

impl Channels {
    /// Numbers per point `C`: 3 or 6, the position first.
    pub const fn count(self) -> usize {
        match self {
            Self::Xyz => DIM,
            Self::XyzRgb => DIM + 3,
        }
    }
}
