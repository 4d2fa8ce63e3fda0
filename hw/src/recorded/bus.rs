//! A bus of servos that says again what a log has.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::servo_command::{Known, ServoCommand};
use super::stream::{RecordedError, Stream};
use crate::clock::Clock;
use crate::log::{Goal, LogRecord, Reading, ServoHome, ServoStatus, Topic};
use crate::servo::{
    HardwareErrors, Identity, OperatingMode, PerServo, Present, Registers, ServoBus, ServoError,
    ServoId, Setting, Ticks, Torque, WatchdogState,
};

/// What a recording does with commands: it moves as it moved, whatever it is commanded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Commands {
    /// They must be those that were logged, in their order: so a program is run again on what it saw. Restarts are taken, and
    /// change nothing.
    #[default]
    Compare,
    /// All are refused.
    Refuse,
}

/// The servos of a log.
///
/// Where commands are compared, calls are answered in the order of the log: a reading is the next one, a command is compared with
/// the next of its kind, and other questions are answered by what comes next, if that is an answer, else by the last that was
/// said. The clock is then at the time at which the logged call returned, or where it was, if that is later. How often a rig
/// reads servos that hold their goals, and tells them the same once more, is a matter of time: such repetitions need not be those
/// of the log.
///
/// Where commands are refused, calls are answered by time: a reading is the first that was logged at the clock's time or later,
/// for which the clock waits, and other questions are answered by the last that was said up to then.
pub struct RecordedBus {
    stream: Stream,
    clock: Arc<dyn Clock>,
    commands: Commands,
    /// All servos of the log up to here.
    servos: BTreeMap<ServoId, Known>,
    /// Goals that were sent to the servos last, here.
    sent: BTreeMap<ServoId, Ticks>,
    /// The last reading.
    last: Vec<(ServoId, Reading)>,
    /// The first record that has not been reached.
    next: Option<(Duration, LogRecord)>,
}

impl RecordedBus {
    /// The servos of the log at `path`. Time 0 of `clock` is that of the log's first message.
    ///
    /// # Errors
    /// [`RecordedError`] where the log cannot be read.
    pub fn open(
        path: &Path,
        clock: Arc<dyn Clock>,
        commands: Commands,
    ) -> Result<Self, RecordedError> {
        let mut bus = Self {
            stream: Stream::open(path)?,
            clock,
            commands,
            servos: BTreeMap::new(),
            sent: BTreeMap::new(),
            last: Vec::new(),
            next: None,
        };
        bus.fetch()?;
        Ok(bus)
    }

    /// Reads the next record of servos into `self.next`.
    fn fetch(&mut self) -> Result<(), RecordedError> {
        let of_servos =
            |topic: &Topic| matches!(topic, Topic::Present | Topic::Goals | Topic::Status);
        self.next = self.stream.next(of_servos)?;
        Ok(())
    }

    /// Takes the next record, and keeps what it says.
    fn step(&mut self) -> Result<Option<(Duration, LogRecord)>, RecordedError> {
        let Some((time, record)) = self.next.take() else {
            return Ok(None);
        };
        match &record {
            LogRecord::Status(servos) => {
                for status in servos {
                    let known = self.known(status.id);
                    known.status = known.status.updated(status);
                }
            }
            LogRecord::Goals(servos) => {
                for (id, goal) in servos {
                    let known = self.known(*id);
                    known.goal.position = goal.position.or(known.goal.position);
                    known.goal.current = goal.current.or(known.goal.current);
                }
            }
            LogRecord::Present(servos) => {
                for (id, _) in servos {
                    self.known(*id);
                }
            }
            _ => {}
        }
        self.fetch()?;
        Ok(Some((time, record)))
    }

    fn known(&mut self, id: ServoId) -> &mut Known {
        self.servos.entry(id).or_insert_with(|| Known {
            status: ServoStatus::of(id),
            goal: Goal::default(),
        })
    }

    /// Goes on to the clock's time.
    fn catch_up(&mut self) -> Result<(), RecordedError> {
        let now = self.clock.now();
        while self.next.as_ref().is_some_and(|(time, _)| *time <= now) {
            self.step()?;
        }
        Ok(())
    }

    /// The next reading of any of `ids`, or in which nobody answered.
    fn reading(&mut self, ids: &[ServoId]) -> Result<Vec<(ServoId, Reading)>, RecordedError> {
        let from = match self.commands {
            Commands::Compare => Duration::ZERO,
            Commands::Refuse => self.clock.now(),
        };
        loop {
            // Servos that were not commanded to go on yet stay where they are.
            if self.is_sent_next(ids) && !self.last.is_empty() {
                return Ok(self.last.clone());
            }
            let Some((time, record)) = self.step()? else {
                break;
            };
            let LogRecord::Present(readings) = record else {
                continue;
            };
            let asked = readings.is_empty() || readings.iter().any(|(id, _)| ids.contains(id));
            if time >= from && asked {
                self.clock.wait_until(time);
                self.last.clone_from(&readings);
                return Ok(readings);
            }
        }
        Err(self.stream.ended())
    }

