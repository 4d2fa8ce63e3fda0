//! What a bus was told and what it said, as records.

use std::collections::BTreeMap;
use std::time::Duration;

use super::record::{Event, Goal, Level, LogRecord, Reading, ServoStatus};
use super::shared::SharedLog;
use crate::servo::{HardwareErrors, PerServo, Record, ServoError, ServoId, Torque, WatchdogState};

/// A sink for [`Logged`](crate::servo::Logged) that writes to `log`.
///
/// Faults that readings report are logged when they change. A servo's failure to answer is logged once, and that it answers
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
        failing: BTreeMap::new(),
    };
    move |time, record| sink.record(time, record)
}

struct ServoSink {
    log: SharedLog,
    /// Faults that each servo last reported.
    errors: BTreeMap<ServoId, HardwareErrors>,
    /// What servos that did not answer last failed with.
    failing: BTreeMap<ServoId, String>,
}

impl ServoSink {
    fn record(&mut self, time: Duration, record: Record<'_>) {
        match record {
            Record::GoalPositions(goals, results) => {
                let goal = |&(id, position)| {
                    let position = Some(position);
                    let current = None;
                    (id, Goal { position, current })
                };
                self.goals(time, goals.iter().map(goal), results);
            }
            Record::GoalCurrents(goals, results) => {
                let goal = |&(id, current)| {
                    let current = Some(current);
                    let position = None;
                    (id, Goal { position, current })
                };
                self.goals(time, goals.iter().map(goal), results);
            }
            Record::CurrentLimits(limits, results) => {
                let status = |&(id, limit)| ServoStatus {
                    current_limit: Some(limit),
                    ..ServoStatus::of(id)
                };
                self.status(time, limits.iter().map(status), results);
            }
            Record::Torque(ids, torque, results) => {
                let status = |&id| ServoStatus {
                    torque: Some(torque),
                    ..ServoStatus::of(id)
                };
                self.status(time, ids.iter().map(status), results);
            }
            Record::Mode(ids, mode, results) => {
                let status = |&id| ServoStatus {
                    mode: Some(mode),
                    ..ServoStatus::of(id)
                };
                self.status(time, ids.iter().map(status), results);
            }
            Record::Watchdog(ids, timeout, results) => {
                let state = timeout.map_or(WatchdogState::Off, WatchdogState::Armed);
                let status = |&id| ServoStatus {
                    watchdog: Some(state),
                    ..ServoStatus::of(id)
                };
                self.status(time, ids.iter().map(status), results);
            }
            Record::Reboot(id, result) => self.reboot(time, id, result),
            Record::Present(ids, results) => {
                let mut readings = Vec::new();
                let mut changed = Vec::new();
                for (&id, result) in ids.iter().zip(results) {
                    self.answered(time, id, result);
                    let Ok(present) = result else { continue };
                    readings.push((id, Reading::from(*present)));
                    if self.errors.insert(id, present.errors) != Some(present.errors) {
                        changed.push(ServoStatus {
                            hardware_errors: Some(present.errors),
                            ..ServoStatus::of(id)
                        });
                    }
                }
                // Before the readings that they are of.
                if !changed.is_empty() {
                    self.log.write(time, &LogRecord::Status(changed));
                }
                self.log.write(time, &LogRecord::Present(readings));
            }
        }
    }

    fn goals(
        &mut self,
        time: Duration,
        goals: impl Iterator<Item = (ServoId, Goal)>,
        results: &PerServo<()>,
    ) {
        let mut sent = Vec::new();
        for ((id, goal), result) in goals.zip(results) {
            self.answered(time, id, result);
            if result.is_ok() {
                sent.push((id, goal));
            }
        }
        if !sent.is_empty() {
            self.log.write(time, &LogRecord::Goals(sent));
        }
    }

    fn status(
        &mut self,
        time: Duration,
        status: impl Iterator<Item = ServoStatus>,
        results: &PerServo<()>,
    ) {
        let mut set = Vec::new();
        for (status, result) in status.zip(results) {
            self.answered(time, status.id, result);
            if result.is_ok() {
                set.push(status);
            }
        }
        if !set.is_empty() {
            self.log.write(time, &LogRecord::Status(set));
        }
    }

    fn reboot(&mut self, time: Duration, id: ServoId, result: &Result<(), ServoError>) {
        self.answered(time, id, result);
        if result.is_ok() {
            self.event(time, Level::Warning, id, "rebooted".to_owned());
            let status = ServoStatus {
                torque: Some(Torque::Off),
                ..ServoStatus::of(id)
            };
            self.log.write(time, &LogRecord::Status(vec![status]));
        }
    }

    /// Logs that a servo fails in another way than before, or no longer.
    fn answered<T>(&mut self, time: Duration, id: ServoId, result: &Result<T, ServoError>) {
        match result {
            Ok(_) => {
                if self.failing.remove(&id).is_some() {
                    self.event(time, Level::Info, id, "answers again".to_owned());
                }
            }
            Err(error) => {
                let text = error.to_string();
                if self.failing.get(&id) != Some(&text) {
                    self.event(time, Level::Error, id, text.clone());
                    self.failing.insert(id, text);
                }
            }
        }
    }

    fn event(&self, time: Duration, level: Level, id: ServoId, text: String) {
        let source = format!("servo {id}");
        let event = Event {
            level,
            source,
            text,
        };
        self.log.write(time, &LogRecord::Event(event));
    }
}
