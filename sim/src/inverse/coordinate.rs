//! The coordinate in which an unknown is sought.

/// Maps an unknown's value to the number that the minimisation moves, and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Coordinate {
    /// `first + spread u`: of positions, angles and whatever may be 0. With `first` 0 and `spread` 1, the value itself.
    Linear { first: f64, spread: f64 },
    /// `first exp(spread u)`: of factors.
    Logarithmic { first: f64, spread: f64 },
    /// `first sinh(u)`: of sizes that range over orders of magnitude, and their effects with them. Far from its first value a
    /// stiffness acts by its logarithm, or by its inverse: this is a logarithm far above `first` and linear below, so that
    /// zero can be reached.
    Size { first: f64 },
}

impl Coordinate {
    /// The value itself.
    pub const SAME: Self = Self::Linear {
        first: 0.0,
        spread: 1.0,
    };

    /// The coordinate of a value.
    pub fn of(self, value: f64) -> f64 {
        match self {
            Self::Linear { first, spread } => (value - first) / spread,
            Self::Logarithmic { first, spread } => (value / first).ln() / spread,
            Self::Size { first } => (value / first).asinh(),
        }
    }

    /// The value at a coordinate.
    pub fn value(self, u: f64) -> f64 {
        match self {
            Self::Linear { first, spread } => first + spread * u,
            Self::Logarithmic { first, spread } => first * (spread * u).exp(),
            Self::Size { first } => first * u.sinh(),
        }
    }

    /// The value's derivative by its coordinate.
    pub fn slope(self, u: f64) -> f64 {
        match self {
            Self::Linear { spread, .. } => spread,
            Self::Logarithmic { spread, .. } => spread * self.value(u),
            Self::Size { first } => first * u.cosh(),
        }
    }
}
