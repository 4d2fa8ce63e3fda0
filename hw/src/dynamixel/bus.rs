//! The driver: instructions to real servos, with deadlines, retries and one result for each.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::ops::ControlFlow;
use std::time::Duration;

use super::control_table::{Area, ControlTable, Item, Model};
use super::frame::{MAX_LENGTH, PacketId};
use super::instruction::{Answers, Backup, Instruction, Reset};
use super::joined::length_field;
use super::line::{EMPTY_STATUS, Heard, LONGEST_RETURN_DELAY, Line};
use super::status::ErrorByte;
use crate::clock::Clock;
use crate::servo::{Fault, Identity, PerServo, ServoError, ServoId};
use crate::transport::Transport;

/// The first firmware that answers fast reads.
const FIRST_FAST_FIRMWARE: u8 = 46;
/// Longest wait of a servo, from the one before, until it answers a ping of all: the vendor's SDK allows as much.
const PING_SLOT: Duration = Duration::from_millis(3);
/// Model and firmware.
const PING_BYTES: usize = 3;
/// The status return level at which all instructions are answered.
const ANSWER_ALL: i64 = 2;

/// Whether instructions that change a servo for good are sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LastingChanges {
    /// They are refused.
    #[default]
    Refused,
    /// They are sent.
    Allowed,
}

/// How a [`Bus`] goes about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusSettings {
    /// How often an instruction that may be repeated is sent before it counts as unanswered.
    pub attempts: u32,
    /// Wait before the second attempt; it doubles before each further one.
    pub pause: Duration,
    /// How several servos are asked to answer. Joined answers need firmware 46; servos that miss theirs are asked again.
    pub answers: Answers,
    /// Whether factory resets and backups are sent.
    pub lasting_changes: LastingChanges,
}

impl Default for BusSettings {
    fn default() -> Self {
        Self {
            attempts: 3,
            pause: Duration::from_millis(2),
            answers: Answers::Joined,
            lasting_changes: LastingChanges::Refused,
        }
    }
}

/// What a servo answered to a read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// Its error byte: no fault, but perhaps the alert.
    pub error: ErrorByte,
    /// The bytes read.
    pub data: Vec<u8>,
}

/// What is to be read of a servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Of which one.
    pub id: ServoId,
    /// Address of the first byte.
    pub address: u16,
    /// How many bytes.
    pub length: u16,
}

/// What is known of a servo that has been met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub model: Model,
    pub firmware: u8,
    pub return_delay: Duration,
    /// Whether its indirect addresses are set.
    pub has_block: bool,
    /// Whether its watchdog had tripped when last seen.
    pub tripped: bool,
}

impl Known {
    pub fn table(&self) -> &'static ControlTable {
        self.model.table(self.firmware)
    }
}

/// Servos of the X330 series behind a line.
///
/// It implements the traits of [`servo`](crate::servo); the methods here are Protocol 2.0's own. A servo is met on its first use:
/// its model, firmware and return delay are read, and its status return level is set to 2, as everything here is acknowledged.
/// A servo that has been silent is asked last, since those behind it wait for its answer.
#[derive(Debug)]
pub struct Bus<T> {
    pub(super) line: Line<T>,
    settings: BusSettings,
    pub(super) servos: BTreeMap<ServoId, Known>,
    silent: BTreeSet<ServoId>,
}

impl<T: Transport> Bus<T> {
    /// A bus of nobody met yet.
    pub fn new(transport: T, settings: BusSettings) -> Self {
        Self {
            line: Line::new(transport),
            settings,
            servos: BTreeMap::new(),
            silent: BTreeSet::new(),
        }
    }

    /// The line of bytes.
    pub fn transport(&self) -> &T {
        self.line.transport()
    }

    /// Gives the line of bytes back.
    pub fn into_transport(self) -> T {
        self.line.into_transport()
    }

    pub(super) fn clock(&self) -> &dyn Clock {
        self.line.clock()
    }

