//! Compressed chunks, as most tools that write MCAP make them by default.
//!
//! What a chunk says of its size bounds what is taken of it, so that no memory is filled by a few bytes that stand for many.

use std::io::{self, Read};

/// How the records of a chunk are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Zstd,
    Lz4,
}

impl Compression {
    /// The one that a chunk names; `None` for one that is not known here.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "" => Some(Self::None),
            "zstd" => Some(Self::Zstd),
            "lz4" => Some(Self::Lz4),
            _ => None,
        }
    }

    /// Whether a chunk's records may begin with these bytes.
    pub fn may_begin(self, records: &[u8]) -> bool {
        match self {
            Self::None => true,
            // Frames' magic numbers (RFC 8878, and the LZ4 frame format).
            Self::Zstd => records.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]),
            Self::Lz4 => records.starts_with(&[0x04, 0x22, 0x4d, 0x18]),
        }
    }

    /// The records in the bytes `stored` of a chunk, which are to be `size` bytes: those up to where they end early or make no
    /// sense, and what is wrong there.
    pub fn undo(self, stored: Vec<u8>, size: u64) -> (Vec<u8>, Result<(), String>) {
        let decoder: io::Result<Box<dyn Read + '_>> = match self {
            Self::None => return (stored, Ok(())),
            Self::Zstd => zstd::stream::read::Decoder::with_buffer(&stored[..])
                .map(|decoder| Box::new(decoder) as Box<dyn Read>),
            Self::Lz4 => {
                lz4::Decoder::new(&stored[..]).map(|decoder| Box::new(decoder) as Box<dyn Read>)
            }
        };
        let mut records = Vec::new();
        // One byte more than there may be tells that there are more.
        let read = decoder.and_then(|decoder| {
            decoder
                .take(size.saturating_add(1))
                .read_to_end(&mut records)
        });
        let found = records.len() as u64;
        let whole = match read {
            Err(error) => Err(error.to_string()),
            Ok(_) if found > size => {
                Err(format!("it has more than the {size} bytes that it states"))
            }
            Ok(_) if found < size => {
                Err(format!("it has {found} of the {size} bytes that it states"))
            }
            Ok(_) => Ok(()),
        };
        records.truncate(size as usize);
        (records, whole)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::io::Write;

    use super::*;

    fn zstd_of(bytes: &[u8]) -> Vec<u8> {
        zstd::encode_all(bytes, 3).unwrap()
    }

    fn lz4_of(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
        encoder.write_all(bytes).unwrap();
        let (stored, ended) = encoder.finish();
        ended.unwrap();
        stored
    }

    #[test]
    fn what_was_compressed_comes_back_and_no_more_than_it_states() {
        let bytes: Vec<u8> = (0..200_000_u32).map(|k| (k % 251) as u8).collect();
        for (compression, stored) in [
            (Compression::Zstd, zstd_of(&bytes)),
            (Compression::Lz4, lz4_of(&bytes)),
        ] {
            assert!(compression.may_begin(&stored));
            let size = bytes.len() as u64;
            assert_eq!(
                compression.undo(stored.clone(), size),
                (bytes.clone(), Ok(()))
            );
            // A few bytes that stand for many give as many as they state.
            let (some, problem) = compression.undo(stored.clone(), 1000);
            assert!(some == bytes[..1000] && problem.is_err());
            let (all, problem) = compression.undo(stored.clone(), size + 1);
            assert!(all == bytes && problem.is_err());
            // What is there of a part is its beginning.
            let (some, problem) = compression.undo(stored[..stored.len() / 2].to_vec(), size);
            assert!(bytes.starts_with(&some) && problem.is_err());
            assert!(compression.undo(b"neither".to_vec(), size).1.is_err());
        }
    }

    #[test]
    fn a_bomb_takes_no_more_memory_than_it_states() {
        let stored = zstd_of(&vec![0; 64 << 20]);
        assert!(stored.len() < 1 << 14);
        let (some, problem) = Compression::Zstd.undo(stored, 1 << 10);
        assert!(some.capacity() < 1 << 16 && problem.is_err());
    }
}
