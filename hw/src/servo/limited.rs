//! Limits of goals, whatever computes them.

use std::collections::BTreeMap;

use super::forward::{for_those, forward};
use super::{
    CurrentGoals, CurrentLimits, HardwareErrors, Health, Identity, Modes, OperatingMode, PerServo,
    Ping, PositionGoals, Present, PresentState, Registers, ServoError, ServoId, Ticks, Torque,
    TorqueSwitch, Watchdog, WatchdogState,
};

/// What a servo may be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Least position.
    pub min: Ticks,
    /// Greatest position.
    pub max: Ticks,
    /// Farthest (ticks) that a goal may lie from the one before, so that a loop's rate bounds the speed; the first goal, from
    /// where the servo is.
    pub step: u32,
    /// Greatest current (A), either way.
    pub current: f64,
}

/// A bus that sends no goal beyond its servos' limits, and none to servos that have no limits.
///
/// A servo outside its range may be told to come nearer to it.
#[derive(Clone, Debug)]
pub struct Limited<B> {
    bus: B,
    limits: BTreeMap<ServoId, Limits>,
    /// Goals sent last.
    goals: BTreeMap<ServoId, Ticks>,
}

impl<B> Limited<B> {
    /// A bus whose servos have these limits.
    pub fn new(bus: B, limits: impl IntoIterator<Item = (ServoId, Limits)>) -> Self {
        Self {
            bus,
            limits: limits.into_iter().collect(),
            goals: BTreeMap::new(),
        }
    }

    /// The bus without limits.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }
}

/// A current (A) that the servo's limits allow.
fn admit_current(
    limits: &BTreeMap<ServoId, Limits>,
    &(id, current): &(ServoId, f64),
) -> Result<(ServoId, f64), ServoError> {
    let limit = limits.get(&id).ok_or(ServoError::Unknown { id })?.current;
    if current.abs() <= limit {
        Ok((id, current))
    } else {
        Err(ServoError::OutOfRange {
            id,
            quantity: "current in A",
            value: current,
            min: -limit,
            max: limit,
        })
    }
}

impl Limits {
    /// How far (ticks) a position is outside the range.
    fn excess(&self, position: Ticks) -> i64 {
        let [min, max, at] = [self.min, self.max, position].map(|ticks| i64::from(ticks.0));
        (min - at).max(at - max).max(0)
    }

    /// Whether a servo that is, or was sent, to `from` may be sent to `goal`.
    fn admit(&self, id: ServoId, from: Ticks, goal: Ticks) -> Result<(), ServoError> {
        let excess = self.excess(goal);
        if excess > 0 && excess >= self.excess(from) {
            return Err(ServoError::OutOfRange {
                id,
                quantity: "goal in ticks",
                value: goal.0.into(),
                min: self.min.0.into(),
                max: self.max.0.into(),
            });
        }
        let way = i64::from(goal.0) - i64::from(from.0);
        if way.unsigned_abs() > self.step.into() {
            return Err(ServoError::OutOfRange {
                id,
                quantity: "step in ticks from one goal to the next",
                value: way as f64,
                min: -f64::from(self.step),
                max: self.step.into(),
            });
        }
        Ok(())
    }
}

forward!([B] Ping, Modes, PresentState, Watchdog for Limited<B>, |this| this.bus);

impl<B: TorqueSwitch> TorqueSwitch for Limited<B> {
    fn set_torque(&mut self, ids: &[ServoId], torque: Torque) -> PerServo<()> {
        // Without torque servos go where they are pulled.
        self.goals.retain(|id, _| !ids.contains(id));
        self.bus.set_torque(ids, torque)
    }

    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque> {
        self.bus.torque(ids)
    }
}

impl<B: PositionGoals + PresentState> PositionGoals for Limited<B> {
    fn set_goal_positions(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()> {
        let mut without: Vec<ServoId> = goals.iter().map(|&(id, _)| id).collect();
        without.retain(|id| self.limits.contains_key(id) && !self.goals.contains_key(id));
        let mut unread = BTreeMap::new();
        if !without.is_empty() {
            for (&id, present) in without.iter().zip(self.bus.present(&without)) {
                match present {
                    Ok(present) => _ = self.goals.insert(id, present.position),
                    Err(error) => _ = unread.insert(id, error),
                }
            }
        }
        let Self {
            bus,
            limits,
            goals: last,
            ..
        } = self;
        let verdicts = goals.iter().map(|&(id, goal)| {
            let limits = limits.get(&id).ok_or(ServoError::Unknown { id })?;
            match last.get(&id) {
                Some(&from) => limits.admit(id, from, goal).map(|()| (id, goal)),
                None => Err(unread.remove(&id).unwrap_or(ServoError::Unknown { id })),
            }
        });
        let results = for_those(verdicts, |admitted| bus.set_goal_positions(admitted));
        for (&(id, goal), result) in goals.iter().zip(&results) {
            if result.is_ok() {
                last.insert(id, goal);
            }
        }
        results
    }

    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks> {
        self.bus.goal_positions(ids)
    }
}

impl<B: CurrentGoals> CurrentGoals for Limited<B> {
    fn set_goal_currents(&mut self, goals: &[(ServoId, f64)]) -> PerServo<()> {
        let Self { bus, limits, .. } = self;
        let verdicts = goals.iter().map(|goal| admit_current(limits, goal));
        for_those(verdicts, |admitted| bus.set_goal_currents(admitted))
    }
}

impl<B: CurrentLimits> CurrentLimits for Limited<B> {
    fn set_current_limits(&mut self, currents: &[(ServoId, f64)]) -> PerServo<()> {
        let Self { bus, limits, .. } = self;
        let verdicts = currents
            .iter()
            .map(|current| admit_current(limits, current));
        for_those(verdicts, |admitted| bus.set_current_limits(admitted))
    }

    fn current_limits(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.bus.current_limits(ids)
    }
}

impl<B: Health> Health for Limited<B> {
    fn temperatures(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.bus.temperatures(ids)
    }

    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.bus.voltages(ids)
    }

    fn hardware_errors(&mut self, ids: &[ServoId]) -> PerServo<HardwareErrors> {
        self.bus.hardware_errors(ids)
    }

    fn registers(&mut self, id: ServoId) -> Result<Vec<Registers>, ServoError> {
        self.bus.registers(id)
    }

    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError> {
        self.goals.remove(&id);
        self.bus.reboot(id)
    }
}
