//! What a bus was sent and what it said, as records.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use super::record::{Event, Goal, Level, LogRecord, Reading, ServoStatus};
use super::shared::SharedLog;
use crate::servo::{
    HardwareErrors, PerServo, Record, ServoError, ServoId, Setting, Ticks, Torque, WatchdogState,
};

/// A sink for [`Logged`](crate::servo::Logged) that writes to `log`.
///
/// Faults that readings report are logged when they change, and watchdogs when they trip. A servo's failure to answer is logged once, and that it answers
/// again.
///
/// ```no_run
/// # use std::sync::Arc;
/// # use tdcr_hw::clock::Clock;
/// # use tdcr_hw::servo::ServoBus;
/// use tdcr_hw::log::{SharedLog, servo_sink};
/// use tdcr_hw::servo::Logged;
///
/// fn logged(bus: impl ServoBus, clock: Arc<dyn Clock>, log: &SharedLog) -> impl ServoBus {
///     Logged::new(bus, clock, servo_sink(log.clone()))
/// }
/// ```
pub fn servo_sink(log: SharedLog) -> impl FnMut(Duration, Record<'_>) + Send {
    let mut sink = ServoSink {
        log,
        errors: BTreeMap::new(),
        tripped: BTreeSet::new(),
        failing: BTreeMap::new(),
    };
    move |time, record| sink.record(time, record)
}

/// What a servo took or reported, or why not.
type Answer<'a, T> = (ServoId, Result<T, &'a ServoError>);

/// Values that were sent to each servo.
fn zip<'a, T: Copy>(
    sent: &'a [(ServoId, T)],
    results: &'a PerServo<()>,
) -> impl Iterator<Item = Answer<'a, T>> {
    let answers = sent.iter().zip(results);
    answers.map(|(&(id, value), result)| (id, result.as_ref().map(|()| value)))
}

/// A value that was sent to servos.
fn sent<'a, T: Copy + 'a>(
    ids: &'a [ServoId],
    value: T,
    results: &'a PerServo<()>,
) -> impl Iterator<Item = Answer<'a, T>> {
    let answers = ids.iter().zip(results);
    answers.map(move |(&id, result)| (id, result.as_ref().map(|()| value)))
}

/// Values that servos reported.
fn read<'a, T: Copy>(
    ids: &'a [ServoId],
    results: &'a PerServo<T>,
) -> impl Iterator<Item = Answer<'a, T>> {
    let answers = ids.iter().zip(results);
    answers.map(|(&id, result)| (id, result.as_ref().copied()))
}

fn position_goal(position: Ticks) -> Goal {
    Goal {
        position: Some(position),
        current: None,
    }
}

struct ServoSink {
    log: SharedLog,
    /// Faults that each servo last reported.
    errors: BTreeMap<ServoId, HardwareErrors>,
    /// Servos that said last that their watchdog has tripped.
    tripped: BTreeSet<ServoId>,
    /// What servos that did not answer last failed with.
    failing: BTreeMap<ServoId, String>,
}

impl ServoSink {
    fn record(&mut self, time: Duration, record: Record<'_>) {
        match record {
            Record::Set(setting, results) => self.setting(time, setting, results),
            Record::GoalPositions(ids, results) => {
                self.goals(time, read(ids, results), position_goal);
            }
            Record::CurrentLimits(ids, results) => {
                self.status(time, read(ids, results), |s, limit| {
                    s.current_limit = Some(limit)
                });
            }
            Record::Torque(ids, results) => {
                self.status(time, read(ids, results), |s, torque| {
                    s.torque = Some(torque)
                });
            }
            Record::Mode(ids, results) => {
                self.status(time, read(ids, results), |s, mode| s.mode = Some(mode));
            }
            Record::Watchdog(ids, results) => {
                self.status(time, read(ids, results), |s, state| {
                    s.watchdog = Some(state)
                });
            }
            Record::Temperatures(ids, results) => {
                self.status(time, read(ids, results), |s, value| {
                    s.temperature = Some(value)
                });
            }
            Record::Voltages(ids, results) => {
                self.status(time, read(ids, results), |s, value| s.voltage = Some(value));
            }
            Record::HardwareErrors(ids, results) => {
                self.status(time, read(ids, results), |s, errors| {
                    s.hardware_errors = Some(errors)
                });
            }
            Record::Ping(id, result) => {
                let answer = [(id, result.as_ref().copied())].into_iter();
                self.status(time, answer, |s, identity| s.identity = Some(identity));
            }
            Record::Scan(found) => {
                let found = found.iter().map(|&(id, identity)| (id, Ok(identity)));
                self.status(time, found, |s, identity| s.identity = Some(identity));
            }
            Record::Registers(id, result) => {
                self.answered(time, id, result.as_ref().err());
                for registers in result.iter().flatten() {
                    self.log
                        .write(time, LogRecord::Registers(registers.clone()));
                }
            }
            Record::Reboot(id, result) => self.reboot(time, id, result),
            Record::Present(ids, results) => {
                let mut readings = Vec::new();
                let mut changed = Vec::new();
                for (&id, result) in ids.iter().zip(results) {
                    self.answered(time, id, result.as_ref().err());
                    let Ok(present) = result else { continue };
                    readings.push((id, Reading::from(*present)));
                    if self.errors.insert(id, present.errors) != Some(present.errors) {
                        changed.push(ServoStatus {
                            hardware_errors: Some(present.errors),
                            ..ServoStatus::of(id)
                        });
                    }
                    if present.watchdog != WatchdogState::Tripped {
                        self.tripped.remove(&id);
                    } else if self.tripped.insert(id) {
                        changed.push(ServoStatus {
                            watchdog: Some(WatchdogState::Tripped),
                            ..ServoStatus::of(id)
                        });
                    }
                }
                // Before the readings that they are of.
                if !changed.is_empty() {
                    self.log.write(time, LogRecord::Status(changed));
                }
                self.log.write(time, LogRecord::Present(readings));
            }
        }
    }

