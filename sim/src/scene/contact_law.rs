//! How hard surfaces push as they approach each other in motion, as the user writes it, and as files have it.

use serde::{Deserialize, Serialize};

use super::SceneError;

/// Longest time in which a pressed surface comes back (s).
const LONGEST: f64 = 1.0;

/// How contacts push in motion. At rest a surface gives way by its compliance under either.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    rename_all = "snake_case",
    deny_unknown_fields,
    expecting = "{ compliant = { relaxation } } or { impedance = { solref, solimp } }"
)]
pub enum ContactLaw {
    /// A spring of the obstacle's compliance `C` (m/N) beside a damper: `f = max(0, -(g + relaxation dg/dt) / C)` with the gap `g` of
    /// the undeformed surfaces at the end of the step. At rest that is what [`ContactSettler`](crate::contact::ContactSettler) finds.
    /// Friction is that of the obstacles.
    Compliant {
        /// Time in which a pressed surface comes back (s), from 0 to 1.
        #[serde(default = "relaxation")]
        relaxation: f64,
    },
    /// MuJoCo's law, without friction (`condim` 1) and without a margin, whatever the obstacles' compliance and friction. Discs of the
    /// robot do not touch each other under it.
    Impedance(Impedance),
}

impl Default for ContactLaw {
    fn default() -> Self {
        Self::Compliant {
            relaxation: relaxation(),
        }
    }
}

fn relaxation() -> f64 {
    1e-3
}

/// Parameters of MuJoCo's contacts (its documentation, Modeling: Solver parameters). The default is MuJoCo's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, expecting = "a table { solref, solimp }")]
pub struct Impedance {
    /// Time constant (s) and damping ratio, both above 0. A time constant counts as two time steps at least.
    pub solref: [f64; 2],
    /// The impedance at no overlap and at the width; the width (m); midpoint and power of the curve between. MuJoCo bounds them, and so
    /// does this.
    pub solimp: [f64; 5],
}

impl Default for Impedance {
    fn default() -> Self {
        Self {
            solref: [0.02, 1.0],
            solimp: [0.9, 0.95, 0.001, 0.5, 2.0],
        }
    }
}

impl ContactLaw {
    pub(super) fn check(self) -> Result<(), SceneError> {
        let refuse = |field, value, expected| {
            Err(SceneError::ContactLaw {
                field,
                value,
                expected,
            })
        };
        match self {
            Self::Compliant { relaxation } if !(0.0..=LONGEST).contains(&relaxation) => refuse(
                "compliant.relaxation",
                relaxation.to_string(),
                "a time from 0 to 1 s",
            ),
            Self::Impedance(Impedance { solref, .. })
                if !solref.iter().all(|x| *x > 0.0 && x.is_finite()) =>
            {
                let expected = "a time constant (s) and a damping ratio, both above 0";
                refuse("impedance.solref", format!("{solref:?}"), expected)
            }
            Self::Impedance(Impedance { solimp, .. })
                if !solimp.iter().all(|x| *x >= 0.0 && x.is_finite()) =>
            {
                let expected = "five finite numbers, none below 0";
                refuse("impedance.solimp", format!("{solimp:?}"), expected)
            }
            Self::Compliant { .. } | Self::Impedance(_) => Ok(()),
        }
    }
}
