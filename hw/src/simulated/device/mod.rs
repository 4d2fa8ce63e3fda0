//! One servo: control table, controllers, motor; what it does with instructions.

mod control;
mod instructions;
mod memory;

use std::time::Duration;

use control::{Controller, FULL, Measured, TICKS};
use memory::{Memory, TRIPPED, mode};

use super::motor::{Drive, Motor, MotorData};
use crate::dynamixel::{Area, BAUD_RATES, ErrorByte, Fault as Refusal, Instruction, Item, Model};
use crate::servo::{ServoId, Ticks};

/// Control period (s).
pub(super) const PERIOD: f64 = 1e-3;
/// Time from power-on, or a reboot, to the first answer.
const BOOT_TIME: Duration = Duration::from_millis(300);
/// Unit of "Bus Watchdog".
const WATCHDOG_UNIT: Duration = Duration::from_millis(20);
/// Distance from the goal at which "Moving Status" says that it was reached (ticks).
const IN_POSITION: f64 = 10.0;
/// Distance from the trajectory above which "Moving Status" says that it is not followed (ticks).
const FOLLOWING_ERROR: f64 = 100.0;
/// The first firmware with fast reads and backups.
const FAST_FIRMWARE: i64 = 46;

/// Bits of "Hardware Error Status" and "Shutdown".
const INPUT_VOLTAGE: i64 = 1 << 0;
const OVERHEATING: i64 = 1 << 2;
const OVERLOAD: i64 = 1 << 5;

/// Data sheets: ROBOTIS e-Manual, "Specifications" of the three models.
fn data_sheet(model: Model) -> MotorData {
    let [voltage, stall_torque, stall_current, no_load_speed] = match model {
        Model::Xl330M288 => [5.0, 0.52, 1.47, 103.0],
        Model::Xc330M288 => [5.0, 0.93, 1.80, 81.0],
        Model::Xc330T288 => [11.1, 0.92, 0.80, 65.0],
    };
    MotorData {
        voltage,
        stall_torque,
        stall_current,
        no_load_speed,
    }
}

/// Whether a servo runs.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Power {
    On,
    Booting { until: Duration },
}

/// A simulated servo.
#[derive(Clone, Debug)]
pub(super) struct Device {
    memory: Memory,
    backup: Option<Memory>,
    registered: Option<(u16, Vec<u8>)>,
    pub motor: Motor,
    controller: Controller,
    /// Ticks of the whole turns that the servo does not know of.
    forgotten: i64,
    power: Power,
    /// When it last booted, and when it last heard an instruction.
    booted: Duration,
    heard: Duration,
    /// Whether its data line is plugged in.
    pub connected: bool,
}

impl Device {
    /// A servo as from the factory but for its id and the index of its baud rate; it has run for long, torque off, and its
    /// horn stands at `horn` (ticks of the first power-on).
    pub fn new(model: Model, firmware: u8, id: ServoId, baud_index: usize, horn: Ticks) -> Self {
        let mut memory = Memory::new(model, firmware);
        memory.set(Item::Id, id.get().into());
        memory.set(Item::BaudRate, baud_index as i64);
        // In the middle of a tick, so that rounding does not matter.
        let angle = (f64::from(horn.0) + 0.5) / TICKS;
        let mut device = Self {
            memory,
            backup: None,
            registered: None,
            motor: Motor::new(data_sheet(model), angle),
            controller: Controller::at(0),
            forgotten: 0,
            power: Power::On,
            booted: Duration::ZERO,
            heard: Duration::ZERO,
            connected: true,
        };
        device.start(Duration::ZERO);
        device
    }

    /// Its id.
    pub fn id(&self) -> u8 {
        self.memory.get(Item::Id) as u8
    }

    /// Whether instructions to `id` are also for this servo, which then does not answer.
    pub fn shadows(&self, id: ServoId) -> bool {
        self.memory.get(Item::SecondaryId) == i64::from(id.get()) && self.id() != id.get()
    }

    /// Bits per second that it listens to and talks with.
    pub fn baud_rate(&self) -> u32 {
        let index = usize::try_from(self.memory.get(Item::BaudRate)).ok();
        index
            .and_then(|index| BAUD_RATES.get(index).copied())
            .unwrap_or(BAUD_RATES[1])
    }

    /// Whether it takes part in a conversation at this baud rate.
    pub fn listens(&self, baud_rate: u32) -> bool {
        self.connected && self.power == Power::On && self.baud_rate() == baud_rate
    }

    /// Time from an instruction to its answer.
    pub fn return_delay(&self) -> Duration {
        Duration::from_secs_f64(self.memory.quantity(Item::ReturnDelayTime).max(0.0))
    }

