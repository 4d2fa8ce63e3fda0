//! What was found in a log that may not be whole.

use std::fmt;
use std::path::Path;

use mcap::records::op;

use super::error::LogError;

/// Damage that is kept one by one: of the rest, only the number.
const MOST_DAMAGE: usize = 100;

/// What was found in a log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovery {
    /// Messages that were read.
    pub messages: u64,
    /// Messages that the log itself counts, in the summary that is written last.
    pub stated: Option<u64>,
    /// What could not be read, from the first byte on; no more than a hundred places.
    pub damage: Vec<Damage>,
    /// How many places there were.
    pub damages: u64,
    /// The first compression of a chunk that is not read, if there is such a chunk.
    pub unread: Option<String>,
}

/// A place that could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Where it begins (bytes from the file's start).
    pub at: u64,
    /// What is wrong there.
    pub problem: Problem,
}

/// What is wrong at a place of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Problem {
    /// The file does not begin as MCAP files do.
    NoMagic,
    /// The file ends within a record, or before its summary: whoever wrote it was stopped.
    EndsEarly,
    /// A record of this opcode is not understood.
    Record(u8),
    /// A record is longer than any that is read.
    TooLong(u64),
    /// The checksum of a chunk is wrong: its messages are lost.
    Checksum,
    /// Lengths within a chunk disagree: its other messages are lost.
    Chunk,
    /// A chunk is compressed, in a way that is not read.
    Compressed(String),
    /// A chunk is not what its compression says: its messages are lost. By which, and what is wrong.
    Decompression(String, String),
    /// A message is of a channel that no record describes.
    NoChannel(u16),
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoMagic => write!(f, "the file does not begin as an MCAP file"),
            Self::EndsEarly => write!(f, "the file ends before its log does"),
            Self::Record(opcode) => {
                let kind = match *opcode {
                    op::HEADER => "header",
                    op::FOOTER => "footer",
                    op::SCHEMA => "schema",
                    op::CHANNEL => "channel",
                    op::MESSAGE => "message",
                    op::CHUNK => "chunk",
                    op::MESSAGE_INDEX => "index of messages",
                    op::ATTACHMENT => "attachment",
                    op::METADATA => "metadata",
                    op::DATA_END => "end of the data",
                    other => return write!(f, "no record has the opcode {other} here"),
                };
                write!(f, "not a whole record ({kind})")
            }
            Self::TooLong(length) => write!(f, "a record says that it has {length} bytes"),
            Self::Checksum => write!(f, "a chunk is not what its checksum says"),
            Self::Chunk => write!(f, "lengths within a chunk disagree"),
            Self::Compressed(name) => write!(
                f,
                "a chunk is compressed by `{name}`, expected zstd, lz4 or none"
            ),
            Self::Decompression(name, problem) => {
                write!(f, "a chunk cannot be decompressed by {name}: {problem}")
            }
            Self::NoChannel(id) => {
                write!(f, "a message is of channel {id}, which is not described")
            }
        }
    }
}

impl Recovery {
    /// Whether nothing is missing.
    pub fn is_whole(&self) -> bool {
        self.damages == 0 && self.stated.is_none_or(|stated| stated == self.messages)
    }

    /// Whether nothing of an MCAP file was found.
    pub fn is_nothing(&self) -> bool {
        let at_start = (self.damage.first()).is_some_and(|d| d.problem == Problem::NoMagic);
        at_start && self.messages == 0
    }

    /// Refuses the log at `path` if nothing of it was read because of how it is compressed.
    pub(super) fn require_readable(&self, path: &Path) -> Result<(), LogError> {
        match &self.unread {
            Some(compression) if self.messages == 0 => Err(LogError::Compressed {
                path: path.to_owned(),
                compression: compression.clone(),
            }),
            _ if self.is_nothing() => Err(LogError::NotALog {
                path: path.to_owned(),
            }),
            _ => Ok(()),
        }
    }

    pub(super) fn note(&mut self, at: u64, problem: Problem) {
        self.damages += 1;
        if let (Problem::Compressed(name), None) = (&problem, &self.unread) {
            self.unread = Some(name.clone());
        }
        if self.damage.len() < MOST_DAMAGE {
            self.damage.push(Damage { at, problem });
        }
    }
}
