//! Reading logs, whole or not: every message up to where a log breaks off, and those beyond a damaged part.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use mcap::MAGIC;
use mcap::records::op;
use tdcr_base::files;

use super::compression::Compression;
use super::container::{
    ChunkHeader, Fields, LONGEST_RECORD, MessageRecord, PLAIN_CHUNK_HEADER, RECORD_HEADER,
    attachment, is_header, is_message_index, metadata, record, record_header,
};
use super::definitions::Definitions;
use super::error::LogError;
use super::message::{Entry, Message};
use super::recovery::{Problem, Recovery};
use super::resync::next_chunk;

/// Reads an MCAP file in its order, in bounded memory: a chunk at a time.
///
/// Damage is not an error: what is whole is given, and [`recovery`](Self::recovery) says what was not. Chunks may be plain, or
/// compressed by zstd or lz4.
#[derive(Debug)]
pub struct LogReader<R> {
    source: R,
    /// Bytes of the file.
    length: u64,
    /// Where the next record outside chunks begins.
    at: u64,
    section: Section,
    chunk: Chunk,
    /// Where the next message of the chunk lies.
    next: Place,
    /// Where the last message lay.
    place: Place,
    /// Whether there was a chunk.
    chunked: bool,
    definitions: Definitions,
    recovery: Recovery,
    /// Bytes that may still be read in search of chunks.
    search: u64,
}

/// Where a message lies in a log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Where its chunk, or outside of chunks itself, begins in the file.
    at: u64,
    /// Its number among the messages there, from 0.
    number: usize,
}

/// Parts of an MCAP file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Section {
    Magic,
    Data,
    Summary,
    End,
}

/// A chunk's records, and which of them is next.
#[derive(Debug, Default)]
struct Chunk {
    records: Vec<u8>,
    next: usize,
    /// Where the records begin in the file.
    at: u64,
    /// Whether they lie in the file as they are.
    plain: bool,
    /// Whether the file ends within the chunk.
    cut: bool,
}

impl Chunk {
    /// Where in the file the next record lies, or of a compressed chunk all of them.
    fn place(&self) -> u64 {
        match self.plain {
            true => self.at + self.next as u64,
            false => self.at,
        }
    }
}

impl LogReader<BufReader<File>> {
    /// Opens a log.
    ///
    /// # Errors
    /// [`LogError::File`]; a file that is not a log is found to be none when it is read.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let opened = files::open(path).map(BufReader::new);
        opened.and_then(Self::new).map_err(|source| LogError::File {
            path: path.to_owned(),
            source,
        })
    }
}

impl<R: Read + Seek> LogReader<R> {
    /// A reader of the log in `source`, from its first byte on.
    ///
    /// # Errors
    /// Those of `source`.
    pub fn new(mut source: R) -> io::Result<Self> {
        let length = source.seek(SeekFrom::End(0))?;
        let definitions = Definitions::of_summary(&mut source, length)?;
        source.seek(SeekFrom::Start(0))?;
        Ok(Self {
            source,
            length,
            at: 0,
            section: Section::Magic,
            chunk: Chunk::default(),
            next: Place::default(),
            place: Place::default(),
            chunked: false,
            definitions,
            recovery: Recovery::default(),
            // A file in which each byte seems to begin a chunk would otherwise be read as often as it has bytes.
            search: length.saturating_mul(8).max(LONGEST_RECORD),
        })
    }

    /// What was found so far: all of it, once no entry is left.
    pub fn recovery(&self) -> &Recovery {
        &self.recovery
    }

    /// The next entry; `None` after the last.
    ///
    /// # Errors
    /// Those of the source. Damage is none.
    pub fn next_entry(&mut self) -> io::Result<Option<Entry>> {
        loop {
            if let Some(message) = self.next_in_chunk() {
                self.recovery.messages += 1;
                self.place = self.next;
                self.next.number += 1;
                return Ok(Some(Entry::Message(message)));
            }
            let entry = match self.section {
                Section::Magic => {
                    self.read_magic()?;
                    None
                }
                Section::Data => self.read_data()?,
                Section::Summary => {
                    self.read_summary()?;
                    None
                }
                Section::End => return Ok(None),
            };
            if entry.is_some() {
                return Ok(entry);
            }
        }
    }

    /// Where the message lies that was given last.
    pub fn place(&self) -> Place {
        self.place
    }

