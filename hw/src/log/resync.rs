//! Finding whole chunks behind a damaged part.

use std::io::{self, Read, Seek, SeekFrom};

use mcap::records::op;

use super::compression::Compression;
use super::container::{
    ChunkHeader, LONGEST_RECORD, PLAIN_CHUNK_HEADER, RECORD_HEADER, may_begin_chunk, record_header,
};

/// Bytes that are searched at a time.
const WINDOW: usize = 64 << 10;

/// Bytes by which a chunk is known: its record's header, its own, and that of its first record.
const KNOWN_BY: usize = RECORD_HEADER + PLAIN_CHUNK_HEADER + RECORD_HEADER;

/// Where the first chunk at or after `from` begins that is whole by its checksum, or by its compression. `budget` is how many bytes may be
/// read for it, and becomes what is left of it.
pub(super) fn next_chunk(
    source: &mut (impl Read + Seek),
    from: u64,
    length: u64,
    budget: &mut u64,
) -> io::Result<Option<u64>> {
    let mut window = Vec::new();
    let mut at = from;
    while at.saturating_add(KNOWN_BY as u64) <= length {
        source.seek(SeekFrom::Start(at))?;
        let bytes = (length - at).min(WINDOW as u64);
        if *budget < bytes {
            return Ok(None);
        }
        *budget -= bytes;
        window.resize(bytes as usize, 0);
        source.read_exact(&mut window)?;
        for (offset, start) in window.windows(KNOWN_BY).enumerate() {
            let found = at + offset as u64;
            let Some((header, compression)) = chunk(start, length - found) else {
                continue;
            };
            let cost = match compression {
                Compression::None => header.records,
                _ => header.records.saturating_add(header.uncompressed),
            };
            if *budget < cost {
                return Ok(None);
            }
            *budget -= cost;
            let records_at = found + RECORD_HEADER as u64 + header.records_at;
            source.seek(SeekFrom::Start(records_at))?;
            let whole = match compression {
                Compression::None => checksum(source, header.records)? == header.crc,
                _ => is_whole(source, &header, compression)?,
            };
            if whole {
                return Ok(Some(found));
            }
        }
        // The last bytes of a window are the first of the next.
        at += (window.len() - KNOWN_BY + 1) as u64;
    }
    Ok(None)
}

/// What the chunk says of itself that seems to begin with `start`, in a file with `left` bytes from there on.
fn chunk(start: &[u8], left: u64) -> Option<(ChunkHeader, Compression)> {
    let (header, content) = start.split_first_chunk()?;
    let (opcode, length) = record_header(*header);
    if opcode != op::CHUNK || length > LONGEST_RECORD || length > left - RECORD_HEADER as u64 {
        return None;
    }
    let header = ChunkHeader::parse(content, length)?;
    let records = content.get(header.records_at as usize..)?;
    let compression = Compression::named(&header.compression)?;
    let may_be = match compression {
        Compression::None => header.crc != 0 && may_begin_chunk(records, header.records),
        _ => header.uncompressed <= LONGEST_RECORD && compression.may_begin(records),
    };
    may_be.then_some((header, compression))
}

/// Whether the compressed records that come next are whole.
fn is_whole(
    source: &mut impl Read,
    header: &ChunkHeader,
    compression: Compression,
) -> io::Result<bool> {
    let mut stored = vec![0; header.records as usize];
    source.read_exact(&mut stored)?;
    let (records, undone) = compression.undo(stored, header.uncompressed);
    Ok(undone.is_ok() && (header.crc == 0 || crc32fast::hash(&records) == header.crc))
}

/// The checksum of so many bytes that come next.
fn checksum(source: &mut impl Read, length: u64) -> io::Result<u32> {
    let mut hasher = crc32fast::Hasher::new();
    let mut block = [0; 8 << 10];
    let mut left = length;
    while left > 0 {
        let count = left.min(block.len() as u64) as usize;
        source.read_exact(&mut block[..count])?;
        hasher.update(&block[..count]);
        left -= count as u64;
    }
    Ok(hasher.finalize())
}
