//! What servos can do: small traits over a bus of many, and the types that they speak.
//!
//! A read of many servos gives one result each: one that does not answer costs no other's data, and no value stands for
//! "missing".

use std::fmt;
use std::io;
use std::time::Duration;

use thiserror::Error;

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

/// What a servo does at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Present {
    /// Angle.
    pub position: Ticks,
    /// Angular velocity (rad/s).
    pub velocity: f64,
    /// Current of the motor (A), of the sign of its torque.
    pub current: f64,
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
    /// The line itself failed.
    #[error("the bus of servo {id} failed: {source}")]
    Line {
        /// Whose call it was.
        id: ServoId,
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
}

/// Switches motors on and off.
pub trait TorqueSwitch {
    /// Switches motors.
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
    /// Sends goal currents (A), to all at once. `Ok` says that they were sent.
    fn set_goal_currents(&mut self, goals: &[(ServoId, f64)]) -> PerServo<()>;
}

/// Reads what servos do.
pub trait PresentState {
    /// Position, velocity and current of each, of one moment as near as the bus allows.
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
    /// Servos stop where they hear nothing for this long; `None` for never.
    fn set_watchdog(&mut self, ids: &[ServoId], timeout: Option<Duration>) -> PerServo<()>;
}

/// A bus whose servos can do all of it.
pub trait ServoBus:
    Ping + TorqueSwitch + Modes + PositionGoals + CurrentGoals + PresentState + Health + Watchdog + Send
{
}

impl<B> ServoBus for B where
    B: Ping
        + TorqueSwitch
        + Modes
        + PositionGoals
        + CurrentGoals
        + PresentState
        + Health
        + Watchdog
        + Send
{
}