    /// Whether the next record tells any of `ids` to go where it was not commanded to go here.
    fn is_sent_next(&self, ids: &[ServoId]) -> bool {
        let Some((_, LogRecord::Goals(goals))) = &self.next else {
            return false;
        };
        self.commands == Commands::Compare
            && goals.iter().any(|(id, goal)| {
                let sent = self.sent.get(id);
                ids.contains(id)
                    && goal
                        .position
                        .is_some_and(|goal| sent.is_some_and(|sent| *sent != goal))
            })
    }

    /// Goes on to the next record, if it answers a question for a `value` of any of `ids`.
    fn listen<T>(
        &mut self,
        ids: &[ServoId],
        value: impl Fn(&Known) -> Option<T>,
    ) -> Result<(), RecordedError> {
        let says = |id: ServoId, status: ServoStatus, goal: Goal| {
            ids.contains(&id) && value(&Known { status, goal }).is_some()
        };
        let answers = match &self.next {
            Some((_, LogRecord::Status(servos))) => {
                (servos.iter()).any(|status| says(status.id, *status, Goal::default()))
            }
            Some((_, LogRecord::Goals(servos))) => {
                (servos.iter()).any(|(id, goal)| says(*id, ServoStatus::of(*id), *goal))
            }
            _ => false,
        };
        if answers && let Some((time, _)) = self.step()? {
            self.clock.wait_until(time);
        }
        Ok(())
    }

    /// What is known of each servo.
    fn look_up<T>(
        &mut self,
        ids: &[ServoId],
        quantity: &'static str,
        value: impl Fn(&Known) -> Option<T>,
    ) -> PerServo<T> {
        let went_on = match self.commands {
            Commands::Compare => self.listen(ids, &value),
            Commands::Refuse => self.catch_up(),
        };
        if let Err(error) = went_on {
            return fail(ids, error);
        }
        let time = self.clock.now();
        let one = |&id: &ServoId| {
            let known = self.servos.get(&id).and_then(&value);
            known.ok_or_else(|| line(RecordedError::Missing { id, quantity, time }))
        };
        ids.iter().map(one).collect()
    }

    /// Commands: the next of their kind that were logged of these servos, or refused.
    fn apply(&mut self, commands: &[(ServoId, ServoCommand)]) -> PerServo<()> {
        if self.commands == Commands::Refuse {
            let refuse =
                |&(id, _): &(ServoId, ServoCommand)| Err(line(RecordedError::LookOnly { id }));
            return commands.iter().map(refuse).collect();
        }
        if commands.is_empty() {
            return Vec::new();
        }
        let repeats = |&(id, command): &(ServoId, ServoCommand)| match command {
            ServoCommand::Position(goal) => self.sent.get(&id) == Some(&goal),
            _ => false,
        };
        if commands.iter().all(repeats) {
            return commands.iter().map(|_| Ok(())).collect();
        }
        let (time, record) = match self.next_commands(commands) {
            Ok(found) => found,
            Err(error) => return fail(commands.iter().map(|(id, _)| id), error),
        };
        self.clock.wait_until(time);
        let sent = &mut self.sent;
        let one = |&(id, given): &(ServoId, ServoCommand)| match given.logged(&record, id) {
            Some(recorded) if recorded == given => {
                if let ServoCommand::Position(goal) = given {
                    sent.insert(id, goal);
                }
                Ok(())
            }
            // A servo that was commanded so and missed it.
            None => Err(ServoError::NoAnswer {
                id,
                waited: Duration::ZERO,
            }),
            Some(recorded) => Err(line(RecordedError::OtherOrder {
                id,
                time,
                recorded,
                given,
            })),
        };
        commands.iter().map(one).collect()
    }

    /// The next record with a command to one of these servos, of the kind of its command here, which is no repetition.
    fn next_commands(
        &mut self,
        commands: &[(ServoId, ServoCommand)],
    ) -> Result<(Duration, LogRecord), RecordedError> {
        loop {
            let known: Vec<Option<ServoCommand>> = (commands.iter())
                .map(|(id, command)| command.known(self.servos.get(id)?))
                .collect();
            let Some((time, record)) = self.step()? else {
                break;
            };
            let is_sent =
                |((id, command), known): (&(ServoId, ServoCommand), &Option<ServoCommand>)| {
                    let logged = command.logged(&record, *id);
                    logged == Some(*command) || logged.is_some() && logged != *known
                };
            if commands.iter().zip(&known).any(is_sent) {
                return Ok((time, record));
            }
        }
        Err(self.stream.ended())
    }
}

/// Where the homes of servos were when the log at `path` began; none where it does not say.
///
/// # Errors
/// [`RecordedError`] where the log cannot be read.
pub fn homes(path: &Path) -> Result<Vec<ServoHome>, RecordedError> {
    let mut stream = Stream::open(path)?;
    let of_start = |topic: &Topic| matches!(topic, Topic::Homes | Topic::Present | Topic::Goals);
    match stream.next(of_start)? {
        Some((_, LogRecord::Homes(homes))) => Ok(homes),
        _ => Ok(Vec::new()),
    }
}

