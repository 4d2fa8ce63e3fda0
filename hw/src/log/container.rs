//! The bytes of MCAP records (<https://mcap.dev/spec>), parsed without trust: nothing is taken for a record unless its
//! lengths agree.

use std::collections::BTreeMap;

use mcap::records::op;

/// Bytes before a record's content: its opcode and its length.
pub(super) const RECORD_HEADER: usize = 9;

/// Bytes of a chunk record before its compression's name.
const CHUNK_TIMES_TO_CRC: usize = 28;
/// Bytes of a chunk record before its records, where it is not compressed.
pub(super) const PLAIN_CHUNK_HEADER: usize = CHUNK_TIMES_TO_CRC + 4 + 8;

/// Longest record that is read into memory: a damaged length does not take more.
pub(super) const LONGEST_RECORD: u64 = 256 << 20;

/// Opcode and length of a record.
pub(super) fn record_header(bytes: [u8; RECORD_HEADER]) -> (u8, u64) {
    let [opcode, length @ ..] = bytes;
    (opcode, u64::from_le_bytes(length))
}

/// Opcode and content of the first of `records`, which then begin behind it; `None` where it is not whole.
pub(super) fn record<'a>(records: &mut &'a [u8]) -> Option<(u8, &'a [u8])> {
    let (header, rest) = records.split_first_chunk()?;
    let (opcode, length) = record_header(*header);
    let (content, rest) = rest.split_at_checked(usize::try_from(length).ok()?)?;
    *records = rest;
    Some((opcode, content))
}

/// Whether the header of a file is of its length.
pub(super) fn is_header(content: &[u8]) -> bool {
    let mut fields = Fields(content);
    // Profile and library.
    fields.text().is_some() && fields.text().is_some() && fields.0.is_empty()
}

/// Fields of a record, one after another. Each is `None` where too few bytes are left.
pub(super) struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn bytes(&mut self, count: u64) -> Option<&'a [u8]> {
        let count = usize::try_from(count).ok()?;
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*bytes)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub fn text(&mut self) -> Option<String> {
        let length = self.u32()?;
        let bytes = self.bytes(length.into())?;
        Some(std::str::from_utf8(bytes).ok()?.to_owned())
    }

    pub fn map(&mut self) -> Option<BTreeMap<String, String>> {
        let length = self.u32()?;
        let mut pairs = Fields(self.bytes(length.into())?);
        let mut map = BTreeMap::new();
        while !pairs.0.is_empty() {
            map.insert(pairs.text()?, pairs.text()?);
        }
        Some(map)
    }

    /// `value`, if nothing is left.
    pub fn end<T>(self, value: T) -> Option<T> {
        self.0.is_empty().then_some(value)
    }
}

/// A schema record.
pub(super) struct SchemaRecord<'a> {
    pub id: u16,
    pub name: String,
    pub encoding: String,
    pub data: &'a [u8],
}

impl<'a> SchemaRecord<'a> {
    pub fn parse(content: &'a [u8]) -> Option<Self> {
        let mut fields = Fields(content);
        let id = fields.u16()?;
        let (name, encoding) = (fields.text()?, fields.text()?);
        let length = fields.u32()?;
        let data = fields.bytes(length.into())?;
        fields.end(Self {
            id,
            name,
            encoding,
            data,
        })
    }
}

/// A channel record.
pub(super) struct ChannelRecord {
    pub id: u16,
    pub schema: u16,
    pub topic: String,
    pub encoding: String,
    pub metadata: BTreeMap<String, String>,
}

impl ChannelRecord {
    pub fn parse(content: &[u8]) -> Option<Self> {
        let mut fields = Fields(content);
        let (id, schema) = (fields.u16()?, fields.u16()?);
        let (topic, encoding) = (fields.text()?, fields.text()?);
        let metadata = fields.map()?;
        fields.end(Self {
            id,
            schema,
            topic,
            encoding,
            metadata,
        })
    }
}

/// A message record.
pub(super) struct MessageRecord<'a> {
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
    pub data: &'a [u8],
}

impl<'a> MessageRecord<'a> {
    pub fn parse(content: &'a [u8]) -> Option<Self> {
        let mut fields = Fields(content);
        Some(Self {
            channel: fields.u16()?,
            sequence: fields.u32()?,
            log_time: fields.u64()?,
            publish_time: fields.u64()?,
            data: fields.0,
        })
    }
}

/// What a chunk record says before its records.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ChunkHeader {
    /// CRC-32 of the records; 0 for none.
    pub crc: u32,
    /// Name of the compression; empty for none.
    pub compression: String,
    /// Where the records begin in the record's content.
    pub records_at: u64,
    /// Their bytes, as they are stored.
    pub records: u64,
    /// Their bytes where they are not compressed.
    pub uncompressed: u64,
}

impl ChunkHeader {
    /// The header that `content` begins with, of a record of `length` bytes; `None` where its lengths disagree.
    pub fn parse(content: &[u8], length: u64) -> Option<Self> {
        let mut fields = Fields(content);
        // Times of the first and the last message.
        fields.bytes(16)?;
        let uncompressed = fields.u64()?;
        let crc = fields.u32()?;
        let compression = fields.text()?;
        let records = fields.u64()?;
        let records_at = (content.len() - fields.0.len()) as u64;
        let agree = records_at.checked_add(records) == Some(length)
            && (!compression.is_empty() || records == uncompressed);
        agree.then_some(Self {
            crc,
            compression,
            records_at,
            records,
            uncompressed,
        })
    }
}

/// Whether the index of a chunk's messages is of its length: it says nothing that a reader in order needs.
pub(super) fn is_message_index(content: &[u8]) -> bool {
    let mut fields = Fields(content);
    let index = fields.u16().and_then(|_| fields.u32());
    index.is_some_and(|bytes| bytes as usize == fields.0.len() && bytes % 16 == 0)
}

/// Whether a chunk that is not compressed could begin with these records.
pub(super) fn may_begin_chunk(records: &[u8], length: u64) -> bool {
    let Some((header, _)) = records.split_first_chunk() else {
        return false;
    };
    let (opcode, first) = record_header(*header);
    let known = matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE);
    known && first <= length.saturating_sub(RECORD_HEADER as u64)
}

/// A metadata record: a name and pairs of texts.
pub(super) fn metadata(content: &[u8]) -> Option<mcap::records::Metadata> {
    let mut fields = Fields(content);
    let name = fields.text()?;
    let metadata = fields.map()?;
    fields.end(mcap::records::Metadata { name, metadata })
}

/// An attachment record: a file within the log.
pub(super) fn attachment(content: &[u8]) -> Option<mcap::Attachment<'static>> {
    let (body, crc) = content.split_last_chunk()?;
    let stated = u32::from_le_bytes(*crc);
    if stated != 0 && stated != crc32fast::hash(body) {
        return None;
    }
    let mut fields = Fields(body);
    let (log_time, create_time) = (fields.u64()?, fields.u64()?);
    let (name, media_type) = (fields.text()?, fields.text()?);
    let length = fields.u64()?;
    let data = fields.bytes(length)?.to_vec().into();
    fields.end(mcap::Attachment {
        log_time,
        create_time,
        name,
        media_type,
        data,
    })
}
