//! What a bus was told and what it said, to a sink.

use std::sync::Arc;
use std::time::Duration;

use super::{
    HardwareErrors, Identity, OperatingMode, PerServo, Present, Registers, ServoBus, ServoError,
    ServoId, Setting, Ticks, Torque, WatchdogState,
};
use crate::clock::Clock;

/// A call and its results.
#[derive(Clone, Copy, Debug)]
pub enum Record<'a> {
    /// Something that servos were told.
    Set(Setting<'a>, &'a PerServo<()>),
    /// A restart.
    Reboot(ServoId, &'a Result<(), ServoError>),
    /// A reading.
    Present(&'a [ServoId], &'a PerServo<Present>),
    /// A servo asked what it is.
    Ping(ServoId, &'a Result<Identity, ServoError>),
    /// All servos that answered.
    Scan(&'a [(ServoId, Identity)]),
    /// Motors looked at.
    Torque(&'a [ServoId], &'a PerServo<Torque>),
    /// Modes looked at.
    Mode(&'a [ServoId], &'a PerServo<OperatingMode>),
    /// Goals looked at.
    GoalPositions(&'a [ServoId], &'a PerServo<Ticks>),
    /// Limits of currents (A) looked at.
    CurrentLimits(&'a [ServoId], &'a PerServo<f64>),
    /// Temperatures (degrees Celsius).
    Temperatures(&'a [ServoId], &'a PerServo<f64>),
    /// Supply voltages (V).
    Voltages(&'a [ServoId], &'a PerServo<f64>),
    /// Bytes of a control table.
    Registers(ServoId, &'a Result<Vec<Registers>, ServoError>),
    /// Faults looked at.
    HardwareErrors(&'a [ServoId], &'a PerServo<HardwareErrors>),
    /// Watchdogs looked at.
    Watchdog(&'a [ServoId], &'a PerServo<WatchdogState>),
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

/// Within the `impl` of [`Logged`]: reads of servos, and what the sink calls each.
macro_rules! logged {
    ($(fn $method:ident -> $value:ty as $record:ident;)*) => {$(
        fn $method(&mut self, ids: &[ServoId]) -> PerServo<$value> {
            let results = self.bus.$method(ids);
            (self.sink)(self.clock.now(), Record::$record(ids, &results));
            results
        }
    )*};
}

impl<B: ServoBus, S: FnMut(Duration, Record<'_>) + Send> ServoBus for Logged<B, S> {
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

    fn set(&mut self, setting: Setting<'_>) -> PerServo<()> {
        let results = self.bus.set(setting);
        (self.sink)(self.clock.now(), Record::Set(setting, &results));
        results
    }

    logged! {
        fn present -> Present as Present;
        fn torque -> Torque as Torque;
        fn mode -> OperatingMode as Mode;
        fn goal_positions -> Ticks as GoalPositions;
        fn current_limits -> f64 as CurrentLimits;
        fn watchdog -> WatchdogState as Watchdog;
        fn temperatures -> f64 as Temperatures;
        fn voltages -> f64 as Voltages;
        fn hardware_errors -> HardwareErrors as HardwareErrors;
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
