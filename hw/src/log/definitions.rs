//! Schemas and channels of a log.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

use mcap::MAGIC;
use mcap::records::op;

use super::container::{ChannelRecord, Fields, MessageRecord, RECORD_HEADER, SchemaRecord, record};
use super::message::{Channel, Message, Schema};

/// Bytes of the footer record: two places in the file and a checksum.
const FOOTER: usize = RECORD_HEADER + 8 + 8 + 4;

/// Longest summary that is read ahead.
const LONGEST_SUMMARY: u64 = 64 << 20;

/// What messages are, by the numbers that they name.
#[derive(Debug, Default)]
pub(super) struct Definitions {
    schemas: BTreeMap<u16, Arc<Schema>>,
    channels: BTreeMap<u16, Arc<Channel>>,
}

impl Definitions {
    /// Those that a finished log repeats in its summary: where the chunk that had them is damaged, others stay readable.
    pub fn of_summary(source: &mut (impl Read + Seek), length: u64) -> io::Result<Self> {
        let mut definitions = Self::default();
        let summary = summary(source, length)?;
        let mut records = &summary[..];
        while let Some((opcode, content)) = record(&mut records) {
            // What is not understood is met again, in its place.
            let _understood = match opcode {
                op::SCHEMA => definitions.add_schema(content),
                op::CHANNEL => definitions.add_channel(content),
                _ => None,
            };
        }
        Ok(definitions)
    }

    /// `None` for a record that is not a schema's.
    pub fn add_schema(&mut self, content: &[u8]) -> Option<()> {
        let record = SchemaRecord::parse(content)?;
        let schema = Schema {
            name: record.name,
            encoding: record.encoding,
            data: record.data.to_vec(),
        };
        self.schemas.insert(record.id, Arc::new(schema));
        Some(())
    }

    /// `None` for a record that is not a channel's, and for a channel whose schema is unknown.
    pub fn add_channel(&mut self, content: &[u8]) -> Option<()> {
        let record = ChannelRecord::parse(content)?;
        let schema = match record.schema {
            0 => None,
            id => Some(Arc::clone(self.schemas.get(&id)?)),
        };
        let channel = Channel {
            topic: record.topic,
            encoding: record.encoding,
            schema,
            metadata: record.metadata,
        };
        self.channels.insert(record.id, Arc::new(channel));
        Some(())
    }

    /// The message of a record, unless its channel is unknown.
    pub fn message(&self, record: &MessageRecord<'_>) -> Option<Message> {
        Some(Message {
            channel: Arc::clone(self.channels.get(&record.channel)?),
            sequence: record.sequence,
            log_time: record.log_time,
            publish_time: record.publish_time,
            data: record.data.to_vec(),
        })
    }
}

/// The records of a log's summary; empty where it has none that is whole by its checksum.
fn summary(source: &mut (impl Read + Seek), length: u64) -> io::Result<Vec<u8>> {
    let end = FOOTER + MAGIC.len();
    let Some(footer_at) = length.checked_sub(end as u64) else {
        return Ok(Vec::new());
    };
    source.seek(SeekFrom::Start(footer_at))?;
    let mut footer = vec![0; end];
    source.read_exact(&mut footer)?;
    let Some(begins) = summary_begins(&footer) else {
        return Ok(Vec::new());
    };
    let Some(count) = footer_at
        .checked_sub(begins)
        .filter(|&n| n <= LONGEST_SUMMARY)
    else {
        return Ok(Vec::new());
    };
    source.seek(SeekFrom::Start(begins))?;
    let mut records = vec![0; count as usize];
    source.read_exact(&mut records)?;
    // The checksum covers the summary, and the footer up to the checksum.
    let (covered, rest) = footer.split_at(FOOTER - 4);
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&records);
    hasher.update(covered);
    let whole = Fields(rest).u32() == Some(hasher.finalize());
    Ok(if whole { records } else { Vec::new() })
}

/// Where the footer says that the summary begins.
fn summary_begins(mut footer: &[u8]) -> Option<u64> {
    let (opcode, content) = record(&mut footer)?;
    let begins = Fields(content).u64().filter(|&begins| begins > 0);
    begins.filter(|_| opcode == op::FOOTER && footer == MAGIC)
}