    /// Model and firmware of a servo that has been met.
    pub fn model(&self, id: ServoId) -> Option<(Model, u8)> {
        let known = self.servos.get(&id)?;
        Some((known.model, known.firmware))
    }

    /// Reads `length` bytes.
    ///
    /// # Errors
    /// [`ServoError`].
    pub fn read(&mut self, id: ServoId, address: u16, length: u16) -> Result<Reply, ServoError> {
        self.read_with(id, address, length, self.settings.attempts, reply)
    }

    fn read_with<R>(
        &mut self,
        id: ServoId,
        address: u16,
        length: u16,
        attempts: u32,
        mut parse: impl FnMut(ErrorByte, &[u8]) -> R,
    ) -> Result<R, ServoError> {
        let instruction = Instruction::Read { address, length };
        let action = || describe("read", address, length.into());
        self.ask(id, instruction, length.into(), attempts, action, &mut parse)
    }

    /// Writes bytes, and waits until that is acknowledged.
    ///
    /// # Errors
    /// [`ServoError`].
    pub fn write(
        &mut self,
        id: ServoId,
        address: u16,
        data: &[u8],
    ) -> Result<ErrorByte, ServoError> {
        let instruction = Instruction::Write { address, data };
        let action = || describe("write", address, data.len());
        self.tell(id, instruction, self.settings.attempts, action)
    }

    /// Has a servo keep a write until [`action`](Self::action). It is sent once: a servo that has it refuses another.
    ///
    /// # Errors
    /// [`ServoError`].
    pub fn reg_write(
        &mut self,
        id: ServoId,
        address: u16,
        data: &[u8],
    ) -> Result<ErrorByte, ServoError> {
        let instruction = Instruction::RegWrite { address, data };
        self.tell(id, instruction, 1, || {
            describe("register a write of", address, data.len())
        })
    }

    /// Has all servos carry out what they registered, at once. Nobody acknowledges it.
    ///
    /// # Errors
    /// [`ServoError::Line`].
    pub fn action(&mut self) -> Result<(), ServoError> {
        self.send_to_all(Instruction::Action)
    }

    /// Brings the position of a servo at rest back into one turn.
    ///
    /// # Errors
    /// [`ServoError`].
    pub fn clear_turns(&mut self, id: ServoId) -> Result<ErrorByte, ServoError> {
        let attempts = self.settings.attempts;
        self.tell(id, Instruction::ClearTurns, attempts, || {
            "clear its turns".to_owned()
        })
    }

    /// Stores the control table in the servo's backup, or restores EEPROM from it and restarts the servo.
    ///
    /// # Errors
    /// [`ServoError::Forbidden`] unless the settings allow it; [`ServoError`].
    pub fn backup(&mut self, id: ServoId, backup: Backup) -> Result<ErrorByte, ServoError> {
        let action = match backup {
            Backup::Store => "backup",
            Backup::Restore => "restoring the backup",
        };
        self.permit(id, action)?;
        let result = self.tell(id, Instruction::Backup(backup), 1, || action.to_owned());
        if backup == Backup::Restore {
            self.servos.remove(&id);
        }
        result
    }

    /// Brings the control table back to the factory's; the servo restarts, perhaps at another id and baud rate.
    ///
    /// # Errors
    /// [`ServoError::Forbidden`] unless the settings allow it; [`ServoError`].
    pub fn factory_reset(&mut self, id: ServoId, reset: Reset) -> Result<ErrorByte, ServoError> {
        self.permit(id, "factory reset")?;
        let result = self.tell(id, Instruction::FactoryReset(reset), 1, || {
            "reset itself".to_owned()
        });
        self.servos.remove(&id);
        result
    }

    fn permit(&self, id: ServoId, action: &'static str) -> Result<(), ServoError> {
        match self.settings.lasting_changes {
            LastingChanges::Allowed => Ok(()),
            LastingChanges::Refused => Err(ServoError::Forbidden { id, action }),
        }
    }

