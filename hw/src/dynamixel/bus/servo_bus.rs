//! What servos can do, as [`ServoBus`] has it.

use std::time::Duration;

use super::super::control_table::Item;
use super::Bus;
use super::items::count_of;
use super::state::{ticks, watchdog_state};
use crate::servo::{
    Fault, HardwareErrors, Identity, OperatingMode, PerServo, Present, Registers, ServoBus,
    ServoError, ServoId, Setting, Ticks, Torque, WatchdogState, for_those,
};
use crate::transport::Transport;

/// How far (ticks) a servo's goal may be from its position when its torque goes on: a servo may take its position, which
/// trembles, for its goal by itself.
const HOLD_WITHIN: u32 = 16;

/// The number of a mode (e-Manual, "Operating Mode").
const fn mode_number(mode: OperatingMode) -> i64 {
    match mode {
        OperatingMode::Current => 0,
        OperatingMode::Velocity => 1,
        OperatingMode::Position => 3,
        OperatingMode::ExtendedPosition => 4,
        OperatingMode::CurrentBasedPosition => 5,
        OperatingMode::Pwm => 16,
    }
}

const MODES: [OperatingMode; 6] = [
    OperatingMode::Current,
    OperatingMode::Velocity,
    OperatingMode::Position,
    OperatingMode::ExtendedPosition,
    OperatingMode::CurrentBasedPosition,
    OperatingMode::Pwm,
];

fn torque_of(id: ServoId, count: i64) -> Result<Torque, ServoError> {
    match count {
        0 => Ok(Torque::Off),
        1 => Ok(Torque::On),
        _ => Err(ServoError::Damaged { id }),
    }
}

impl<T: Transport> Bus<T> {
    /// Makes the goals of servos their positions, where their mode has positions for goals. Nobody acknowledges goals that are
    /// sent to several, so those that did not arrive are sent again.
    fn hold(&mut self, ids: &[ServoId]) -> PerServo<()> {
        let mut results = self.hold_once(ids);
        for attempt in 1..self.settings.attempts {
            let missed = |result: &Result<(), ServoError>| match result {
                Err(ServoError::Refused { .. }) => true,
                Err(error) => error.may_pass(),
                Ok(()) => false,
            };
            let again: Vec<usize> = (0..ids.len()).filter(|&k| missed(&results[k])).collect();
            if again.is_empty() {
                break;
            }
            self.pause_before(attempt);
            let left: Vec<ServoId> = again.iter().map(|&k| ids[k]).collect();
            for (k, result) in again.into_iter().zip(self.hold_once(&left)) {
                results[k] = result;
            }
        }
        results
    }

    fn hold_once(&mut self, ids: &[ServoId]) -> PerServo<()> {
        let modes = self.mode(ids);
        let blocks = self.blocks(ids);
        let servos = ids.iter().zip(modes).zip(blocks);
        let goals: Vec<_> = servos
            .map(|((&id, mode), block)| {
                let (mode, block) = (mode?, block?);
                if !block.errors.is_empty() {
                    let errors = block.errors;
                    return Err(ServoError::Hardware { id, errors });
                }
                if block.watchdog == WatchdogState::Tripped {
                    return Err(ServoError::WatchdogTripped { id });
                }
                Ok((id, goal_at(mode, block.position)))
            })
            .collect();
        for_those(goals, |goals| {
            let held = goals.iter().filter_map(|&(id, goal)| Some((id, goal?)));
            let held: Vec<(ServoId, Ticks)> = held.collect();
            let mut sent = self.send_goal_positions(&held).into_iter();
            let ids: Vec<_> = held.iter().map(|&(id, _)| id).collect();
            let mut found = self.goal_positions(&ids).into_iter();
            goals
                .iter()
                .map(|&(id, goal)| {
                    let Some(goal) = goal else { return Ok(()) };
                    let (sent, found) = (sent.next(), found.next());
                    sent.unwrap_or(Err(ServoError::Unknown { id }))?;
                    let found = found.unwrap_or(Err(ServoError::Unknown { id }))?;
                    if found.0.abs_diff(goal.0) <= HOLD_WITHIN {
                        return Ok(());
                    }
                    Err(ServoError::Refused {
                        id,
                        action: "take its position for its goal".to_owned(),
                        fault: Fault::Result,
                    })
                })
                .collect()
        })
    }
}

