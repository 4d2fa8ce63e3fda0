//! What a bus was told and what it said, to a sink.

use std::sync::Arc;
use std::time::Duration;

use super::{
    CurrentGoals, CurrentLimits, HardwareErrors, Health, Identity, Modes, OperatingMode, PerServo,
    Ping, PositionGoals, Present, PresentState, Registers, ServoError, ServoId, Ticks, Torque,
    TorqueSwitch, Watchdog, WatchdogState,
};
use crate::clock::Clock;

/// A call and its results.
#[derive(Clone, Copy, Debug)]
pub enum Record<'a> {
    /// Goals of positions, and whether they were sent.
    GoalPositions(&'a [(ServoId, Ticks)], &'a PerServo<()>),
    /// Goals of currents (A), and whether they were sent.
    GoalCurrents(&'a [(ServoId, f64)], &'a PerServo<()>),
    /// Limits of currents (A).
    CurrentLimits(&'a [(ServoId, f64)], &'a PerServo<()>),
    /// Motors switched.
    Torque(&'a [ServoId], Torque, &'a PerServo<()>),
    /// Modes set.
    Mode(&'a [ServoId], OperatingMode, &'a PerServo<()>),
    /// A watchdog set.
    Watchdog(&'a [ServoId], Option<Duration>, &'a PerServo<()>),
    /// A restart.
    Reboot(ServoId, &'a Result<(), ServoError>),
    /// A reading.
    Present(&'a [ServoId], &'a PerServo<Present>),
    /// A servo asked what it is.
    Ping(ServoId, &'a Result<Identity, ServoError>),
    /// All servos that answered.
    Scan(&'a [(ServoId, Identity)]),
    /// Motors looked at.
    TorqueRead(&'a [ServoId], &'a PerServo<Torque>),
    /// Modes looked at.
    ModeRead(&'a [ServoId], &'a PerServo<OperatingMode>),
    /// Goals looked at.
    GoalPositionsRead(&'a [ServoId], &'a PerServo<Ticks>),
    /// Limits of currents (A) looked at.
    CurrentLimitsRead(&'a [ServoId], &'a PerServo<f64>),
    /// Temperatures (degrees Celsius).
    Temperatures(&'a [ServoId], &'a PerServo<f64>),
    /// Supply voltages (V).
    Voltages(&'a [ServoId], &'a PerServo<f64>),
    /// Bytes of a control table.
    Registers(ServoId, &'a Result<Vec<Registers>, ServoError>),
    /// Faults looked at.
    HardwareErrors(&'a [ServoId], &'a PerServo<HardwareErrors>),
    /// Watchdogs looked at.
    WatchdogRead(&'a [ServoId], &'a PerServo<WatchdogState>),
}

/// A bus that tells a sink of each goal, setting and reading, with the time at which the call returned.
#[derive(Clone, Debug)]
pub struct Logged<B, S> {
    bus: B,
    clock: Arc<dyn Clock>,
    sink: S,
}

impl<B, S: FnMut(Duration, Record<'_>)> Logged<B, S> {
    /// A bus whose calls `sink` is told of.
    pub fn new(bus: B, clock: Arc<dyn Clock>, sink: S) -> Self {
        Self { bus, clock, sink }
    }

    /// The bus and the sink.
    pub fn into_parts(self) -> (B, S) {
        (self.bus, self.sink)
    }
}

impl<B: Ping, S: FnMut(Duration, Record<'_>)> Ping for Logged<B, S> {
    fn ping(&mut self, id: ServoId) -> Result<Identity, ServoError> {
        let result = self.bus.ping(id);
        (self.sink)(self.clock.now(), Record::Ping(id, &result));
        result
    }

    fn scan(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError> {
        let found = self.bus.scan()?;
        (self.sink)(self.clock.now(), Record::Scan(&found));
        Ok(found)
    }
}

impl<B: TorqueSwitch, S: FnMut(Duration, Record<'_>)> TorqueSwitch for Logged<B, S> {
    fn set_torque(&mut self, ids: &[ServoId], torque: Torque) -> PerServo<()> {
        let results = self.bus.set_torque(ids, torque);
        (self.sink)(self.clock.now(), Record::Torque(ids, torque, &results));
        results
    }

    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque> {
        let results = self.bus.torque(ids);
        (self.sink)(self.clock.now(), Record::TorqueRead(ids, &results));
        results
    }
}

impl<B: Modes, S: FnMut(Duration, Record<'_>)> Modes for Logged<B, S> {
    fn set_mode(&mut self, ids: &[ServoId], mode: OperatingMode) -> PerServo<()> {
        let results = self.bus.set_mode(ids, mode);
        (self.sink)(self.clock.now(), Record::Mode(ids, mode, &results));
        results
    }

    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode> {
        let results = self.bus.mode(ids);
        (self.sink)(self.clock.now(), Record::ModeRead(ids, &results));
        results
    }
}

impl<B: PositionGoals, S: FnMut(Duration, Record<'_>)> PositionGoals for Logged<B, S> {
    fn set_goal_positions(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()> {
        let results = self.bus.set_goal_positions(goals);
        (self.sink)(self.clock.now(), Record::GoalPositions(goals, &results));
        results
    }

    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks> {
        let results = self.bus.goal_positions(ids);
        (self.sink)(self.clock.now(), Record::GoalPositionsRead(ids, &results));
        results
    }
}

impl<B: CurrentGoals, S: FnMut(Duration, Record<'_>)> CurrentGoals for Logged<B, S> {
    fn set_goal_currents(&mut self, goals: &[(ServoId, f64)]) -> PerServo<()> {
        let results = self.bus.set_goal_currents(goals);
        (self.sink)(self.clock.now(), Record::GoalCurrents(goals, &results));
        results
    }
}

impl<B: CurrentLimits, S: FnMut(Duration, Record<'_>)> CurrentLimits for Logged<B, S> {
    fn set_current_limits(&mut self, limits: &[(ServoId, f64)]) -> PerServo<()> {
        let results = self.bus.set_current_limits(limits);
        (self.sink)(self.clock.now(), Record::CurrentLimits(limits, &results));
        results
    }

    fn current_limits(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let results = self.bus.current_limits(ids);
        (self.sink)(self.clock.now(), Record::CurrentLimitsRead(ids, &results));
        results
    }
}

impl<B: PresentState, S: FnMut(Duration, Record<'_>)> PresentState for Logged<B, S> {
    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present> {
        let results = self.bus.present(ids);
        (self.sink)(self.clock.now(), Record::Present(ids, &results));
        results
    }
}

impl<B: Health, S: FnMut(Duration, Record<'_>)> Health for Logged<B, S> {
    fn temperatures(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let results = self.bus.temperatures(ids);
        (self.sink)(self.clock.now(), Record::Temperatures(ids, &results));
        results
    }

    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let results = self.bus.voltages(ids);
        (self.sink)(self.clock.now(), Record::Voltages(ids, &results));
        results
    }

    fn hardware_errors(&mut self, ids: &[ServoId]) -> PerServo<HardwareErrors> {
        let results = self.bus.hardware_errors(ids);
        (self.sink)(self.clock.now(), Record::HardwareErrors(ids, &results));
        results
    }

    fn registers(&mut self, id: ServoId) -> Result<Vec<Registers>, ServoError> {
        let result = self.bus.registers(id);
        (self.sink)(self.clock.now(), Record::Registers(id, &result));
        result
    }

    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError> {
        let result = self.bus.reboot(id);
        (self.sink)(self.clock.now(), Record::Reboot(id, &result));
        result
    }
}

impl<B: Watchdog, S: FnMut(Duration, Record<'_>)> Watchdog for Logged<B, S> {
    fn set_watchdog(&mut self, ids: &[ServoId], timeout: Option<Duration>) -> PerServo<()> {
        let results = self.bus.set_watchdog(ids, timeout);
        (self.sink)(self.clock.now(), Record::Watchdog(ids, timeout, &results));
        results
    }

    fn watchdog(&mut self, ids: &[ServoId]) -> PerServo<WatchdogState> {
        let results = self.bus.watchdog(ids);
        (self.sink)(self.clock.now(), Record::WatchdogRead(ids, &results));
        results
    }
}
