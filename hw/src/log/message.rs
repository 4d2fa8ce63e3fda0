//! What a log's messages are.

use std::collections::BTreeMap;
use std::sync::Arc;

/// What a channel's messages are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// Its name, such as `foxglove.RawImage`.
    pub name: String,
    /// How it is written down, such as `protobuf`.
    pub encoding: String,
    /// The schema itself.
    pub data: Vec<u8>,
}

/// Messages of one topic and kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Name of the topic.
    pub topic: String,
    /// How messages are encoded, such as `protobuf`.
    pub encoding: String,
    /// What messages are; `None` where the log does not say.
    pub schema: Option<Arc<Schema>>,
    /// What the log says of the channel besides.
    pub metadata: BTreeMap<String, String>,
}

/// A message of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// What it is, and about what.
    pub channel: Arc<Channel>,
    /// Number in its channel, as its writer counted.
    pub sequence: u32,
    /// When it was logged (nanoseconds since the Unix epoch).
    pub log_time: u64,
    /// When it was published (nanoseconds since the Unix epoch).
    pub publish_time: u64,
    /// Its bytes; [`LogRecord::decode`](super::LogRecord::decode) reads them.
    pub data: Vec<u8>,
}

/// Something of a log.
#[derive(Debug, PartialEq)]
pub enum Entry {
    /// A message.
    Message(Message),
    /// A file within the log.
    Attachment(mcap::Attachment<'static>),
    /// Texts about the log.
    Metadata(mcap::records::Metadata),
}
