//! What servos can do: small traits over a bus of many, and the types that they speak.
//!
//! A read of many servos gives one result each: one that does not answer costs no other's data, and no value stands for
//! "missing".

mod error;
mod faulty;
mod forward;
mod held;
mod limited;
mod logged;

use std::fmt;
use std::time::Duration;

pub use error::{Fault, ServoError};
pub use faulty::{Faulty, Odds};
pub(crate) use forward::for_those;
pub(crate) use held::locked_within;
pub use held::{Held, switch_off_all, while_all_off};
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

/// Smallest and largest radius (m) of a spool on a servo of this size, to the middle of the tendon.
pub const SPOOL_RADII: [f64; 2] = [5e-4, 0.1];

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
    /// What its watchdog does. One that has tripped holds the servo where it was, and refuses goals.
    pub watchdog: WatchdogState,
}

/// Neighbouring bytes of a servo's control table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Registers {
    /// Whose.
    pub id: ServoId,
    /// Address of the first byte.
    pub address: u16,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// One result per servo, in the order in which they were named.
pub type PerServo<T> = Vec<Result<T, ServoError>>;

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
    /// Sends goal currents (A), to all at once, and makes sure that they are held. In
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

    /// All that a servo keeps, byte by byte, in pieces without gaps. Of a servo that has no such table, nothing.
    ///
    /// # Errors
    /// [`ServoError`] where it does not answer.
    fn registers(&mut self, id: ServoId) -> Result<Vec<Registers>, ServoError>;

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
