//! The driver: instructions to real servos, with deadlines, retries and one result for each.

mod items;
mod many;
mod meeting;
mod one;
mod servo_bus;
mod state;

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::time::Duration;

use super::control_table::{Area, Model};
use super::frame::{MAX_LENGTH, PacketId};
use super::instruction::{Answers, Backup, Instruction, Reset};
use super::line::Line;
use super::status::ErrorByte;
use crate::clock::Clock;
use crate::servo::{PerServo, ServoError, ServoId};
use crate::transport::Transport;
use many::ROOM_FOR_STUFFING;
use meeting::Known;

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
    /// How often an instruction that may be repeated is sent before it counts as unanswered, or as refused because it arrived
    /// damaged. Those that may not be repeated are sent once.
    pub attempts: u32,
    /// Wait before the second attempt; it doubles before each further one. A servo that has lost a byte waits for it, and
    /// swallows the next instruction, until the line was silent for a while.
    pub pause: Duration,
    /// How several servos are asked to answer. Joined answers need servos of firmware 46 or newer that have been met: by a call
    /// of any trait, which asks what they are. Servos that miss theirs are asked again.
    pub answers: Answers,
    /// Whether factory resets and backups are sent.
    pub lasting_changes: LastingChanges,
}

impl Default for BusSettings {
    fn default() -> Self {
        Self {
            // At 0.2 % of bytes lost, an instruction of 50 bytes and its answer fail one time in ten.
            attempts: 6,
            pause: Duration::from_millis(2),
            answers: Answers::Fast,
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

/// Servos of the X330 series behind a line.
///
/// It is a [`ServoBus`](crate::servo::ServoBus); the methods here are Protocol 2.0's own. A servo is met on its first use:
/// its model, firmware and return delay are read, and its status return level is set to 2, as everything here is acknowledged.
/// A servo that has been silent is asked last, since those behind it wait for its answer.
#[derive(Debug)]
pub struct Bus<T> {
    line: Line<T>,
    settings: BusSettings,
    servos: BTreeMap<ServoId, Known>,
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

    /// The line of bytes: what is done with it is unknown to the bus.
    pub fn transport_mut(&mut self) -> &mut T {
        self.line.transport_mut()
    }

    /// Gives the line of bytes back.
    pub fn into_transport(self) -> T {
        self.line.into_transport()
    }

    fn clock(&self) -> &dyn Clock {
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

    fn restart(&mut self, id: ServoId) -> Result<(), ServoError> {
        let result = self.tell(id, Instruction::Reboot, 1, || "restart".to_owned());
        self.servos.remove(&id);
        result.map(drop)
    }

    /// Reads something of each of several servos: in one exchange where all answer. Each is named once. Of servos that have not
    /// been met each sends an answer of its own, whatever [`BusSettings::answers`] says.
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
}

fn reply(error: ErrorByte, data: &[u8]) -> Reply {
    Reply {
        error,
        data: data.to_vec(),
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

fn line(source: io::Error) -> ServoError {
    ServoError::Line { source }
}

fn invalid(what: &str) -> ServoError {
    line(io::Error::new(io::ErrorKind::InvalidInput, what))
}

/// The same error once more.
fn line_again(error: &io::Error) -> ServoError {
    line(io::Error::new(error.kind(), error.to_string()))
}