/// One command to all of `ids`.
fn all(ids: &[ServoId], command: ServoCommand) -> Vec<(ServoId, ServoCommand)> {
    ids.iter().map(|&id| (id, command)).collect()
}

/// A command to each servo.
fn each<T: Copy>(
    values: &[(ServoId, T)],
    command: impl Fn(T) -> ServoCommand,
) -> Vec<(ServoId, ServoCommand)> {
    let commands = values.iter().map(|&(id, value)| (id, command(value)));
    commands.collect()
}

/// The line between the program and the servos is the recording.
fn line(error: RecordedError) -> ServoError {
    ServoError::Line {
        source: error.into(),
    }
}

/// A failure that concerns all of `ids`.
fn fail<'a, T>(ids: impl IntoIterator<Item = &'a ServoId>, error: RecordedError) -> PerServo<T> {
    let source = std::io::Error::from(error);
    let (kind, text) = (source.kind(), source.to_string());
    let again = || std::io::Error::new(kind, text.clone());
    let one = |_| Err(ServoError::Line { source: again() });
    ids.into_iter().map(one).collect()
}

impl ServoBus for RecordedBus {
    fn ping(&mut self, id: ServoId) -> Result<Identity, ServoError> {
        let found = self.look_up(&[id], "model", |known| known.status.identity);
        // One that the log says nothing of is one that is not there.
        found
            .into_iter()
            .flatten()
            .next()
            .ok_or(ServoError::NoAnswer {
                id,
                waited: Duration::ZERO,
            })
    }

    fn scan(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError> {
        let all: Vec<ServoId> = (0..=ServoId::MAX).filter_map(ServoId::new).collect();
        let found = self.look_up(&all, "model", |known| known.status.identity);
        let there = all.into_iter().zip(found);
        Ok(there
            .filter_map(|(id, found)| Some((id, found.ok()?)))
            .collect())
    }

    fn set(&mut self, setting: Setting<'_>) -> PerServo<()> {
        let commands = match setting {
            Setting::Torque(ids, torque) => all(ids, ServoCommand::Torque(torque)),
            Setting::Mode(ids, mode) => all(ids, ServoCommand::Mode(mode)),
            Setting::GoalPositions(goals) => each(goals, ServoCommand::Position),
            Setting::GoalCurrents(goals) => each(goals, ServoCommand::Current),
            Setting::CurrentLimits(limits) => each(limits, ServoCommand::CurrentLimit),
            Setting::Watchdog(ids, timeout) => {
                let state = timeout.map_or(WatchdogState::Off, WatchdogState::Armed);
                all(ids, ServoCommand::Watchdog(state))
            }
        };
        self.apply(&commands)
    }

    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque> {
        self.look_up(ids, "torque", |known| known.status.torque)
    }

    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode> {
        self.look_up(ids, "mode", |known| known.status.mode)
    }

    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks> {
        self.look_up(ids, "goal", |known| known.goal.position)
    }

    fn current_limits(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.look_up(ids, "current limit", |known| known.status.current_limit)
    }

    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present> {
        let readings = match self.reading(ids) {
            Ok(readings) => readings,
            Err(error) => return fail(ids, error),
        };
        let one = |&id: &ServoId| {
            let found = readings.iter().find(|(other, _)| *other == id);
            let Some((_, reading)) = found else {
                // As when it was logged.
                let waited = Duration::ZERO;
                return Err(ServoError::NoAnswer { id, waited });
            };
            let known = self.servos.get(&id);
            Ok(Present {
                position: reading.position,
                velocity: reading.velocity,
                current: reading.current,
                watchdog: (known.and_then(|known| known.status.watchdog))
                    .unwrap_or(WatchdogState::Off),
                errors: (known.and_then(|known| known.status.hardware_errors)).unwrap_or_default(),
            })
        };
        ids.iter().map(one).collect()
    }

    fn temperatures(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.look_up(ids, "temperature", |known| known.status.temperature)
    }

    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        self.look_up(ids, "voltage", |known| known.status.voltage)
    }

    fn hardware_errors(&mut self, ids: &[ServoId]) -> PerServo<HardwareErrors> {
        self.look_up(ids, "fault report", |known| known.status.hardware_errors)
    }

    /// A program that asks is answered nothing: what was logged of them changes nothing that a rig does.
    fn registers(&mut self, _: ServoId) -> Result<Vec<Registers>, ServoError> {
        Ok(Vec::new())
    }

    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError> {
        match self.commands {
            // What came of a restart is in the log.
            Commands::Compare => Ok(()),
            Commands::Refuse => Err(line(RecordedError::LookOnly { id })),
        }
    }

    fn watchdog(&mut self, ids: &[ServoId]) -> PerServo<WatchdogState> {
        self.look_up(ids, "watchdog", |known| known.status.watchdog)
    }
}
