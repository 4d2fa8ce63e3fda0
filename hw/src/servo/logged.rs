//! What a bus was told and what it said, to a sink.

use std::sync::Arc;
use std::time::Duration;

use super::forward::forward;
use super::{
    CurrentGoals, CurrentLimits, HardwareErrors, Health, Identity, Modes, OperatingMode, PerServo,
    Ping, PositionGoals, Present, PresentState, ServoError, ServoId, Ticks, Torque, TorqueSwitch,
    Watchdog, WatchdogState,
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

forward!([B, S] Ping for Logged<B, S>, |this| this.bus);

impl<B: TorqueSwitch, S: FnMut(Duration, Record<'_>)> TorqueSwitch for Logged<B, S> {
    fn set_torque(&mut self, ids: &[ServoId], torque: Torque) -> PerServo<()> {
        let results = self.bus.set_torque(ids, torque);
        (self.sink)(self.clock.now(), Record::Torque(ids, torque, &results));
        results
    }

    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque> {
        self.bus.torque(ids)
    }
}

impl<B: Modes, S: FnMut(Duration, Record<'_>)> Modes for Logged<B, S> {
    fn set_mode(&mut self, ids: &[ServoId], mode: OperatingMode) -> PerServo<()> {
        let results = self.bus.set_mode(ids, mode);
        (self.sink)(self.clock.now(), Record::Mode(ids, mode, &results));
        results
    }

    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode> {
        self.bus.mode(ids)
    }
}

impl<B: PositionGoals, S: FnMut(Duration, Record<'_>)> PositionGoals for Logged<B, S> {
    fn set_goal_positions(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()> {
        let results = self.bus.set_goal_positions(goals);
        (self.sink)(self.clock.now(), Record::GoalPositions(goals, &results));
        results
    }

    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks> {
        self.bus.goal_positions(ids)
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
        self.bus.current_limits(ids)
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
        self.bus.temperatures(ids)
    }

    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.bus.voltages(ids)
    }

    fn hardware_errors(&mut self, ids: &[ServoId]) -> PerServo<HardwareErrors> {
        self.bus.hardware_errors(ids)
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
        self.bus.watchdog(ids)
    }
}
