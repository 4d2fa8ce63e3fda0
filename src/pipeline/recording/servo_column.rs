//! The column of a servo.

use serde::{Deserialize, Serialize};

/// The column of a servo, and what lies between the servo and its tendon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoColumn {
    /// Its name.
    pub column: String,
    /// Its unit.
    pub unit: PullUnit,
    /// Whether positive values pull the tendon (1) or let it go (-1).
    #[serde(default = "one")]
    pub sign: f64,
    /// Value at which the tendon is not pulled, in the column's unit.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub zero: f64,
    /// Radius of the spool (m), for angles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spool_radius: Option<f64>,
    /// Pull of the tendon by what the column says.
    #[serde(default = "one")]
    pub gain: f64,
    /// Pull where the column says `zero` (m, or N).
    #[serde(default)]
    pub offset: f64,
    /// Half the play (m, or N).
    #[serde(default)]
    pub backlash: f64,
}

/// Units of what servos report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PullUnit {
    /// Metres of tendon.
    M,
    /// Centimetres.
    Cm,
    /// Millimetres.
    Mm,
    /// Micrometres.
    Um,
    /// Radians of a spool, which has a `spool_radius`.
    Rad,
    /// Degrees of a spool.
    Deg,
    /// Newtons, of a tendon driven by tension.
    #[serde(rename = "N")]
    N,
}

impl PullUnit {
    /// The unit in metres, for lengths.
    pub(super) fn metres(self) -> Option<f64> {
        match self {
            Self::M => Some(1.0),
            Self::Cm => Some(1e-2),
            Self::Mm => Some(1e-3),
            Self::Um => Some(1e-6),
            Self::Rad | Self::Deg | Self::N => None,
        }
    }
}

impl ServoColumn {
    /// The pull that a value of the column is (m, or N).
    pub(super) fn pull(&self, value: f64) -> f64 {
        let unit = match (self.unit, self.spool_radius) {
            (PullUnit::Rad, Some(radius)) => radius,
            (PullUnit::Deg, Some(radius)) => radius.to_radians(),
            (unit, _) => unit.metres().unwrap_or(1.0),
        };
        self.sign * unit * (value - self.zero)
    }

    pub(super) fn check(&self, place: usize) -> Result<(), String> {
        let at = |what: &str| format!("servos[{place}] ({}): {what}", self.column);
        let angle = matches!(self.unit, PullUnit::Rad | PullUnit::Deg);
        if self.sign.abs() != 1.0 {
            return Err(at(
                "`sign` is 1 where positive values pull, -1 where they let go",
            ));
        }
        match (angle, self.spool_radius) {
            (true, None) => return Err(at("an angle needs the `spool_radius` (m)")),
            (false, Some(_)) => return Err(at("`spool_radius` is for the units rad and deg")),
            (true, Some(radius)) if !(radius > 0.0 && radius.is_finite()) => {
                return Err(at("`spool_radius` is a length above 0"));
            }
            _ => {}
        }
        let numbers = [self.zero, self.gain, self.offset, self.backlash];
        if numbers.iter().any(|x| !x.is_finite()) || self.gain <= 0.0 || self.backlash < 0.0 {
            return Err(at(
                "expected finite numbers, `gain` above 0, `backlash` 0 or above",
            ));
        }
        Ok(())
    }
}

fn one() -> f64 {
    1.0
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}