/// The goal that keeps a servo where it is.
fn goal_at(mode: OperatingMode, position: Ticks) -> Option<Ticks> {
    match mode {
        OperatingMode::ExtendedPosition | OperatingMode::CurrentBasedPosition => Some(position),
        // It forgets its turns when its torque goes on.
        OperatingMode::Position => Some(Ticks(position.0.rem_euclid(Ticks::PER_TURN))),
        OperatingMode::Current | OperatingMode::Velocity | OperatingMode::Pwm => None,
    }
}

/// What [`Setting`]s do.
impl<T: Transport> Bus<T> {
    /// A servo whose torque goes on gets its position for its goal first, so that it does not jump.
    fn switch(&mut self, ids: &[ServoId], torque: Torque) -> PerServo<()> {
        let ready = match torque {
            Torque::Off => ids.iter().map(|_| Ok(())).collect(),
            Torque::On => self.hold(ids),
        };
        let ready = ids.iter().zip(ready).map(|(&id, ready)| ready.map(|()| id));
        let count = i64::from(torque == Torque::On);
        for_those(ready, |ids| {
            let counts: Vec<_> = ids.iter().map(|&id| (id, count)).collect();
            let sent = self.send_items(Item::TorqueEnable, &counts);
            // Nobody has acknowledged it.
            let found = self.torque(ids);
            let servos = ids.iter().zip(sent).zip(found);
            servos
                .map(|((&id, sent), found)| {
                    if sent.is_ok() && matches!(found, Ok(found) if found == torque) {
                        return Ok(());
                    }
                    self.write_item(id, Item::TorqueEnable, count).map(drop)
                })
                .collect()
        })
    }

    fn set_mode(&mut self, ids: &[ServoId], mode: OperatingMode) -> PerServo<()> {
        let number = mode_number(mode);
        ids.iter()
            .map(|&id| self.write_item(id, Item::OperatingMode, number).map(drop))
            .collect()
    }

    fn send_goal_positions(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()> {
        let counts: Vec<_> = goals
            .iter()
            .map(|&(id, goal)| match self.meet(id)?.tripped {
                true => Err(ServoError::WatchdogTripped { id }),
                false => Ok((id, i64::from(goal.0))),
            })
            .collect();
        for_those(counts, |counts| self.send_items(Item::GoalPosition, counts))
    }

    fn send_goal_currents(&mut self, goals: &[(ServoId, f64)]) -> PerServo<()> {
        let goals: Vec<_> = goals
            .iter()
            .map(|&(id, goal)| match self.meet(id)?.tripped {
                true => Err(ServoError::WatchdogTripped { id }),
                false => Ok((id, goal)),
            })
            .collect();
        for_those(goals, |goals| {
            let mut sent = self.send_quantities(Item::GoalCurrent, "goal current in A", goals);
            let ids: Vec<ServoId> = goals.iter().map(|&(id, _)| id).collect();
            // Nobody has acknowledged them.
            let found = self.read_items(&ids, Item::GoalCurrent);
            for ((&(id, goal), found), sent) in goals.iter().zip(found).zip(&mut sent) {
                if sent.is_ok() {
                    *sent = self.make_sure_of_current(id, goal, found);
                }
            }
            sent
        })
    }

    /// Writes a goal current once more where the servo does not hold it.
    fn make_sure_of_current(
        &mut self,
        id: ServoId,
        goal: f64,
        found: Result<i64, ServoError>,
    ) -> Result<(), ServoError> {
        let entry = self.meet(id)?.table().entry(Item::GoalCurrent);
        let count = count_of(id, entry, "goal current in A", goal)?;
        match found {
            Ok(found) if found == count => Ok(()),
            _ => self.write_item(id, Item::GoalCurrent, count).map(drop),
        }
    }

    fn set_current_limits(&mut self, limits: &[(ServoId, f64)]) -> PerServo<()> {
        limits
            .iter()
            .map(|&(id, limit)| {
                let entry = self.meet(id)?.table().entry(Item::CurrentLimit);
                let count = count_of(id, entry, "current limit in A", limit)?;
                self.write_item(id, Item::CurrentLimit, count).map(drop)
            })
            .collect()
    }

    fn set_watchdog(&mut self, ids: &[ServoId], timeout: Option<Duration>) -> PerServo<()> {
        ids.iter()
            .map(|&id| {
                let entry = self.meet(id)?.table().entry(Item::BusWatchdog);
                let seconds = timeout.map_or(0.0, |timeout| timeout.as_secs_f64());
                // Upwards, and never to 0, which is none.
                let count = (seconds / entry.scale - 1e-9).ceil().max(1.0);
                let most = f64::from(i8::MAX);
                if count > most {
                    return Err(ServoError::OutOfRange {
                        id,
                        quantity: "watchdog in s",
                        value: seconds,
                        min: entry.scale,
                        max: most * entry.scale,
                    });
                }
                // 0 resets one that has tripped.
                self.write_item(id, Item::BusWatchdog, 0)?;
                self.meet(id)?.tripped = false;
                if timeout.is_some() {
                    self.write_item(id, Item::BusWatchdog, count as i64)?;
                }
                Ok(())
            })
            .collect()
    }
}

impl<T: Transport> ServoBus for Bus<T> {
    fn ping(&mut self, id: ServoId) -> Result<Identity, ServoError> {
        self.ping_one(id, self.attempts_for(id))
    }