    /// The message at a place where this reader has found one before; `None` where the file has changed since. The entry after it is
    /// then the next.
    ///
    /// # Errors
    /// Those of the source.
    pub fn message_at(&mut self, place: Place) -> io::Result<Option<Message>> {
        self.chunk = Chunk::default();
        self.section = Section::Data;
        self.go_to(place.at)?;
        // What is wrong there is known already.
        let known = std::mem::take(&mut self.recovery);
        let mut found = self.next_entry();
        for _ in 0..place.number {
            found = found.and_then(|_| self.next_entry());
        }
        self.recovery = known;
        match found? {
            Some(Entry::Message(message)) => Ok(Some(message)),
            _ => Ok(None),
        }
    }

    fn read_magic(&mut self) -> io::Result<()> {
        self.section = Section::Data;
        let mut magic = [0; MAGIC.len()];
        let count = self.length.min(magic.len() as u64) as usize;
        self.source.read_exact(&mut magic[..count])?;
        if magic == *MAGIC {
            self.at = MAGIC.len() as u64;
            return Ok(());
        }
        self.damaged(0, Problem::NoMagic)
    }

    /// Notes that the record at `at` cannot be read, and goes to the next chunk that is whole.
    fn damaged(&mut self, at: u64, problem: Problem) -> io::Result<()> {
        let found = next_chunk(&mut self.source, at + 1, self.length, &mut self.search)?;
        self.recovery.note(at, problem);
        match found {
            Some(chunk) => self.go_to(chunk),
            None => {
                self.section = Section::End;
                Ok(())
            }
        }
    }

    fn go_to(&mut self, at: u64) -> io::Result<()> {
        self.at = at;
        self.source.seek(SeekFrom::Start(at))?;
        Ok(())
    }

    /// Opcode and length of the record at `self.at`, whose content comes next; `None` where the file ends before.
    fn read_header(&mut self) -> io::Result<Option<(u8, u64)>> {
        let left = self.length.saturating_sub(self.at);
        if left < RECORD_HEADER as u64 {
            self.recovery.note(self.at, Problem::EndsEarly);
            self.section = Section::End;
            return Ok(None);
        }
        let mut header = [0; RECORD_HEADER];
        self.source.read_exact(&mut header)?;
        Ok(Some(record_header(header)))
    }

    /// The content of a record of `length` bytes, which the file has.
    fn read_content(&mut self, length: u64) -> io::Result<Vec<u8>> {
        let mut content = vec![0; length as usize];
        self.source.read_exact(&mut content)?;
        Ok(content)
    }

