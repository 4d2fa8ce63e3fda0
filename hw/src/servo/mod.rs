//! What servos can do: small traits over a bus of many, and the types that they speak.
//!
//! A read of many servos gives one result each: one that does not answer costs no other's data, and no value stands for
//! "missing".

mod faulty;
mod forward;
mod limited;
mod logged;

use std::fmt;
use std::io;
use std::time::Duration;

use thiserror::Error;

pub use faulty::{Faulty, Odds};
pub(crate) use forward::for_those;
pub use limited::{Limited, Limits};
pub use logged::{Logged, Record};

/// Address of a servo on its bus, 0 to 252.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ServoId(u8);

impl ServoId {
    /// The largest address.
    pub const MAX: u8 = 252;

    /// The servo at `id`; `None` above [`MAX`](Self::MAX).
    pub const fn new(id: u8) -> Option<Self> {
        if id <= Self::MAX {
            Some(Self(id))
        } else {
            None
        }
    }

    /// The address.
    pub const fn get(self) -> u8 {
        self.0
    }
}

impl fmt::Display for ServoId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// Angle of a servo's horn in steps of its encoder, over any number of turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticks(pub i32);

impl Ticks {
    /// Steps of a turn.
    pub const PER_TURN: i32 = 4096;

    /// The angle in radians.
    pub fn radians(self) -> f64 {
        f64::from(self.0) * std::f64::consts::TAU / f64::from(Self::PER_TURN)
    }
}

/// Whether a servo's motor is driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Torque {
    /// The horn turns freely.
    Off,
    /// The motor follows the goals.
    On,
}

/// What a servo's goals mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperatingMode {
    /// Constant current.
    Current,
    /// Constant velocity.
    Velocity,
    /// Position within one turn.
    Position,
    /// Position over several turns.
    ExtendedPosition,
    /// Position over several turns, with no more current than its goal: bounded tension.
    CurrentBasedPosition,
    /// Constant duty cycle.
    Pwm,
}

/// Faults that a servo reports of itself. It shuts its motor off for those that its shutdown setting names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HardwareErrors {
    /// Supply voltage out of its range.
    pub input_voltage: bool,
    /// Too hot inside.
    pub overheating: bool,
    /// The motor's encoder fails.
    pub encoder: bool,
    /// Electrical shock to the circuit, or not enough power for the motor.
    pub electrical_shock: bool,
    /// A load beyond the motor's for too long.
    pub overload: bool,
}

/// What a servo says that it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Model number.
    pub model: u16,
    /// Version of its firmware.
    pub firmware: u8,
}

impl HardwareErrors {
    /// Whether there is none.
    pub fn is_empty(self) -> bool {
        self == Self::default()
    }
}

impl fmt::Display for HardwareErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [
            (self.input_voltage, "supply voltage out of range"),
            (self.overheating, "overheating"),
            (self.encoder, "encoder failure"),
            (
                self.electrical_shock,
                "electrical shock or too little power",
            ),
            (self.overload, "overload"),
        ];
        let mut names = names.iter().filter(|(set, _)| *set).map(|(_, name)| *name);
        f.write_str(names.next().unwrap_or("no error"))?;
        names.try_for_each(|name| write!(f, ", {name}"))
    }
}

/// What stops a servo whose computer has gone silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WatchdogState {
    /// Nothing does.
    Off,
    /// The servo stops where it hears nothing for this long.
    Armed(Duration),
    /// It has stopped, and refuses goals until its watchdog is set again.
    Tripped,
}

/// What a servo does at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Present {
    /// Angle.
    pub position: Ticks,
    /// Angular velocity (rad/s).
    pub velocity: f64,
    /// Current of the motor (A), of the sign of its torque.
    pub current: f64,
    /// Faults that it reports. It switches its motor off for those that its shutdown setting names.
    pub errors: HardwareErrors,
}

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

/// One result per servo, in the order in which they were named.
pub type PerServo<T> = Vec<Result<T, ServoError>>;

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