    fn scan(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError> {
        self.ping_all()
    }

    fn set(&mut self, setting: Setting<'_>) -> PerServo<()> {
        match setting {
            Setting::Torque(ids, torque) => self.switch(ids, torque),
            Setting::Mode(ids, mode) => self.set_mode(ids, mode),
            Setting::GoalPositions(goals) => self.send_goal_positions(goals),
            Setting::GoalCurrents(goals) => self.send_goal_currents(goals),
            Setting::CurrentLimits(limits) => self.set_current_limits(limits),
            Setting::Watchdog(ids, timeout) => self.set_watchdog(ids, timeout),
        }
    }

    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present> {
        let blocks = self.blocks(ids).into_iter();
        blocks
            .map(|block| {
                block.map(|block| Present {
                    position: block.position,
                    velocity: block.velocity,
                    current: block.current,
                    errors: block.errors,
                    watchdog: block.watchdog,
                })
            })
            .collect()
    }

    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque> {
        let counts = ids.iter().zip(self.read_items(ids, Item::TorqueEnable));
        counts.map(|(&id, count)| torque_of(id, count?)).collect()
    }

    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode> {
        let numbers = ids.iter().zip(self.read_items(ids, Item::OperatingMode));
        numbers
            .map(|(&id, number)| {
                let number = number?;
                let mode = MODES.into_iter().find(|&mode| mode_number(mode) == number);
                mode.ok_or(ServoError::Damaged { id })
            })
            .collect()
    }

    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks> {
        let counts = self.read_items(ids, Item::GoalPosition).into_iter();
        counts.map(|count| count.map(ticks)).collect()
    }

    fn current_limits(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let counts = ids.iter().zip(self.read_items(ids, Item::CurrentLimit));
        counts
            .map(|(&id, count)| {
                let count = count?;
                Ok(self
                    .meet(id)?
                    .table()
                    .entry(Item::CurrentLimit)
                    .quantity(count))
            })
            .collect()
    }

    fn watchdog(&mut self, ids: &[ServoId]) -> PerServo<WatchdogState> {
        let counts = self.read_items(ids, Item::BusWatchdog).into_iter();
        counts.map(|count| count.map(watchdog_state)).collect()
    }

    fn temperatures(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let blocks = self.blocks(ids).into_iter();
        blocks
            .map(|block| block.map(|block| block.temperature))
            .collect()
    }

    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let blocks = self.blocks(ids).into_iter();
        blocks
            .map(|block| block.map(|block| block.voltage))
            .collect()
    }

    fn hardware_errors(&mut self, ids: &[ServoId]) -> PerServo<HardwareErrors> {
        let blocks = self.blocks(ids).into_iter();
        blocks
            .map(|block| block.map(|block| block.errors))
            .collect()
    }

    fn registers(&mut self, id: ServoId) -> Result<Vec<Registers>, ServoError> {
        let pieces = self.meet(id)?.table().pieces();
        let pieces = pieces.into_iter().map(|(address, length)| {
            let bytes = self.read(id, address, length)?.data;
            Ok(Registers { id, address, bytes })
        });
        pieces.collect()
    }

    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError> {
        self.restart(id)
    }
}
