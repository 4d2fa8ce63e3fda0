//! What goes wrong with servos.

use std::io;
use std::time::Duration;

use thiserror::Error;

use super::{HardwareErrors, ServoId};

/// Why a servo did not carry an instruction out, in its own words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Fault {
    /// It failed.
    #[error("it failed to carry that out")]
    Result,
    /// It knows no such instruction, or was told to act without anything registered.
    #[error("it does not know the instruction, or has nothing registered to act on")]
    Instruction,
    /// The instruction arrived damaged.
    #[error("the instruction arrived damaged")]
    Crc,
    /// The value is out of the item's range, or the watchdog has tripped.
    #[error("the value is out of range, or its watchdog has tripped")]
    DataRange,
    /// The data are shorter than the item.
    #[error("the data are shorter than the item")]
    DataLength,
    /// The value is beyond a limit that is set.
    #[error("the value is beyond a limit that it holds")]
    DataLimit,
    /// The item cannot be read or written, or not while the motor is on.
    #[error(
        "the item is read only or unknown, or locked while torque is on: switch torque off first"
    )]
    Access,
    /// A number that the protocol does not define.
    #[error("error {0}, which its protocol does not define")]
    Other(u8),
}

impl ServoError {
    /// Whether the same may go well another time: bytes were lost or damaged, or come from somebody else.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::NoAnswer { .. } | Self::Damaged { .. } | Self::WrongLength { .. } => true,
            Self::Refused { fault, .. } => *fault == Fault::Crc,
            _ => false,
        }
    }
}

/// Why a servo did not do what it was told, or said nothing of use.
#[derive(Debug, Error)]
pub enum ServoError {
    /// Nothing came from it in time.
    #[error("servo {id} did not answer within {} ms: is it wired, powered, and at this baud rate?", waited.as_millis())]
    NoAnswer {
        /// Which one.
        id: ServoId,
        /// How long.
        waited: Duration,
    },
    /// Bytes came, and none of them were an answer of it.
    #[error(
        "what servo {id} answered arrived damaged: check the cables and the baud rate, and that no other servo has this id"
    )]
    Damaged {
        /// Which one.
        id: ServoId,
    },
    /// It answered with another number of bytes than were asked for.
    #[error(
        "servo {id} answered {found} bytes where {expected} were asked for: does another program use the bus?"
    )]
    WrongLength {
        /// Which one.
        id: ServoId,
        /// Asked for.
        expected: usize,
        /// Answered.
        found: usize,
    },
    /// It refused.
    #[error("servo {id} refused to {action}: {fault}")]
    Refused {
        /// Which one.
        id: ServoId,
        /// What it was told.
        action: String,
        /// Why.
        fault: Fault,
    },
    /// It reports faults that keep its motor off.
    #[error("servo {id} reports {errors}: find the cause, then reboot it")]
    Hardware {
        /// Which one.
        id: ServoId,
        /// The faults.
        errors: HardwareErrors,
    },
    /// Its watchdog has tripped.
    #[error(
        "the watchdog of servo {id} has stopped it, and goals are refused: set the watchdog again"
    )]
    WatchdogTripped {
        /// Which one.
        id: ServoId,
    },
    /// It has been without power: it counts turns from 0 again, and its motor is off.
    #[error(
        "servo {id} has restarted and forgotten its turns: check the power supply, then home it"
    )]
    Restarted {
        /// Which one.
        id: ServoId,
    },
    /// The number that it calls its model is none that is known.
    #[error("servo {id} is of model {model}, which is not supported")]
    UnknownModel {
        /// Which one.
        id: ServoId,
        /// The number.
        model: u16,
    },
    /// It was told something that it does not support, or that its limits forbid. Nothing was sent.
    #[error("servo {id}: {quantity} {value} is not within {min} to {max}")]
    OutOfRange {
        /// Which one.
        id: ServoId,
        /// What and in which unit.
        quantity: &'static str,
        /// What it was told.
        value: f64,
        /// The least allowed.
        min: f64,
        /// The most allowed.
        max: f64,
    },
    /// It was told something that changes it for good. Nothing was sent.
    #[error("{action} of servo {id} was not asked for: allow it in the settings of the bus")]
    Forbidden {
        /// Which one.
        id: ServoId,
        /// What it was told.
        action: &'static str,
    },
    /// Nothing is known of it.
    #[error("servo {id} is not one of those that this bus was set up for")]
    Unknown {
        /// Which one.
        id: ServoId,
    },
    /// The line itself failed.
    #[error("the bus failed: {source}")]
    Line {
        /// The device's error.
        source: io::Error,
    },
}