    /// Whether it answers an instruction at its status return level.
    pub fn answers(&self, instruction: &Instruction<'_>) -> bool {
        let least = match instruction {
            Instruction::Ping => 0,
            Instruction::Read { .. }
            | Instruction::SyncRead { .. }
            | Instruction::BulkRead { .. } => 1,
            _ => 2,
        };
        self.answers_from(least)
    }

    /// Whether it answers what is no instruction that it knows.
    pub fn answers_from(&self, level: i64) -> bool {
        self.memory.get(Item::StatusReturnLevel) >= level
    }

    /// Whether its firmware knows fast reads.
    pub fn is_fast(&self) -> bool {
        self.memory.get(Item::FirmwareVersion) >= FAST_FIRMWARE
    }

    /// The error byte for an outcome.
    pub fn error_byte(&self, refusal: Option<Refusal>) -> ErrorByte {
        ErrorByte::new(refusal, self.memory.get(Item::HardwareErrorStatus) != 0)
    }

    /// Temperature (degrees Celsius) above which it is too hot.
    pub fn temperature_limit(&self) -> f64 {
        self.memory.quantity(Item::TemperatureLimit)
    }

    /// Angle of the horn since the first power-on (ticks).
    pub fn horn(&self) -> f64 {
        self.motor.angle * TICKS
    }

    /// Hears an instruction, for whomever it is.
    pub fn hear(&mut self, now: Duration) {
        self.heard = now;
    }

    /// Takes the power away and gives it back: turns, goals and faults are forgotten.
    pub fn restart(&mut self, now: Duration) {
        self.power = Power::Booting {
            until: now + BOOT_TIME,
        };
    }

    /// Reports an overload, and shuts down for it where its shutdown setting says so.
    pub fn fail_with_overload(&mut self) {
        self.fail(OVERLOAD);
    }

    /// Goes on by a control period, at whose end it is `now`, under the torque `load` about its horn (N m).
    pub fn step(&mut self, now: Duration, load: f64) {
        match self.power {
            Power::Booting { until } if now >= until => self.start(now),
            Power::Booting { .. } => {}
            Power::On => self.watch(now),
        }
        let drive = if self.is_driven() {
            let drive = self
                .controller
                .period(PERIOD, &self.memory, &self.measured());
            let sign = self.sign();
            match drive {
                Drive::Off => Drive::Off,
                Drive::Current(current) => Drive::Current(sign * current),
                Drive::Duty {
                    duty,
                    current_limit,
                } => Drive::Duty {
                    duty: sign * duty,
                    current_limit,
                },
            }
        } else {
            Drive::Off
        };
        self.motor.step(PERIOD, drive, load);
    }

    /// After the boot: RAM has its first values, and of the position only the angle within a turn is known.
    fn start(&mut self, now: Duration) {
        self.memory.restore(Area::Ram);
        let startup = self.memory.get(Item::StartupConfiguration);
        if let Some(backup) = self.backup.as_ref().filter(|_| startup & 0x02 != 0) {
            let stored = backup.area(Area::Ram).to_vec();
            self.memory.set_area(Area::Ram, &stored);
        }
        self.registered = None;
        for item in [
            Item::RegisteredInstruction,
            Item::HardwareErrorStatus,
            Item::TorqueEnable,
        ] {
            self.memory.set(item, 0);
        }
        self.forget_turns();
        self.reset_goals();
        self.motor.rest();
        (self.power, self.booted, self.heard) = (Power::On, now, now);
        if startup & 0x01 != 0 {
            self.switch_on();
        }
    }

    /// Goals that move nothing, and bounds at their limits.
    fn reset_goals(&mut self) {
        let operating = self.memory.get(Item::OperatingMode);
        let limit = |item, none_in| match operating == none_in {
            true => 0,
            false => self.memory.get(item),
        };
        let pwm = limit(Item::PwmLimit, mode::PWM);
        let current = limit(Item::CurrentLimit, mode::CURRENT);
        let position = self.position();
        for (item, value) in [
            (Item::GoalPwm, pwm),
            (Item::GoalCurrent, current),
            (Item::GoalVelocity, 0),
            (Item::GoalPosition, position),
        ] {
            self.memory.set(item, value);
        }
    }

    /// Begins to follow the goals, from where it is. The goal position is the one in the register: what has turned since it
    /// was set is turned back.
    fn switch_on(&mut self) {
        self.memory.set(Item::TorqueEnable, 1);
        self.controller = Controller::at(self.position());
        self.controller.begin(&self.memory);
    }