    pub(super) fn restart(&mut self, id: ServoId) -> Result<(), ServoError> {
        let result = self.tell(id, Instruction::Reboot, 1, || "restart".to_owned());
        self.servos.remove(&id);
        result.map(drop)
    }

    /// Reads something of each of several servos: in one exchange where all answer. Each is named once.
    pub fn read_many(&mut self, spans: &[Span]) -> PerServo<Reply> {
        self.gather(spans, |_, error, data| Ok(reply(error, data)))
    }

    /// Writes the same items of several servos, `length` bytes to each; rows are ids and bytes. Nobody acknowledges it.
    ///
    /// # Errors
    /// [`ServoError::Line`]; also where a row has another number of bytes.
    pub fn sync_write(
        &mut self,
        address: u16,
        length: u16,
        rows: &[(ServoId, &[u8])],
    ) -> Result<(), ServoError> {
        if rows
            .iter()
            .any(|(_, data)| data.len() != usize::from(length))
        {
            return Err(invalid(
                "a row of a sync write has another length than the others",
            ));
        }
        let size = usize::from(length) + 1;
        for rows in rows.chunks(((MAX_LENGTH - ROOM_FOR_STUFFING) / size).max(1)) {
            let mut bytes = Vec::with_capacity(rows.len() * size);
            for (id, data) in rows {
                bytes.push(id.get());
                bytes.extend_from_slice(data);
            }
            self.send_to_all(Instruction::SyncWrite {
                address,
                length,
                rows: &bytes,
            })?;
        }
        Ok(())
    }

    /// Writes something to each of several servos; rows are ids, addresses and bytes. Nobody acknowledges it.
    ///
    /// # Errors
    /// [`ServoError::Line`]; also where all rows together are too long for a frame.
    pub fn bulk_write(&mut self, rows: &[(ServoId, u16, &[u8])]) -> Result<(), ServoError> {
        let mut bytes = Vec::new();
        for (id, address, data) in rows {
            let length = u16::try_from(data.len())
                .map_err(|_| invalid("a row of a bulk write is too long"))?;
            bytes.push(id.get());
            bytes.extend_from_slice(&address.to_le_bytes());
            bytes.extend_from_slice(&length.to_le_bytes());
            bytes.extend_from_slice(data);
        }
        self.send_to_all(Instruction::BulkWrite { rows: &bytes })
    }

    fn send_to_all(&mut self, instruction: Instruction) -> Result<(), ServoError> {
        let sent = self
            .line
            .send(PacketId::Broadcast, instruction)
            .map_err(line)?;
        // The next instruction must not begin before this one has ended.
        self.clock().wait_until(sent);
        Ok(())
    }

    /// Sends an instruction that is answered without data.
    fn tell(
        &mut self,
        id: ServoId,
        instruction: Instruction,
        attempts: u32,
        action: impl Fn() -> String,
    ) -> Result<ErrorByte, ServoError> {
        self.ask(
            id,
            instruction,
            0,
            attempts,
            action,
            &mut |error, _: &[u8]| error,
        )
    }

