//! What is in a log.

use std::collections::BTreeMap;
use std::path::Path;

use super::error::LogError;
use super::message::Entry;
use super::read::LogReader;
use super::recovery::Recovery;

/// What is in a log, topic by topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Contents {
    /// Topics and schemas of their messages, by name.
    pub topics: BTreeMap<(String, String), TopicContents>,
    /// What could be read, and what could not.
    pub recovery: Recovery,
}

/// Messages of a topic and schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopicContents {
    /// How many.
    pub messages: u64,
    /// Their bytes.
    pub bytes: u64,
    /// When the first was logged (nanoseconds since the Unix epoch).
    pub first: u64,
    /// When the last was.
    pub last: u64,
}

impl Contents {
    /// Reads all of the log at `path`.
    ///
    /// # Errors
    /// [`LogError`] where the file cannot be read, is no log, or is compressed in a way that is not read. Damage is none.
    pub fn of(path: &Path) -> Result<Self, LogError> {
        let mut reader = LogReader::open(path)?;
        let mut topics = BTreeMap::new();
        loop {
            let entry = reader.next_entry().map_err(|source| LogError::File {
                path: path.to_owned(),
                source,
            })?;
            let message = match entry {
                None => break,
                Some(Entry::Message(message)) => message,
                Some(_) => continue,
            };
            let schema = (message.channel.schema.as_ref()).map_or("", |schema| &schema.name);
            let time = message.log_time;
            let topic = topics
                .entry((message.channel.topic.clone(), schema.to_owned()))
                .or_insert(TopicContents {
                    messages: 0,
                    bytes: 0,
                    first: time,
                    last: time,
                });
            topic.messages += 1;
            topic.bytes += message.data.len() as u64;
            topic.first = topic.first.min(time);
            topic.last = topic.last.max(time);
        }
        let recovery = reader.recovery().clone();
        recovery.require_readable(path)?;
        Ok(Self { topics, recovery })
    }

    /// Times of the first and the last message (nanoseconds since the Unix epoch); `None` without messages.
    pub fn times(&self) -> Option<(u64, u64)> {
        let first = self.topics.values().map(|topic| topic.first).min()?;
        let last = self.topics.values().map(|topic| topic.last).max()?;
        Some((first, last))
    }
}