    /// Reads the record at `self.at`, before the summary.
    fn read_data(&mut self) -> io::Result<Option<Entry>> {
        let at = self.at;
        let Some((opcode, length)) = self.read_header()? else {
            return Ok(None);
        };
        let content_at = at + RECORD_HEADER as u64;
        if opcode == op::CHUNK {
            return self.read_chunk(content_at, length).map(|()| None);
        }
        if length > self.length - content_at {
            return self.damaged(at, Problem::EndsEarly).map(|()| None);
        }
        // Records for applications of their own: nothing of ours.
        if opcode >= 0x80 {
            return self.go_to(content_at + length).map(|()| None);
        }
        if length > LONGEST_RECORD {
            return self.damaged(at, Problem::TooLong(length)).map(|()| None);
        }
        let content = self.read_content(length)?;
        let mut entry = None;
        let understood = match opcode {
            op::HEADER => is_header(&content),
            // Messages are in chunks, or none is: an index of messages with one wrong bit in its opcode is no message.
            op::MESSAGE if self.chunked => false,
            op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                entry = self.common(opcode, &content, at).map(Entry::Message);
                true
            }
            op::MESSAGE_INDEX => is_message_index(&content),
            op::ATTACHMENT => {
                entry = attachment(&content).map(Entry::Attachment);
                entry.is_some()
            }
            op::METADATA => {
                entry = metadata(&content).map(Entry::Metadata);
                entry.is_some()
            }
            op::DATA_END => {
                let whole = content.len() == 4;
                if whole {
                    self.section = Section::Summary;
                }
                whole
            }
            _ => false,
        };
        if !understood {
            return self.damaged(at, Problem::Record(opcode)).map(|()| None);
        }
        self.at = content_at + length;
        if matches!(entry, Some(Entry::Message(_))) {
            self.recovery.messages += 1;
            self.place = Place { at, number: 0 };
        }
        Ok(entry)
    }

    /// Reads a chunk, whose content begins at `at`.
    fn read_chunk(&mut self, at: u64, length: u64) -> io::Result<()> {
        let record_at = at - RECORD_HEADER as u64;
        let left = self.length - at;
        let mut start = vec![0; length.min(left).min(PLAIN_CHUNK_HEADER as u64 + 32) as usize];
        self.source.read_exact(&mut start)?;
        let Some(header) = ChunkHeader::parse(&start, length) else {
            // Either what was written of the header ends with the file, or it is not one.
            let problem = match length > left && left < PLAIN_CHUNK_HEADER as u64 {
                true => Problem::EndsEarly,
                false => Problem::Record(op::CHUNK),
            };
            return self.damaged(record_at, problem);
        };
        let Some(compression) = Compression::named(&header.compression) else {
            let problem = Problem::Compressed(header.compression);
            self.recovery.note(record_at, problem);
            return self.go_to(at.saturating_add(length).min(self.length));
        };
        let plain = compression == Compression::None;
        let longest = match plain {
            true => header.records.min(left),
            false => header.records.min(left).max(header.uncompressed),
        };
        if longest > LONGEST_RECORD {
            return self.damaged(record_at, Problem::TooLong(longest));
        }
        self.chunked = true;
        let records_at = at + header.records_at;
        self.source.seek(SeekFrom::Start(records_at))?;
        let stored = self.read_content(header.records.min(self.length - records_at))?;
        let cut = length > left;
        let (records, undone) = compression.undo(stored, header.uncompressed);
        if let (Err(problem), false) = (undone, cut) {
            let problem = Problem::Decompression(header.compression, problem);
            self.recovery.note(record_at, problem);
            return self.go_to(at + length);
        }
        // Of a part, there is no telling but by its records.
        if !cut && header.crc != 0 && crc32fast::hash(&records) != header.crc {
            self.recovery.note(record_at, Problem::Checksum);
            return self.go_to(at + length);
        }
        self.next = Place {
            at: record_at,
            number: 0,
        };
        self.chunk = Chunk {
            records,
            next: 0,
            at: records_at,
            plain,
            cut,
        };
        self.at = (at + length.min(left)).min(self.length);
        Ok(())
    }

    /// The next message of the chunk; `None` where it has no more.
    fn next_in_chunk(&mut self) -> Option<Message> {
        while self.chunk.next < self.chunk.records.len() || self.chunk.cut {
            let chunk = std::mem::take(&mut self.chunk);
            let (message, rest) = self.next_record(chunk);
            self.chunk = rest;
            if message.is_some() {
                return message;
            }
        }
        None
    }

    /// Reads the next record of `chunk`, and returns what is left of the chunk.
    fn next_record(&mut self, mut chunk: Chunk) -> (Option<Message>, Chunk) {
        let at = chunk.place();
        let mut records = &chunk.records[chunk.next..];
        let Some((opcode, content)) = record(&mut records) else {
            let problem = match chunk.cut {
                true => Problem::EndsEarly,
                false => Problem::Chunk,
            };
            if chunk.cut {
                self.section = Section::End;
            }
            self.recovery.note(at, problem);
            return (None, Chunk::default());
        };
        // Opcodes from 0x80 on are applications' own.
        let message = match opcode {
            0x80.. => None,
            _ => self.common(opcode, content, at),
        };
        chunk.next += RECORD_HEADER + content.len();
        (message, chunk)
    }

    /// Reads a record that may stand within a chunk or outside. What is wrong with it costs no other record.
    fn common(&mut self, opcode: u8, content: &[u8], at: u64) -> Option<Message> {
        let understood = match opcode {
            op::SCHEMA => self.definitions.add_schema(content),
            op::CHANNEL => self.definitions.add_channel(content),
            op::MESSAGE => match MessageRecord::parse(content) {
                Some(record) => {
                    let message = self.definitions.message(&record);
                    if message.is_none() {
                        self.recovery.note(at, Problem::NoChannel(record.channel));
                    }
                    return message;
                }
                None => None,
            },
            _ => None,
        };
        if understood.is_none() {
            self.recovery.note(at, Problem::Record(opcode));
        }
        None
    }

    /// Reads the record at `self.at` of the summary: all messages are behind it.
    fn read_summary(&mut self) -> io::Result<()> {
        let at = self.at;
        let Some((opcode, length)) = self.read_header()? else {
            return Ok(());
        };
        let content_at = at + RECORD_HEADER as u64;
        let left = self.length - content_at;
        if length > left {
            self.recovery.note(at, Problem::EndsEarly);
            self.section = Section::End;
            return Ok(());
        }
        match opcode {
            op::STATISTICS => {
                let content = self.read_content(length.min(8))?;
                self.recovery.stated = Fields(&content).u64();
            }
            op::FOOTER => {
                self.section = Section::End;
                let mut end = self.read_content(left.min(length + MAGIC.len() as u64))?;
                let magic = end.split_off(end.len().min(length as usize));
                if magic != MAGIC {
                    self.recovery.note(content_at + length, Problem::EndsEarly);
                }
                return Ok(());
            }
            _ => {}
        }
        self.go_to(content_at + length)
    }
}