    /// Sends an instruction until it is answered, `attempts` times at most.
    fn ask<R>(
        &mut self,
        id: ServoId,
        instruction: Instruction,
        bytes: usize,
        attempts: u32,
        action: impl Fn() -> String,
        parse: &mut impl FnMut(ErrorByte, &[u8]) -> R,
    ) -> Result<R, ServoError> {
        let delay = self.return_delay(id);
        let mut failure = ServoError::Unknown { id };
        for attempt in 0..attempts.max(1) {
            self.pause_before(attempt);
            let start = self.clock().now();
            let sent = self
                .line
                .send(PacketId::Servo(id), instruction)
                .map_err(line)?;
            let deadline = self.line.deadline(sent, delay, EMPTY_STATUS + bytes);
            let mut answer = None;
            let mut found = None;
            let heard = self.line.listen(deadline, |status| {
                if status.id != PacketId::Servo(id) {
                    return ControlFlow::Continue(());
                }
                answer = match status.error.fault() {
                    Some(fault) => Some(Err(fault)),
                    None if status.parameters.len() == bytes => {
                        Some(Ok(parse(status.error, status.parameters)))
                    }
                    // A late answer to something else.
                    None => {
                        found = Some(status.parameters.len());
                        return ControlFlow::Continue(());
                    }
                };
                ControlFlow::Break(())
            });
            let heard = heard.map_err(line)?;
            failure = match (answer, found) {
                (Some(Ok(value)), _) => {
                    self.silent.remove(&id);
                    return Ok(value);
                }
                (Some(Err(fault)), _) => {
                    self.silent.remove(&id);
                    let action = action();
                    let refused = ServoError::Refused { id, action, fault };
                    if fault != Fault::Crc {
                        return Err(refused);
                    }
                    refused
                }
                (None, Some(found)) => ServoError::WrongLength {
                    id,
                    expected: bytes,
                    found,
                },
                (None, None) if heard == Heard::Noise => ServoError::Damaged { id },
                (None, None) => ServoError::NoAnswer {
                    id,
                    waited: deadline.saturating_sub(start),
                },
            };
        }
        if matches!(failure, ServoError::NoAnswer { .. }) {
            self.silent.insert(id);
        }
        Err(failure)
    }

    fn pause_before(&self, attempt: u32) {
        if let Some(doublings) = attempt.checked_sub(1) {
            let factor = 2_u32.saturating_pow(doublings);
            self.clock()
                .wait(self.settings.pause.saturating_mul(factor));
        }
    }

    fn return_delay(&self, id: ServoId) -> Duration {
        let known = self.servos.get(&id);
        known.map_or(LONGEST_RETURN_DELAY, |known| known.return_delay)
    }

    /// Reads of several servos. First all in one exchange; those that were missed in another, each with a status of its own; at
    /// last one by one, since servos wait for the answer of the one before.
    pub(super) fn gather<R>(
        &mut self,
        spans: &[Span],
        mut parse: impl FnMut(usize, ErrorByte, &[u8]) -> Result<R, ServoError>,
    ) -> PerServo<R> {
        let mut results: Vec<Option<Result<R, ServoError>>> = spans.iter().map(|_| None).collect();
        let mut missing: Vec<usize> = (0..spans.len()).collect();
        missing.sort_by_key(|&index| self.silent.contains(&spans[index].id));
        let is_fast = |span: &Span| {
            let known = self.servos.get(&span.id);
            known.is_some_and(|known| known.firmware >= FIRST_FAST_FIRMWARE)
        };
        let joined = self.settings.answers == Answers::Joined && spans.iter().all(is_fast);
        let rounds: &[Answers] = if joined {
            &[Answers::Joined, Answers::Each]
        } else {
            &[Answers::Each]
        };
        for (round, &answers) in (0..).zip(rounds) {
            // One by one where it is one, and where all that are left were silent before.
            if missing.len() < 2
                || missing
                    .iter()
                    .all(|&index| self.silent.contains(&spans[index].id))
            {
                break;
            }
            self.pause_before(round);
            for chunk in chunks(spans, &missing, answers) {
                let exchanged = self.exchange(spans, chunk, answers, |index, error, data| {
                    results[index].get_or_insert_with(|| parse(index, error, data));
                });
                if let Err(error) = exchanged {
                    return spans.iter().map(|_| Err(line_again(&error))).collect();
                }
            }
            missing.retain(|&index| results[index].is_none());
        }
        for index in missing {
            let Span {
                id,
                address,
                length,
            } = spans[index];
            let attempts = if self.silent.contains(&id) {
                1
            } else {
                self.settings.attempts
            };
            let read = self.read_with(id, address, length, attempts, |error, data| {
                parse(index, error, data)
            });
            results[index] = Some(read.and_then(|parsed| parsed));
        }
        let servos = spans.iter().zip(results);
        servos
            .map(|(span, result)| result.unwrap_or(Err(ServoError::Unknown { id: span.id })))
            .collect()
    }