/// Finds servos.
pub trait Ping {
    /// Asks a servo what it is.
    ///
    /// # Errors
    /// [`ServoError`] where it does not answer.
    fn ping(&mut self, id: ServoId) -> Result<Identity, ServoError>;

    /// All servos that answer, by their ids.
    ///
    /// # Errors
    /// [`ServoError::Line`].
    fn scan(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError> {
        let mut found = Vec::new();
        for id in (0..=ServoId::MAX).filter_map(ServoId::new) {
            match self.ping(id) {
                Ok(identity) => found.push((id, identity)),
                Err(error @ ServoError::Line { .. }) => return Err(error),
                Err(_) => {}
            }
        }
        Ok(found)
    }
}

/// Switches motors on and off.
pub trait TorqueSwitch {
    /// Switches motors, all at once, and makes sure that they are.
    fn set_torque(&mut self, ids: &[ServoId], torque: Torque) -> PerServo<()>;

    /// Whether motors are on.
    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque>;
}

/// Says what goals mean.
pub trait Modes {
    /// Sets the mode of servos whose motors are off.
    fn set_mode(&mut self, ids: &[ServoId], mode: OperatingMode) -> PerServo<()>;

    /// The modes.
    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode>;
}

/// Moves servos.
pub trait PositionGoals {
    /// Sends goals, to all at once. `Ok` says that they were sent: servos do not acknowledge them.
    fn set_goal_positions(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()>;

    /// The goals that the servos hold.
    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks>;
}

/// Bounds currents, or drives with them.
pub trait CurrentGoals {
    /// Sends goal currents (A), to all at once. `Ok` says that they were sent. In
    /// [`CurrentBasedPosition`](OperatingMode::CurrentBasedPosition) mode they bound the tension.
    fn set_goal_currents(&mut self, goals: &[(ServoId, f64)]) -> PerServo<()>;
}

/// Bounds currents for good.
pub trait CurrentLimits {
    /// Sets the currents (A) that servos never exceed, whatever the computer does. They are kept without power; motors must be
    /// off.
    fn set_current_limits(&mut self, limits: &[(ServoId, f64)]) -> PerServo<()>;

    /// These limits (A).
    fn current_limits(&mut self, ids: &[ServoId]) -> PerServo<f64>;
}

/// Reads what servos do.
pub trait PresentState {
    /// The state of each, of one moment as near as the bus allows.
    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present>;
}

/// Reads how servos fare.
pub trait Health {
    /// Temperatures inside (degrees Celsius).
    fn temperatures(&mut self, ids: &[ServoId]) -> PerServo<f64>;

    /// Supply voltages (V).
    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64>;

    /// Faults that they report.
    fn hardware_errors(&mut self, ids: &[ServoId]) -> PerServo<HardwareErrors>;

    /// Restarts a servo, which clears its faults and forgets its turns. Only for who asks for it.
    ///
    /// # Errors
    /// [`ServoError`] where it does not answer.
    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError>;
}

/// Stops servos whose computer has gone silent.
pub trait Watchdog {
    /// Servos stop where they hear nothing for this long (to the next 20 ms, 2.54 s at most); `None` for never. Either way a
    /// watchdog that has tripped is reset first.
    fn set_watchdog(&mut self, ids: &[ServoId], timeout: Option<Duration>) -> PerServo<()>;

    /// What the watchdogs do.
    fn watchdog(&mut self, ids: &[ServoId]) -> PerServo<WatchdogState>;
}

/// A bus whose servos can do all of it.
pub trait ServoBus:
    Ping
    + TorqueSwitch
    + Modes
    + PositionGoals
    + CurrentGoals
    + CurrentLimits
    + PresentState
    + Health
    + Watchdog
    + Send
{
}

impl<B> ServoBus for B where
    B: Ping
        + TorqueSwitch
        + Modes
        + PositionGoals
        + CurrentGoals
        + CurrentLimits
        + PresentState
        + Health
        + Watchdog
        + Send
        + ?Sized
{
}
