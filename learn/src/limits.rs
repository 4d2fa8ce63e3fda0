//! How much memory a file may ask for.
//!
//! A small file can describe a large array: by compression, by chunks that are not stored, by a number in a header. What
//! is allocated for a file is at most [`EXPANSION`] times its length and [`ALLOWANCE`] more, and a file is read into
//! memory up to a length that its reader names. Clouds and weights are noise in their last bits: no honest file comes
//! near.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Bytes of memory for each byte of a file. Clouds that were recorded compress to a half, with most of their points
/// missing to a tenth.
const EXPANSION: u64 = 16;

/// Bytes of memory for any file, however small.
const ALLOWANCE: u64 = 64 << 20;

/// Most bytes of a file of clouds or weights that is read into memory as a whole.
pub(crate) const MAX_FILE: u64 = 4 << 30;

/// Most bytes of a file of JSON.
pub(crate) const MAX_JSON: u64 = 64 << 20;

/// A file that asks for more memory than its length warrants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "it asks for {asked} bytes of memory; expected at most {limit}, {EXPANSION} times the {held} bytes that the file \
     holds and {} MiB", ALLOWANCE >> 20
)]
pub struct OverLimit {
    /// Bytes of memory asked for, [`u64::MAX`] where they are even more.
    pub asked: u64,
    /// Length of the file (bytes).
    pub held: u64,
    /// Most bytes that a file of this length may ask for.
    pub limit: u64,
}

/// Refuses a file of `held` bytes that asks for more memory than that warrants.
pub(crate) fn require(asked: u64, held: u64) -> Result<(), OverLimit> {
    let limit = held.saturating_mul(EXPANSION).saturating_add(ALLOWANCE);
    match asked <= limit {
        true => Ok(()),
        false => Err(OverLimit { asked, held, limit }),
    }
}

/// Bytes of an array, [`u64::MAX`] where they are even more.
pub(crate) fn bytes(shape: &[u64], element: u64) -> u64 {
    shape
        .iter()
        .fold(element, |product, &size| product.saturating_mul(size))
}

/// Reads a file of at most `most` bytes. Devices and pipes, whose length nobody knows, are read up to there.
pub(crate) fn read_file(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = File::open(path)?;
    let mut bytes = Vec::new();
    let length = file.metadata()?.len();
    if length <= most {
        // Room for one byte more, which tells that the file has ended.
        bytes.reserve_exact(length as usize + 1);
        file.take(most + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 <= most {
            return Ok(bytes);
        }
    }
    let reason = format!("longer than {most} bytes, the most that is read");
    Err(io::Error::new(io::ErrorKind::FileTooLarge, reason))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_may_ask_for_a_multiple_of_what_it_holds() {
        assert_eq!(require(ALLOWANCE, 0), Ok(()));
        assert_eq!(require(ALLOWANCE + 160, 10), Ok(()));
        let error = require(ALLOWANCE + 161, 10).expect_err("a byte too many");
        assert_eq!(
            error.to_string(),
            "it asks for 67109025 bytes of memory; expected at most 67109024, 16 times the 10 bytes that the file holds \
             and 64 MiB"
        );
        assert!(require(u64::MAX, u64::MAX).is_ok());
        assert_eq!(bytes(&[u64::MAX, 3], 4), u64::MAX);
    }

    #[test]
    fn a_file_without_an_end_is_read_no_further_than_its_limit() {
        let error = read_file(Path::new("/dev/zero"), 1000).expect_err("an endless file");
        assert_eq!(error.kind(), io::ErrorKind::FileTooLarge);
        assert_eq!(
            error.to_string(),
            "longer than 1000 bytes, the most that is read"
        );
    }
}
