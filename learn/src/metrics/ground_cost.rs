//! What a matching of two clouds pays for each pair.

/// Cost of moving one point to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundCost {
    /// Euclidean distance (m).
    Distance,
    /// Squared Euclidean distance (m^2).
    SquaredDistance,
}

impl GroundCost {
    /// Cost of a move over the squared distance `squared` (m^2).
    #[inline]
    pub(super) fn of_squared(self, squared: f64) -> f64 {
        match self {
            Self::Distance => squared.sqrt(),
            Self::SquaredDistance => squared,
        }
    }
}