    /// Bus watchdog and the sensors of faults.
    fn watch(&mut self, now: Duration) {
        let watchdog = self.memory.get(Item::BusWatchdog);
        if let Ok(units @ 1..) = u32::try_from(watchdog)
            && self.is_driven()
            && now.saturating_sub(self.heard) > WATCHDOG_UNIT * units
        {
            self.memory.set(Item::BusWatchdog, TRIPPED);
            self.memory.set(Item::GoalPosition, self.position());
            self.memory.set(Item::GoalVelocity, 0);
            match self.memory.get(Item::OperatingMode) {
                mode::PWM => self.memory.set(Item::GoalPwm, 0),
                mode::CURRENT => self.memory.set(Item::GoalCurrent, 0),
                _ => {}
            }
            self.controller = Controller::at(self.position());
        }
        let voltage = self.motor.voltage();
        let [low, high] =
            [Item::MinVoltageLimit, Item::MaxVoltageLimit].map(|item| self.memory.quantity(item));
        if !(low..=high).contains(&voltage) {
            self.fail(INPUT_VOLTAGE);
        }
        if self.motor.temperature >= self.memory.quantity(Item::TemperatureLimit) {
            self.fail(OVERHEATING);
        }
        if self.motor.is_overloaded() {
            self.fail(OVERLOAD);
        }
    }

    fn fail(&mut self, error: i64) {
        let errors = self.memory.get(Item::HardwareErrorStatus) | error;
        self.memory.set(Item::HardwareErrorStatus, errors);
        if self.is_shut_down() {
            self.memory.set(Item::TorqueEnable, 0);
        }
    }

    fn is_shut_down(&self) -> bool {
        self.memory.get(Item::HardwareErrorStatus) & self.memory.get(Item::Shutdown) != 0
    }

    fn is_driven(&self) -> bool {
        self.power == Power::On && self.memory.get(Item::TorqueEnable) != 0
    }

    /// Whether the horn turns faster than "Moving Threshold".
    fn is_turning(&self) -> bool {
        self.motor.velocity.abs() > self.memory.quantity(Item::MovingThreshold)
    }

    /// Direction of the registers against that of the horn.
    fn sign(&self) -> f64 {
        match self.memory.get(Item::DriveMode) & 0x01 {
            0 => 1.0,
            _ => -1.0,
        }
    }

    /// Steps of the encoder since the first power-on, in the direction of the registers.
    fn count(&self) -> i64 {
        (self.sign() * self.motor.angle * TICKS).floor() as i64
    }

    fn forget_turns(&mut self) {
        let turn = i64::from(Ticks::PER_TURN);
        self.forgotten = self.count().div_euclid(turn) * turn;
    }

    /// What "Present Position" says.
    fn position(&self) -> i64 {
        let turn = i64::from(Ticks::PER_TURN);
        let offset = self.memory.get(Item::HomingOffset);
        match self.memory.get(Item::OperatingMode) {
            mode::POSITION => {
                // Within one turn only small offsets are valid.
                let offset = if offset.abs() <= turn / 4 { offset } else { 0 };
                self.count().rem_euclid(turn) + offset
            }
            _ => self.count() - self.forgotten + offset,
        }
    }

    fn measured(&self) -> Measured {
        Measured {
            position: self.position(),
            velocity: self.sign() * self.motor.velocity * TICKS,
            voltage: self.motor.voltage(),
        }
    }

    /// Writes what it measures into the table.
    fn publish(&mut self, now: Duration) {
        let sign = self.sign();
        let measured = self.measured();
        let trajectory = self.controller.trajectory;
        let profile_runs = self.is_driven() && self.controller.is_moving(&self.memory);
        let goal = self.memory.get(Item::GoalPosition);
        let arrived = ((goal - measured.position) as f64).abs() <= IN_POSITION;
        let behind = (trajectory.position - measured.position as f64).abs() > FOLLOWING_ERROR;
        let status = i64::from(arrived)
            | i64::from(profile_runs) << 1
            | i64::from(self.is_driven() && behind) << 3
            | i64::from(profile_runs) << 4;
        let tick = now.saturating_sub(self.booted).as_millis() % 32_768;
        let memory = &mut self.memory;
        for (item, value) in [
            (Item::RealtimeTick, tick as i64),
            (Item::Moving, i64::from(profile_runs)),
            (Item::MovingStatus, status),
            (Item::PresentPosition, measured.position),
            (Item::PositionTrajectory, trajectory.position.round() as i64),
            (Item::BackupReady, i64::from(self.backup.is_some())),
            (
                Item::PresentPwm,
                (sign * self.motor.duty * FULL).round() as i64,
            ),
        ] {
            memory.set(item, value);
        }
        for (item, quantity) in [
            (Item::PresentCurrent, sign * self.motor.current),
            (Item::PresentVelocity, sign * self.motor.velocity),
            (Item::VelocityTrajectory, trajectory.velocity / TICKS),
            (Item::PresentInputVoltage, self.motor.voltage()),
            (Item::PresentTemperature, self.motor.temperature),
        ] {
            memory.set_quantity(item, quantity);
        }
        if self.is_turning() {
            self.memory.set(Item::Moving, 1);
        }
    }
}