    fn setting(&mut self, time: Duration, setting: Setting<'_>, results: &PerServo<()>) {
        match setting {
            Setting::GoalPositions(goals) => {
                self.goals(time, zip(goals, results), position_goal);
            }
            Setting::GoalCurrents(goals) => {
                self.goals(time, zip(goals, results), |current| Goal {
                    position: None,
                    current: Some(current),
                });
            }
            Setting::CurrentLimits(limits) => {
                self.status(time, zip(limits, results), |s, limit| {
                    s.current_limit = Some(limit)
                });
            }
            Setting::Torque(ids, torque) => {
                self.status(time, sent(ids, torque, results), |s, torque| {
                    s.torque = Some(torque)
                });
            }
            Setting::Mode(ids, mode) => {
                self.status(time, sent(ids, mode, results), |s, mode| {
                    s.mode = Some(mode)
                });
            }
            Setting::Watchdog(ids, timeout) => {
                let state = timeout.map_or(WatchdogState::Off, WatchdogState::Armed);
                self.status(time, sent(ids, state, results), |s, state| {
                    s.watchdog = Some(state)
                });
            }
        }
    }

    fn goals<'a, T>(
        &mut self,
        time: Duration,
        answers: impl Iterator<Item = Answer<'a, T>>,
        goal: impl Fn(T) -> Goal,
    ) {
        let mut known = Vec::new();
        for (id, answer) in answers {
            self.answered(time, id, answer.as_ref().err().copied());
            if let Ok(value) = answer {
                known.push((id, goal(value)));
            }
        }
        if !known.is_empty() {
            self.log.write(time, LogRecord::Goals(known));
        }
    }

    fn status<'a, T>(
        &mut self,
        time: Duration,
        answers: impl Iterator<Item = Answer<'a, T>>,
        set: impl Fn(&mut ServoStatus, T),
    ) {
        let mut known = Vec::new();
        for (id, answer) in answers {
            self.answered(time, id, answer.as_ref().err().copied());
            if let Ok(value) = answer {
                let mut status = ServoStatus::of(id);
                set(&mut status, value);
                known.push(status);
            }
        }
        if !known.is_empty() {
            self.log.write(time, LogRecord::Status(known));
        }
    }

    fn reboot(&mut self, time: Duration, id: ServoId, result: &Result<(), ServoError>) {
        self.answered(time, id, result.as_ref().err());
        if result.is_ok() {
            self.event(time, Level::Warning, id, "rebooted".to_owned());
            let status = ServoStatus {
                torque: Some(Torque::Off),
                ..ServoStatus::of(id)
            };
            self.log.write(time, LogRecord::Status(vec![status]));
        }
    }

    /// Logs that a servo fails in another way than before, or no longer.
    fn answered(&mut self, time: Duration, id: ServoId, error: Option<&ServoError>) {
        let Some(error) = error else {
            if self.failing.remove(&id).is_some() {
                self.event(time, Level::Info, id, "answers again".to_owned());
            }
            return;
        };
        let text = error.to_string();
        if self.failing.get(&id) != Some(&text) {
            self.event(time, Level::Error, id, text.clone());
            self.failing.insert(id, text);
        }
    }

    fn event(&self, time: Duration, level: Level, id: ServoId, text: String) {
        let source = format!("servo {id}");
        let event = Event {
            level,
            source,
            text,
        };
        self.log.write(time, LogRecord::Event(event));
    }
}
