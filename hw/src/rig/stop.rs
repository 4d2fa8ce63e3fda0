//! What ends a motion, and what was done about it.

use std::fmt;
use std::time::Duration;

use thiserror::Error;

use crate::servo::{HardwareErrors, ServoError, ServoId, Ticks};

/// What went wrong in motion.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Cause {
    /// A servo reports faults of its hardware.
    #[error("servo {id} reports {errors}")]
    Hardware {
        /// Which one.
        id: ServoId,
        /// The faults.
        errors: HardwareErrors,
    },
    /// A servo draws too much current.
    #[error("servo {id} drew {current:.2} A for {} ms; at most {limit} A may last that long", lasting.as_millis())]
    Current {
        /// Which one.
        id: ServoId,
        /// Its current, without its sign (A).
        current: f64,
        /// What it may draw (A).
        limit: f64,
        /// How long it did.
        lasting: Duration,
    },
    /// A servo is too hot.
    #[error("servo {id} is at {temperature} degrees Celsius; it may have {limit}")]
    Heat {
        /// Which one.
        id: ServoId,
        /// Its temperature (degrees Celsius).
        temperature: f64,
        /// What it may have (degrees Celsius).
        limit: f64,
    },
    /// A servo does not come to its goal: it is blocked, or its tendon jams.
    #[error("servo {id} stood {off} ticks from its goal for {} ms: does its tendon jam?", lasting.as_millis())]
    Lag {
        /// Which one.
        id: ServoId,
        /// Distance to the goal (ticks).
        off: i32,
        /// How long it stood there.
        lasting: Duration,
    },
    /// A servo went where no goal may lie.
    #[error("servo {id} is at {} ticks from home; its limits are {low} to {high}", position.0)]
    Beyond {
        /// Which one.
        id: ServoId,
        /// Where it is, from home.
        position: Ticks,
        /// Smallest position (ticks).
        low: i32,
        /// Largest position (ticks).
        high: i32,
    },
    /// A servo's count jumped: it restarted.
    #[error(
        "servo {id} went from {} to {} ticks in an instant: it lost its power, and with it its turns",
        before.0, now.0
    )]
    Jump {
        /// Which one.
        id: ServoId,
        /// Where it was, from home.
        before: Ticks,
        /// Where it says to be.
        now: Ticks,
    },
    /// A servo's watchdog has stopped it: it holds its place and takes no goals.
    #[error(
        "the watchdog of servo {id} stopped it: {}",
        silence(*.silent, *.allowed)
    )]
    Watchdog {
        /// Which one.
        id: ServoId,
        /// How long nothing was said on the bus, at the longest, since the servos were last seen in order.
        silent: Duration,
        /// How long a servo may hear nothing.
        allowed: Duration,
    },
    /// A servo does not hold the goal that it was told, however often.
    #[error(
        "servo {id} holds the goal of {} ticks from home where it was told {}, {times} times",
        held.0, goal.0
    )]
    Goal {
        /// Which one.
        id: ServoId,
        /// Its goal, from home.
        goal: Ticks,
        /// What it holds in its place.
        held: Ticks,
        /// How often it was told.
        times: usize,
    },
    /// A servo was not to be told its goal.
    #[error("servo {id} did not take its goal: {source}")]
    Refused {
        /// Which one.
        id: ServoId,
        /// Why.
        source: ServoError,
    },
    /// A servo's motor is off that should be on.
    #[error("the motor of servo {id} went off by itself: it restarted, or shut down")]
    Off {
        /// Which one.
        id: ServoId,
    },
    /// A servo restarted.
    #[error("servo {id} restarted and forgot its turns: did it lose its power?")]
    Restarted {
        /// Which one.
        id: ServoId,
    },
    /// A servo says nothing of use any more.
    #[error("servo {id} was lost: {reads} reads in a row failed, the last because {source}")]
    Lost {
        /// Which one.
        id: ServoId,
        /// How many reads failed.
        reads: usize,
        /// Why the last one did.
        source: ServoError,
    },
}

/// How long the bus was silent, against what is allowed.
fn silence(silent: Duration, allowed: Duration) -> String {
    let [longest, most] = [silent, allowed].map(|time| time.as_millis());
    match silent >= allowed {
        true => format!("the bus was silent for {longest} ms, and safety.watchdog is {most} ms"),
        false => format!(
            "it heard nothing for the {most} ms of safety.watchdog, though the bus was silent for {longest} ms at the most: is its \
             cable loose?"
        ),
    }
}

impl Cause {
    /// What an error of a servo says at once, without being repeated, on a bus that was silent for so long at the most.
    pub(super) fn of(error: &ServoError, [silent, allowed]: [Duration; 2]) -> Option<Self> {
        match *error {
            ServoError::Hardware { id, errors } => Some(Self::Hardware { id, errors }),
            ServoError::WatchdogTripped { id } => Some(Self::Watchdog {
                id,
                silent,
                allowed,
            }),
            ServoError::Restarted { id } => Some(Self::Restarted { id }),
            _ => None,
        }
    }

    /// Whether it is what a servo does that was without power for a moment.
    pub fn may_be_restart(&self) -> bool {
        matches!(
            self,
            Self::Restarted { .. } | Self::Jump { .. } | Self::Off { .. } | Self::Lost { .. }
        )
    }

    /// The servo that it happened to.
    pub fn id(&self) -> ServoId {
        match *self {
            Self::Hardware { id, .. }
            | Self::Current { id, .. }
            | Self::Heat { id, .. }
            | Self::Lag { id, .. }
            | Self::Beyond { id, .. }
            | Self::Jump { id, .. }
            | Self::Watchdog { id, .. }
            | Self::Goal { id, .. }
            | Self::Refused { id, .. }
            | Self::Off { id }
            | Self::Restarted { id }
            | Self::Lost { id, .. } => id,
        }
    }
}

/// What went wrong in motion, and whether the tension was released.
#[derive(Debug, Error)]
#[error("{cause}; {release}")]
pub struct EmergencyStop {
    /// What went wrong.
    pub cause: Cause,
    /// What was done about it.
    pub release: Released,
}

/// How a release of tension went.
#[derive(Debug, Default)]
pub struct Released {
    /// Servos that confirmed that their motors are off.
    pub off: Vec<ServoId>,
    /// Servos that did not, and why. Their own watchdog stops them, and their current limit bounds what they pull with.
    pub unknown: Vec<(ServoId, ServoError)>,
}

impl Released {
    /// Whether every servo confirmed.
    pub fn is_complete(&self) -> bool {
        self.unknown.is_empty()
    }
}

impl fmt::Display for Released {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.unknown.is_empty() {
            return f.write_str("all motors were switched off");
        }
        write!(f, "{} motors were switched off", self.off.len())?;
        for (id, error) in &self.unknown {
            write!(
                f,
                "; servo {id} did not confirm ({error}), so its own watchdog is to stop it"
            )?;
        }
        Ok(())
    }
}
