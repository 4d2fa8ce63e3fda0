//! Faults by chance, for tests of what stands on a bus.

use std::collections::BTreeSet;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::forward::for_those;
use super::{
    CurrentGoals, CurrentLimits, HardwareErrors, Health, Identity, Modes, OperatingMode, PerServo,
    Ping, PositionGoals, Present, PresentState, Registers, ServoError, ServoId, Ticks, Torque,
    TorqueSwitch, Watchdog, WatchdogState,
};

/// How often calls fail, for each servo on its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Odds {
    /// The instruction is lost: probability from 0 to 1.
    pub lost: f64,
    /// The instruction is carried out and its answer damaged: probability from 0 to 1.
    pub damaged: f64,
}

/// A bus some of whose calls fail. The same seed and calls give the same faults.
#[derive(Clone, Debug)]
pub struct Faulty<B> {
    bus: B,
    odds: Odds,
    chance: ChaCha8Rng,
    unplugged: BTreeSet<ServoId>,
}

impl<B> Faulty<B> {
    /// A bus with these odds.
    pub fn new(bus: B, odds: Odds, seed: u64) -> Self {
        Self {
            bus,
            odds,
            chance: ChaCha8Rng::seed_from_u64(seed),
            unplugged: BTreeSet::new(),
        }
    }

    /// The bus without faults.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    /// From now on.
    pub fn set_odds(&mut self, odds: Odds) {
        self.odds = odds;
    }

    /// Nothing reaches this servo from now on.
    pub fn unplug(&mut self, id: ServoId) {
        self.unplugged.insert(id);
    }

    /// Undoes [`unplug`](Self::unplug).
    pub fn plug_in(&mut self, id: ServoId) {
        self.unplugged.remove(&id);
    }

    /// A call of which some instructions and some answers are lost.
    fn call<I: Copy, T>(
        &mut self,
        servos: &[I],
        id: impl Fn(&I) -> ServoId,
        call: impl FnOnce(&mut B, &[I]) -> PerServo<T>,
    ) -> PerServo<T> {
        let Self {
            bus,
            odds,
            chance,
            unplugged,
        } = self;
        let verdicts = servos.iter().map(|&servo| {
            let id = id(&servo);
            if chance.random::<f64>() < odds.lost || unplugged.contains(&id) {
                let waited = Duration::ZERO;
                return Err(ServoError::NoAnswer { id, waited });
            }
            Ok(servo)
        });
        let results = for_those(verdicts, |reached| call(bus, reached));
        let answers = servos.iter().zip(results);
        answers
            .map(|(servo, result)| {
                let value = result?;
                if chance.random::<f64>() < odds.damaged {
                    return Err(ServoError::Damaged { id: id(servo) });
                }
                Ok(value)
            })
            .collect()
    }

    /// The same for one servo.
    fn call_one<T>(
        &mut self,
        id: ServoId,
        call: impl FnOnce(&mut B) -> Result<T, ServoError>,
    ) -> Result<T, ServoError> {
        let mut results = self.call(&[id], |&id| id, |bus, _| vec![call(bus)]);
        results.pop().unwrap_or(Err(ServoError::Unknown { id }))
    }
}

impl<B: Ping> Ping for Faulty<B> {
    fn ping(&mut self, id: ServoId) -> Result<Identity, ServoError> {
        self.call_one(id, |bus| bus.ping(id))
    }

    fn scan(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError> {
        let mut found = self.bus.scan()?;
        let Self {
            odds,
            chance,
            unplugged,
            ..
        } = self;
        found.retain(|(id, _)| {
            chance.random::<f64>() >= odds.lost + odds.damaged && !unplugged.contains(id)
        });
        Ok(found)
    }
}

impl<B: TorqueSwitch> TorqueSwitch for Faulty<B> {
    fn set_torque(&mut self, ids: &[ServoId], torque: Torque) -> PerServo<()> {
        self.call(ids, |&id| id, |bus, ids| bus.set_torque(ids, torque))
    }

    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque> {
        self.call(ids, |&id| id, B::torque)
    }
}

impl<B: Modes> Modes for Faulty<B> {
    fn set_mode(&mut self, ids: &[ServoId], mode: OperatingMode) -> PerServo<()> {
        self.call(ids, |&id| id, |bus, ids| bus.set_mode(ids, mode))
    }

    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode> {
        self.call(ids, |&id| id, B::mode)
    }
}

impl<B: PositionGoals> PositionGoals for Faulty<B> {
    fn set_goal_positions(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()> {
        self.call(goals, |&(id, _)| id, B::set_goal_positions)
    }

    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks> {
        self.call(ids, |&id| id, B::goal_positions)
    }
}

impl<B: CurrentGoals> CurrentGoals for Faulty<B> {
    fn set_goal_currents(&mut self, goals: &[(ServoId, f64)]) -> PerServo<()> {
        self.call(goals, |&(id, _)| id, B::set_goal_currents)
    }
}

impl<B: CurrentLimits> CurrentLimits for Faulty<B> {
    fn set_current_limits(&mut self, limits: &[(ServoId, f64)]) -> PerServo<()> {
        self.call(limits, |&(id, _)| id, B::set_current_limits)
    }

    fn current_limits(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.call(ids, |&id| id, B::current_limits)
    }
}

impl<B: PresentState> PresentState for Faulty<B> {
    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present> {
        self.call(ids, |&id| id, B::present)
    }
}

impl<B: Health> Health for Faulty<B> {
    fn temperatures(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.call(ids, |&id| id, B::temperatures)
    }

    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.call(ids, |&id| id, B::voltages)
    }

    fn hardware_errors(&mut self, ids: &[ServoId]) -> PerServo<HardwareErrors> {
        self.call(ids, |&id| id, B::hardware_errors)
    }

    fn registers(&mut self, id: ServoId) -> Result<Vec<Registers>, ServoError> {
        self.call_one(id, |bus| bus.registers(id))
    }

    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError> {
        self.call_one(id, |bus| bus.reboot(id))
    }
}

impl<B: Watchdog> Watchdog for Faulty<B> {
    fn set_watchdog(&mut self, ids: &[ServoId], timeout: Option<Duration>) -> PerServo<()> {
        self.call(ids, |&id| id, |bus, ids| bus.set_watchdog(ids, timeout))
    }

    fn watchdog(&mut self, ids: &[ServoId]) -> PerServo<WatchdogState> {
        self.call(ids, |&id| id, B::watchdog)
    }
}