    /// One read of several servos, and the answers to it that have no fault.
    fn exchange(
        &mut self,
        spans: &[Span],
        chunk: &[usize],
        answers: Answers,
        mut take: impl FnMut(usize, ErrorByte, &[u8]),
    ) -> io::Result<()> {
        let asked: Vec<Span> = chunk.iter().map(|&index| spans[index]).collect();
        let Some(&Span {
            address, length, ..
        }) = asked.first()
        else {
            return Ok(());
        };
        let same = asked
            .iter()
            .all(|span| (span.address, span.length) == (address, length));
        let mut rows = Vec::with_capacity(5 * asked.len());
        for span in &asked {
            rows.push(span.id.get());
            if !same {
                rows.extend_from_slice(&span.address.to_le_bytes());
                rows.extend_from_slice(&span.length.to_le_bytes());
            }
        }
        let instruction = if same {
            Instruction::SyncRead {
                answers,
                address,
                length,
                ids: &rows,
            }
        } else {
            Instruction::BulkRead {
                answers,
                rows: &rows,
            }
        };
        let sent = self.line.send(PacketId::Broadcast, instruction)?;
        let delays: Duration = asked.iter().map(|span| self.return_delay(span.id)).sum();
        let bytes: usize = asked
            .iter()
            .map(|span| EMPTY_STATUS + usize::from(span.length))
            .sum();
        let deadline = self.line.deadline(sent, delays, bytes);
        let position = |id| asked.iter().position(|span| span.id == id);
        match answers {
            Answers::Joined => {
                let sizes: Vec<_> = asked
                    .iter()
                    .map(|span| (span.id, span.length.into()))
                    .collect();
                self.line.listen_joined(&sizes, deadline, |section| {
                    if let Some(at) = position(section.id)
                        && section.error.fault().is_none()
                    {
                        take(chunk[at], section.error, section.data);
                    }
                })?;
            }
            Answers::Each => {
                let mut left = asked.len();
                self.line.listen(deadline, |status| {
                    if let PacketId::Servo(id) = status.id
                        && let Some(at) = position(id)
                        && status.error.fault().is_none()
                        && status.parameters.len() == usize::from(asked[at].length)
                    {
                        take(chunk[at], status.error, status.parameters);
                        left -= 1;
                    }
                    if left == 0 {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                })?;
            }
        }
        Ok(())
    }

    pub(super) fn ping_one(&mut self, id: ServoId, attempts: u32) -> Result<Identity, ServoError> {
        let action = || "answer a ping".to_owned();
        self.ask(
            id,
            Instruction::Ping,
            PING_BYTES,
            attempts,
            action,
            &mut |_, data: &[u8]| identity(data),
        )
    }

    /// How often a servo is asked: once where it was silent before.
    pub(super) fn attempts_for(&self, id: ServoId) -> u32 {
        if self.silent.contains(&id) {
            1
        } else {
            self.settings.attempts
        }
    }

    pub(super) fn ping_all(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError> {
        let mut found = BTreeMap::new();
        let sent = self
            .line
            .send(PacketId::Broadcast, Instruction::Ping)
            .map_err(line)?;
        let servos = u32::from(ServoId::MAX) + 1;
        let bytes = servos as usize * (EMPTY_STATUS + PING_BYTES);
        let deadline = self.line.deadline(sent, PING_SLOT * servos, bytes);
        let heard = self.line.listen(deadline, |status| {
            if let (PacketId::Servo(id), PING_BYTES) = (status.id, status.parameters.len()) {
                found.insert(id, identity(status.parameters));
            }
            ControlFlow::Continue(())
        });
        heard.map_err(line)?;
        Ok(found.into_iter().collect())
    }

    /// What is known of a servo, which is met where nothing is.
    pub(super) fn meet(&mut self, id: ServoId) -> Result<&mut Known, ServoError> {
        if !self.servos.contains_key(&id) {
            let known = self.get_to_know(id)?;
            self.servos.insert(id, known);
        }
        self.servos.get_mut(&id).ok_or(ServoError::Unknown { id })
    }

    fn get_to_know(&mut self, id: ServoId) -> Result<Known, ServoError> {
        let Identity { model, firmware } = self.ping_one(id, self.attempts_for(id))?;
        let model = Model::from_number(model).ok_or(ServoError::UnknownModel { id, model })?;
        let table = model.table(firmware);
        let level = table.entry(Item::StatusReturnLevel);
        let delay = table.entry(Item::ReturnDelayTime);
        // Below level 2 it does not acknowledge the write, at level 0 not even this read.
        let found = self.read(id, level.address, 1);
        let answers_all =
            matches!(&found, Ok(reply) if level.kind.decode(&reply.data) == Some(ANSWER_ALL));
        if !answers_all {
            if let Err(error @ ServoError::Line { .. }) = found {
                return Err(error);
            }
            let [data, ..] = level.kind.encode(ANSWER_ALL).unwrap_or_default();
            match self.write(id, level.address, &[data]) {
                Ok(_) | Err(ServoError::NoAnswer { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        let reply = self.read(id, delay.address, 1)?;
        let count = delay.kind.decode(&reply.data).unwrap_or_default();
        Ok(Known {
            model,
            firmware,
            return_delay: Duration::from_secs_f64(delay.quantity(count)),
            has_block: false,
            tripped: false,
        })
    }
}

/// Parameters besides rows, and some rows' stuffing.
const ROOM_FOR_STUFFING: usize = 64;

/// Splits servos so that neither the instruction nor a joined answer is too long for a frame.
fn chunks<'a>(
    spans: &[Span],
    missing: &'a [usize],
    answers: Answers,
) -> impl Iterator<Item = &'a [usize]> {
    let longest = missing
        .iter()
        .map(|&index| usize::from(spans[index].length))
        .max();
    let longest = longest.unwrap_or_default();
    let row = match answers {
        Answers::Each => 5,
        Answers::Joined => length_field([longest]).max(5),
    };
    missing.chunks(((MAX_LENGTH - ROOM_FOR_STUFFING) / row).max(1))
}

fn reply(error: ErrorByte, data: &[u8]) -> Reply {
    Reply {
        error,
        data: data.to_vec(),
    }
}

/// The parameters of an answer to a ping.
fn identity(data: &[u8]) -> Identity {
    match *data {
        [low, high, firmware, ..] => Identity {
            model: u16::from_le_bytes([low, high]),
            firmware,
        },
        // Answers of another length are not taken.
        _ => Identity {
            model: 0,
            firmware: 0,
        },
    }
}

/// What a servo was told, for a person.
fn describe(verb: &str, address: u16, length: usize) -> String {
    let item = match Area::of(address) {
        // Where the indirect data lie depends on the firmware.
        Area::Ram if address >= 208 => Some("Indirect Data"),
        _ => {
            let table = Model::Xl330M288.table(Model::LAST_FIRMWARE_208);
            table.at(address).map(|entry| entry.item.name())
        }
    };
    let of = item.map(|item| format!(" ({item})")).unwrap_or_default();
    format!("{verb} {length} bytes at {address}{of}")
}

pub(super) fn line(source: io::Error) -> ServoError {
    ServoError::Line { source }
}

fn invalid(what: &str) -> ServoError {
    line(io::Error::new(io::ErrorKind::InvalidInput, what))
}

/// The same error once more.
pub(super) fn line_again(error: &io::Error) -> ServoError {
    line(io::Error::new(error.kind(), error.to_string()))
}
