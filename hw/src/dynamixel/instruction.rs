//! Instructions: what servos are told, both ways.

use super::frame::{Frame, FrameTooLong, FrameWriter, PacketId, STATUS};
use crate::servo::ServoId;

/// Makes sure that "clear" is no accident: the protocol fixes these parameters.
const CLEAR_TURNS: [u8; 5] = [0x01, 0x44, 0x58, 0x4C, 0x22];
/// The same for the backup of the control table.
const BACKUP_KEY: [u8; 4] = [0x43, 0x54, 0x52, 0x4C];

/// How several servos answer a read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answers {
    /// Each with a status of its own.
    Each,
    /// All in one status ("fast"; see [`joined`](super::joined)). For firmware 46 and newer.
    Fast,
}

/// What a factory reset keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Nothing: the id becomes 1, the baud rate 57,600. Not for all servos at once.
    All,
    /// The id.
    KeepId,
    /// The id and the baud rate.
    KeepIdAndBaudRate,
}

impl Reset {
    const fn byte(self) -> u8 {
        match self {
            Self::All => 0xFF,
            Self::KeepId => 0x01,
            Self::KeepIdAndBaudRate => 0x02,
        }
    }
}

/// What is done with the backup of the control table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backup {
    /// The control table is written into it.
    Store,
    /// EEPROM is read from it, and the servo restarts.
    Restore,
}

impl Backup {
    const fn byte(self) -> u8 {
        match self {
            Self::Store => 0x01,
            Self::Restore => 0x02,
        }
    }
}

/// An instruction. Fields named `rows` hold the bytes of several servos one behind the other, as they go over the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instruction<'a> {
    /// Who are you?
    Ping,
    /// Reads from the control table.
    Read {
        /// Address of the first byte.
        address: u16,
        /// How many bytes.
        length: u16,
    },
    /// Writes to the control table.
    Write {
        /// Address of the first byte.
        address: u16,
        /// The bytes.
        data: &'a [u8],
    },
    /// Keeps a write until [`Action`](Self::Action).
    RegWrite {
        /// Address of the first byte.
        address: u16,
        /// The bytes.
        data: &'a [u8],
    },
    /// Carries out what was registered.
    Action,
    /// Brings the control table back to the factory's.
    FactoryReset(Reset),
    /// Restarts the servo.
    Reboot,
    /// Brings the present position back into one turn. The servo must be at rest.
    ClearTurns,
    /// Stores or restores the control table. Torque must be off.
    Backup(Backup),
    /// Reads the same of several servos.
    SyncRead {
        /// How they answer.
        answers: Answers,
        /// Address of the first byte.
        address: u16,
        /// How many bytes of each.
        length: u16,
        /// The servos' ids, in the order in which they answer.
        ids: &'a [u8],
    },
    /// Writes the same items of several servos.
    SyncWrite {
        /// Address of the first byte.
        address: u16,
        /// How many bytes to each.
        length: u16,
        /// For each an id and `length` bytes: see [`sync_rows`].
        rows: &'a [u8],
    },
    /// Reads something of each of several servos.
    BulkRead {
        /// How they answer.
        answers: Answers,
        /// For each an id, address and length: see [`bulk_read_rows`].
        rows: &'a [u8],
    },
    /// Writes something to each of several servos.
    BulkWrite {
        /// For each an id, address, length and bytes: see [`bulk_write_rows`].
        rows: &'a [u8],
    },
}

/// Why a frame is no instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InstructionError {
    /// It is a status.
    #[error("the frame is a status, not an instruction")]
    Status,
    /// The protocol has no such instruction.
    #[error("the protocol has no instruction {0:#04x}")]
    Unknown(u8),
    /// The parameters are not those of the instruction.
    #[error("the parameters are not those of instruction {0:#04x}")]
    Parameters(u8),
}

impl<'a> Instruction<'a> {
    /// Its number.
    pub const fn number(&self) -> u8 {
        match self {
            Self::Ping => 0x01,
            Self::Read { .. } => 0x02,
            Self::Write { .. } => 0x03,
            Self::RegWrite { .. } => 0x04,
            Self::Action => 0x05,
            Self::FactoryReset(_) => 0x06,
            Self::Reboot => 0x08,
            Self::ClearTurns => 0x10,
            Self::Backup(_) => 0x20,
            Self::SyncRead { answers, .. } => match answers {
                Answers::Each => 0x82,
                Answers::Fast => 0x8A,
            },
            Self::SyncWrite { .. } => 0x83,
            Self::BulkRead { answers, .. } => match answers {
                Answers::Each => 0x92,
                Answers::Fast => 0x9A,
            },
            Self::BulkWrite { .. } => 0x93,
        }
    }

    /// Writes it at the end of `bytes`.
    ///
    /// # Errors
    /// [`FrameTooLong`].
    pub fn encode(&self, id: PacketId, bytes: &mut Vec<u8>) -> Result<(), FrameTooLong> {
        let mut frame = FrameWriter::new(bytes, id, self.number());
        match *self {
            Self::Ping | Self::Action | Self::Reboot => {}
            Self::Read { address, length } => {
                frame.word(address);
                frame.word(length);
            }
            Self::Write { address, data } | Self::RegWrite { address, data } => {
                frame.word(address);
                frame.bytes(data);
            }
            Self::FactoryReset(reset) => frame.byte(reset.byte()),
            Self::ClearTurns => frame.bytes(&CLEAR_TURNS),
            Self::Backup(backup) => {
                frame.byte(backup.byte());
                frame.bytes(&BACKUP_KEY);
            }
            Self::SyncRead {
                address,
                length,
                ids: rows,
                ..
            }
            | Self::SyncWrite {
                address,
                length,
                rows,
            } => {
                frame.word(address);
                frame.word(length);
                frame.bytes(rows);
            }
            Self::BulkRead { rows, .. } | Self::BulkWrite { rows } => frame.bytes(rows),
        }
        frame.finish()
    }

