//! Limits of goals, whatever computes them: the last door before the line.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::forward::{for_those, forward};
use super::{
    HardwareErrors, Identity, OperatingMode, PerServo, Present, Registers, ServoBus, ServoError,
    ServoId, Setting, Ticks, Torque, WatchdogState,
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

/// The limits of servos, which change with their homes. Clones are of the same ones.
#[derive(Clone, Debug, Default)]
pub struct SharedLimits(Arc<Mutex<BTreeMap<ServoId, Limits>>>);

impl SharedLimits {
    /// From now on, in place of those before.
    pub fn set(&self, limits: impl IntoIterator<Item = (ServoId, Limits)>) {
        *self.all() = limits.into_iter().collect();
    }

    fn all(&self) -> MutexGuard<'_, BTreeMap<ServoId, Limits>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn of(&self, id: ServoId) -> Result<Limits, ServoError> {
        let limits = self.all().get(&id).copied();
        limits.ok_or(ServoError::Unknown { id })
    }

    /// A current (A) that the servo's limits allow.
    fn admit_current(&self, &(id, current): &(ServoId, f64)) -> Result<(ServoId, f64), ServoError> {
        let limit = self.of(id)?.current;
        match current.abs() <= limit {
            true => Ok((id, current)),
            false => Err(ServoError::OutOfRange {
                id,
                quantity: "current in A",
                value: current,
                min: -limit,
                max: limit,
            }),
        }
    }
}

/// A bus that sends no goal beyond its servos' limits, and none to servos that have no limits.
///
/// A servo outside its range may be told to stay where it is, and to come nearer.
#[derive(Clone, Debug)]
pub struct Limited<B> {
    bus: B,
    limits: SharedLimits,
    /// Goals admitted last.
    goals: BTreeMap<ServoId, Ticks>,
    /// Where servos were read to be last: what the first goal is compared with.
    seen: BTreeMap<ServoId, Ticks>,
}

impl<B> Limited<B> {
    /// A bus whose servos have these limits.
    pub fn new(bus: B, limits: SharedLimits) -> Self {
        Self {
            bus,
            limits,
            goals: BTreeMap::new(),
            seen: BTreeMap::new(),
        }
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
        if excess > self.excess(from) {
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

impl<B: ServoBus> Limited<B> {
    fn send_goals(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()> {
        let unread = self.look_at_those_without_goal(goals);
        let Self {
            bus,
            limits,
            goals: last,
            seen,
        } = self;
        let verdicts = goals.iter().map(|&(id, goal)| {
            let limits = limits.of(id)?;
            match last.get(&id).or(seen.get(&id)) {
                Some(&from) => limits.admit(id, from, goal).map(|()| (id, goal)),
                None => Err(ServoError::Unknown { id }),
            }
        });
        let verdicts: Vec<_> = verdicts.collect();
        // On a line that fails, who moves the servos goes on, and sends the next goals where it would be.
        last.extend(verdicts.iter().flatten().copied());
        let mut results = for_those(verdicts, |admitted| {
            bus.set(Setting::GoalPositions(admitted))
        });
        for (id, error) in unread {
            let index = goals.iter().position(|&(other, _)| other == id);
            if let Some(result) = index.and_then(|index| results.get_mut(index)) {
                *result = Err(error);
            }
        }
        results
    }

    /// Reads where servos are that have no goal yet, and were not read; says why it failed for some.
    fn look_at_those_without_goal(
        &mut self,
        goals: &[(ServoId, Ticks)],
    ) -> Vec<(ServoId, ServoError)> {
        let is_without = |id: &ServoId| {
            self.limits.of(*id).is_ok()
                && !self.goals.contains_key(id)
                && !self.seen.contains_key(id)
        };
        let ids: Vec<ServoId> = goals.iter().map(|&(id, _)| id).filter(is_without).collect();
        if ids.is_empty() {
            return Vec::new();
        }
        let present = self.present(&ids).into_iter();
        let failed = ids.iter().zip(present);
        failed
            .filter_map(|(&id, present)| Some((id, present.err()?)))
            .collect()
    }
}

impl<B: ServoBus> ServoBus for Limited<B> {
    fn set(&mut self, setting: Setting<'_>) -> PerServo<()> {
        let Self { bus, limits, .. } = self;
        match setting {
            Setting::GoalPositions(goals) => self.send_goals(goals),
            Setting::GoalCurrents(goals) => {
                let verdicts = goals.iter().map(|goal| limits.admit_current(goal));
                for_those(verdicts, |admitted| {
                    bus.set(Setting::GoalCurrents(admitted))
                })
            }
            Setting::CurrentLimits(currents) => {
                let verdicts = currents.iter().map(|current| limits.admit_current(current));
                for_those(verdicts, |admitted| {
                    bus.set(Setting::CurrentLimits(admitted))
                })
            }
            Setting::Torque(ids, torque) => {
                // One whose torque goes on holds its position; without torque it goes where it is pulled.
                self.goals.retain(|id, _| !ids.contains(id));
                if torque == Torque::Off {
                    self.seen.retain(|id, _| !ids.contains(id));
                }
                self.bus.set(setting)
            }
            Setting::Mode(..) | Setting::Watchdog(..) => bus.set(setting),
        }
    }

    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present> {
        let present = self.bus.present(ids);
        for (&id, present) in ids.iter().zip(&present) {
            if let Ok(present) = present {
                self.seen.insert(id, present.position);
            }
        }
        present
    }

    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError> {
        self.goals.remove(&id);
        self.seen.remove(&id);
        self.bus.reboot(id)
    }

    forward! { reads, |this| this.bus }
}
