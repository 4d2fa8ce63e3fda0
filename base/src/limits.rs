//! How much memory a file may ask for.
//!
//! A small file can describe a large array: by compression, by chunks that are not stored, by a number in a header. What
//! is allocated for a file is at most 16 times its length and 64 MiB more. Clouds and weights are noise
//! in their last bits: no honest file comes near.

/// Bytes of memory for each byte of a file. Clouds that were recorded compress to a half, with most of their points
/// missing to a tenth.
const EXPANSION: u64 = 16;

/// Bytes of memory for any file, however small.
const ALLOWANCE: u64 = 64 << 20;

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

/// Refuses a file of `held` bytes that asks for `asked` bytes of memory, where that is more than its length warrants.
///
/// # Errors
/// [`OverLimit`].
pub fn require(asked: u64, held: u64) -> Result<(), OverLimit> {
    let limit = held.saturating_mul(EXPANSION).saturating_add(ALLOWANCE);
    match asked <= limit {
        true => Ok(()),
        false => Err(OverLimit { asked, held, limit }),
    }
}

/// Bytes of an array of elements of `element` bytes, [`u64::MAX`] where they are even more.
pub fn bytes(shape: &[u64], element: u64) -> u64 {
    shape
        .iter()
        .fold(element, |product, &size| product.saturating_mul(size))
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
}