    /// The instruction in a frame.
    ///
    /// # Errors
    /// [`InstructionError`] where there is none.
    pub fn decode(frame: &Frame<'a>) -> Result<Self, InstructionError> {
        let parameters = frame.parameters;
        let parsed = match frame.instruction {
            0x01 => parameters.is_empty().then_some(Self::Ping),
            0x02 => spans(parameters).and_then(|(address, length, rest)| {
                rest.is_empty().then_some(Self::Read { address, length })
            }),
            0x03 => word(parameters).map(|(address, data)| Self::Write { address, data }),
            0x04 => word(parameters).map(|(address, data)| Self::RegWrite { address, data }),
            0x05 => parameters.is_empty().then_some(Self::Action),
            0x06 => [Reset::All, Reset::KeepId, Reset::KeepIdAndBaudRate]
                .into_iter()
                .find(|reset| parameters == [reset.byte()])
                .map(Self::FactoryReset),
            0x08 => parameters.is_empty().then_some(Self::Reboot),
            0x10 => (parameters == CLEAR_TURNS).then_some(Self::ClearTurns),
            0x20 => parameters.split_first().and_then(|(&what, key)| {
                [Backup::Store, Backup::Restore]
                    .into_iter()
                    .find(|backup| what == backup.byte() && key == BACKUP_KEY)
                    .map(Self::Backup)
            }),
            0x82 => sync_read(Answers::Each, parameters),
            0x8A => sync_read(Answers::Fast, parameters),
            0x83 => spans(parameters).and_then(|(address, length, rows)| {
                let whole = rows.len().is_multiple_of(usize::from(length) + 1);
                whole.then_some(Self::SyncWrite {
                    address,
                    length,
                    rows,
                })
            }),
            0x92 => bulk_read(Answers::Each, parameters),
            0x9A => bulk_read(Answers::Fast, parameters),
            0x93 => {
                let used: usize = bulk_write_rows(parameters)
                    .map(|(_, _, data)| BULK_ROW + data.len())
                    .sum();
                (used == parameters.len()).then_some(Self::BulkWrite { rows: parameters })
            }
            STATUS => return Err(InstructionError::Status),
            other => return Err(InstructionError::Unknown(other)),
        };
        parsed.ok_or(InstructionError::Parameters(frame.instruction))
    }
}

/// Id, address and length.
const BULK_ROW: usize = 5;

/// The rows of a [`SyncWrite`](Instruction::SyncWrite) of `length` bytes to each servo. Rows of ids that no servo has are left
/// out.
pub fn sync_rows(length: u16, rows: &[u8]) -> impl Iterator<Item = (ServoId, &[u8])> {
    rows.chunks_exact(usize::from(length) + 1)
        .filter_map(|row| Some((ServoId::new(row[0])?, &row[1..])))
}

/// The rows of a [`BulkRead`](Instruction::BulkRead): ids, addresses and lengths. Rows of ids that no servo has are left out.
pub fn bulk_read_rows(rows: &[u8]) -> impl Iterator<Item = (ServoId, u16, u16)> {
    let (rows, _) = rows.as_chunks();
    rows.iter()
        .filter_map(|&[id, a, b, c, d]: &[u8; BULK_ROW]| {
            let id = ServoId::new(id)?;
            Some((id, u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])))
        })
}

/// The rows of a [`BulkWrite`](Instruction::BulkWrite), ids, addresses and bytes, up to the first that is not whole or has an id
/// of no servo.
pub fn bulk_write_rows(mut rows: &[u8]) -> impl Iterator<Item = (ServoId, u16, &[u8])> {
    std::iter::from_fn(move || {
        let (&id, rest) = rows.split_first()?;
        let (address, length, rest) = spans(rest)?;
        let (data, behind) = rest.split_at_checked(usize::from(length))?;
        rows = behind;
        Some((ServoId::new(id)?, address, data))
    })
}

fn word(bytes: &[u8]) -> Option<(u16, &[u8])> {
    let (&word, rest) = bytes.split_first_chunk()?;
    Some((u16::from_le_bytes(word), rest))
}

/// Address and length, and what follows.
fn spans(bytes: &[u8]) -> Option<(u16, u16, &[u8])> {
    let (address, rest) = word(bytes)?;
    let (length, rest) = word(rest)?;
    Some((address, length, rest))
}

fn sync_read(answers: Answers, parameters: &[u8]) -> Option<Instruction<'_>> {
    let (address, length, ids) = spans(parameters)?;
    Some(Instruction::SyncRead {
        answers,
        address,
        length,
        ids,
    })
}

fn bulk_read(answers: Answers, rows: &[u8]) -> Option<Instruction<'_>> {
    rows.len()
        .is_multiple_of(BULK_ROW)
        .then_some(Instruction::BulkRead { answers, rows })
}
