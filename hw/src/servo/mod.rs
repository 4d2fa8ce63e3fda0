//! What servos can do: one trait of a bus of many, and the types that it speaks.
//!
//! A read of many servos gives one result each: one that does not answer costs no other's data, and no value stands for
//! "missing".

mod error;
mod forward;
mod held;
mod limited;
mod logged;

use std::fmt;
use std::time::Duration;

pub use error::{Fault, ServoError};
pub(crate) use forward::for_those;
pub use held::{Held, switch_off_all, while_all_off};
pub use limited::{Limited, Limits, SharedLimits};
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

/// What servos are told, all of them at once.
#[derive(Clone, Copy, Debug)]
pub enum Setting<'a> {
    /// To switch their motors; whether they did is made sure of.
    Torque(&'a [ServoId], Torque),
    /// What goals mean, of servos whose motors are off.
    Mode(&'a [ServoId], OperatingMode),
    /// Positions to go to. `Ok` says that they were sent: servos do not acknowledge them.
    GoalPositions(&'a [(ServoId, Ticks)]),
    /// Currents (A), which are made sure of. In [`CurrentBasedPosition`](OperatingMode::CurrentBasedPosition) mode they bound the
    /// tension.
    GoalCurrents(&'a [(ServoId, f64)]),
    /// Currents (A) that servos never exceed, whatever the computer does. They are kept without power; motors must be off.
    CurrentLimits(&'a [(ServoId, f64)]),
    /// To stop where they hear nothing for this long (to the next 20 ms, 2.54 s at most); `None` for never. Either way a watchdog
    /// that has tripped is reset first.
    Watchdog(&'a [ServoId], Option<Duration>),
}

/// A bus of servos: one that it speaks with, a recording of one, or one behind another that looks after it.
pub trait ServoBus: Send {
    /// Asks a servo what it is.
    ///
    /// # Errors
    /// [`ServoError`] where it does not answer.
    fn ping(&mut self, id: ServoId) -> Result<Identity, ServoError>;

    /// All servos that answer, by their ids.
    ///
    /// # Errors
    /// [`ServoError::Line`].
    fn scan(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError>;

    /// Tells servos something.
    fn set(&mut self, setting: Setting<'_>) -> PerServo<()>;

    /// The state of each, of one moment as near as the bus allows.
    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present>;

    /// Whether motors are on.
    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque>;

    /// What goals mean.
    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode>;

    /// The goals that servos hold.
    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks>;

    /// The currents (A) that servos never exceed.
    fn current_limits(&mut self, ids: &[ServoId]) -> PerServo<f64>;

    /// What watchdogs do.
    fn watchdog(&mut self, ids: &[ServoId]) -> PerServo<WatchdogState>;

    /// Temperatures inside (degrees Celsius).
    fn temperatures(&mut self, ids: &[ServoId]) -> PerServo<f64>;

    /// Supply voltages (V).
    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64>;

    /// Faults that servos report.
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
