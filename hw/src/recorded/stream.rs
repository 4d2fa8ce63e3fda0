//! Records of a log in their order.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::time::Duration;

use thiserror::Error;

use super::servo_command::ServoCommand;
use crate::log::{DecodeError, Entry, LogError, LogReader, LogRecord, Message, Topic};
use crate::servo::ServoId;

/// Why a log cannot be played back, or not on.
#[derive(Debug, Error)]
pub enum RecordedError {
    /// The log cannot be opened or read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A message of the log makes no sense.
    #[error("the recording at {:.3} s: {source}", time.as_secs_f64())]
    Message {
        /// When it was logged.
        time: Duration,
        /// What is wrong with it.
        source: DecodeError,
    },
    /// The camera, or what is needed of it, is not in the log.
    #[error("{} has no {missing} of camera {serial}; its cameras: {}", path.display(), names(found))]
    Camera {
        /// The log.
        path: PathBuf,
        /// The camera that was asked for.
        serial: String,
        /// What there is nothing of.
        missing: &'static str,
        /// Cameras that the log has something of.
        found: Vec<String>,
    },
    /// No further record of the kind.
    #[error("the recording ends at {:.3} s", time.as_secs_f64())]
    End {
        /// Time of its last message.
        time: Duration,
    },
    /// The log does not say.
    #[error("the recording has no {quantity} of servo {id} up to {:.3} s", time.as_secs_f64())]
    Missing {
        /// Which servo.
        id: ServoId,
        /// What it does not say.
        quantity: &'static str,
        /// Time of the playback.
        time: Duration,
    },
    /// The servo was told something else than when the log was made.
    #[error(
        "servo {id} was told {given}; in the recording, at {:.3} s, it was told {recorded}, and it cannot do otherwise",
        time.as_secs_f64()
    )]
    OtherOrder {
        /// Which servo.
        id: ServoId,
        /// When it was told so.
        time: Duration,
        /// What it was told then.
        recorded: ServoCommand,
        /// What it was told now.
        given: ServoCommand,
    },
    /// Commands are refused altogether.
    #[error("servo {id} is a recording that is only looked at: it takes no orders")]
    LookOnly {
        /// Which servo.
        id: ServoId,
    },
}

fn names(found: &[String]) -> String {
    match found {
        [] => "none".to_owned(),
        found => found.join(", "),
    }
}

/// The messages of a log from its first on, with times counted from there.
pub(super) struct Stream {
    reader: LogReader<BufReader<File>>,
    path: PathBuf,
    /// Time of the log's first message (nanoseconds since the Unix epoch).
    start: u64,
    /// Time of the last message that was read.
    last: Duration,
    /// The first message.
    first: Option<Message>,
}

impl Stream {
    pub fn open(path: &Path) -> Result<Self, RecordedError> {
        let mut stream = Self {
            reader: LogReader::open(path)?,
            path: path.to_owned(),
            start: 0,
            last: Duration::ZERO,
            first: None,
        };
        stream.first = stream.message()?;
        if stream.reader.recovery().is_nothing() {
            let path = path.to_owned();
            return Err(LogError::NotALog { path }.into());
        }
        stream.start = stream.first.as_ref().map_or(0, |message| message.log_time);
        Ok(stream)
    }

    /// The log's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn message(&mut self) -> Result<Option<Message>, RecordedError> {
        loop {
            let entry = self.reader.next_entry().map_err(|source| LogError::File {
                path: self.path.clone(),
                source,
            })?;
            // Messages that are passed over would make another log of it.
            if let Some(compression) = &self.reader.recovery().unread {
                return Err(LogError::Compressed {
                    path: self.path.clone(),
                    compression: compression.clone(),
                }
                .into());
            }
            match entry {
                None => return Ok(None),
                Some(Entry::Message(message)) => return Ok(Some(message)),
                Some(_) => {}
            }
        }
    }

    /// The next record of a topic that is `wanted`; `None` after the last.
    pub fn next(
        &mut self,
        wanted: impl Fn(&Topic) -> bool,
    ) -> Result<Option<(Duration, LogRecord)>, RecordedError> {
        while let Some((time, message)) = self.next_message(&wanted)? {
            let record = LogRecord::decode(&message.channel, &message.data)
                .map_err(|source| RecordedError::Message { time, source })?;
            if let Some(record) = record {
                return Ok(Some((time, record)));
            }
        }
        Ok(None)
    }

    /// The next message of a topic that is `wanted`, not decoded; `None` after the last.
    pub fn next_message(
        &mut self,
        wanted: impl Fn(&Topic) -> bool,
    ) -> Result<Option<(Duration, Message)>, RecordedError> {
        loop {
            let message = match self.first.take() {
                Some(first) => first,
                None => match self.message()? {
                    None => return Ok(None),
                    Some(message) => message,
                },
            };
            let time = Duration::from_nanos(message.log_time.saturating_sub(self.start));
            self.last = self.last.max(time);
            if Topic::parse(&message.channel.topic).is_some_and(|topic| wanted(&topic)) {
                return Ok(Some((time, message)));
            }
        }
    }

    /// That the log has no more of what was asked for.
    pub fn ended(&self) -> RecordedError {
        RecordedError::End { time: self.last }
    }
}

impl From<RecordedError> for io::Error {
    fn from(error: RecordedError) -> Self {
        let kind = match &error {
            RecordedError::End { .. } => io::ErrorKind::UnexpectedEof,
            RecordedError::Missing { .. } => io::ErrorKind::NotFound,
            RecordedError::OtherOrder { .. } | RecordedError::LookOnly { .. } => {
                io::ErrorKind::Unsupported
            }
            _ => io::ErrorKind::InvalidData,
        };
        Self::new(kind, error)
    }
}
