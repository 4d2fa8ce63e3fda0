//! What servos are told, now and when a log was made.

use std::fmt;

use crate::log::{Goal, LogRecord, ServoStatus};
use crate::servo::{OperatingMode, ServoId, Ticks, Torque, WatchdogState};

/// The last that a log said of a servo.
pub(super) struct Known {
    pub status: ServoStatus,
    pub goal: Goal,
}

/// Something that a servo is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ServoCommand {
    /// A goal of its position.
    Position(Ticks),
    /// A goal of its current (A).
    Current(f64),
    /// A limit of its current (A).
    CurrentLimit(f64),
    /// To switch its motor.
    Torque(Torque),
    /// What its goals mean.
    Mode(OperatingMode),
    /// What its watchdog does.
    Watchdog(WatchdogState),
}

impl ServoCommand {
    /// The command of the same kind that `record` has for servo `id`.
    pub(super) fn logged(&self, record: &LogRecord, id: ServoId) -> Option<Self> {
        match record {
            LogRecord::Goals(goals) => {
                let (_, goal) = goals.iter().find(|(other, _)| *other == id)?;
                match self {
                    Self::Position(_) => goal.position.map(Self::Position),
                    Self::Current(_) => goal.current.map(Self::Current),
                    _ => None,
                }
            }
            LogRecord::Status(servos) => {
                let status = servos.iter().find(|status| status.id == id)?;
                match self {
                    Self::CurrentLimit(_) => status.current_limit.map(Self::CurrentLimit),
                    Self::Torque(_) => status.torque.map(Self::Torque),
                    Self::Mode(_) => status.mode.map(Self::Mode),
                    Self::Watchdog(_) => status.watchdog.map(Self::Watchdog),
                    _ => None,
                }
            }
            _ => None,
        }
    }
}

impl ServoCommand {
    /// The command of the same kind that would change nothing, as far as `servo` is known.
    pub(super) fn known(&self, servo: &Known) -> Option<Self> {
        let Known { status, goal } = servo;
        match self {
            Self::Position(_) => goal.position.map(Self::Position),
            Self::Current(_) => goal.current.map(Self::Current),
            Self::CurrentLimit(_) => status.current_limit.map(Self::CurrentLimit),
            Self::Torque(_) => status.torque.map(Self::Torque),
            Self::Mode(_) => status.mode.map(Self::Mode),
            Self::Watchdog(_) => status.watchdog.map(Self::Watchdog),
        }
    }
}

impl fmt::Display for ServoCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Position(Ticks(ticks)) => write!(f, "to go to tick {ticks}"),
            Self::Current(current) => write!(f, "to use {current} A"),
            Self::CurrentLimit(limit) => write!(f, "never to use more than {limit} A"),
            Self::Torque(Torque::Off) => write!(f, "to switch its motor off"),
            Self::Torque(Torque::On) => write!(f, "to switch its motor on"),
            Self::Mode(mode) => write!(f, "to take goals as {mode:?}"),
            Self::Watchdog(WatchdogState::Armed(timeout)) => {
                write!(f, "to stop after {} s of silence", timeout.as_secs_f64())
            }
            Self::Watchdog(state) => write!(f, "to have its watchdog {state:?}"),
        }
    }
}
