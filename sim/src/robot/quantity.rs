//! What is known of a number of a robot before its value: its name, its unit, and the values that it can have.

use std::fmt;

/// A kind of number of a robot, or of what lies between a robot and measurements of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quantity {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty for a factor or a coefficient.
    pub unit: &'static str,
    /// The values that it can have.
    pub values: Values,
}

/// The values that a number can have, from all to the fewest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Values {
    /// Any: a position, an angle, a force.
    Any,
    /// 0 and above: a stiffness that a joint may lack.
    NotNegative,
    /// Above 0: a size without which there is no robot.
    Positive,
}

impl Values {
    /// The largest number that none of the values is below.
    pub fn least(self) -> f64 {
        match self {
            Self::Any => f64::NEG_INFINITY,
            Self::NotNegative | Self::Positive => 0.0,
        }
    }

    /// Whether a finite `value` is one of them.
    pub fn contain(self, value: f64) -> bool {
        value.is_finite() && (value > self.least() || self == Self::NotNegative && value == 0.0)
    }
}

impl fmt::Display for Values {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Any => "a finite number",
            Self::NotNegative => "a finite number, 0 or above",
            Self::Positive => "a finite number above 0",
        })
    }
}
