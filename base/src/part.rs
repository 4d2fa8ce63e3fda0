//! One of several parts that a large job is cut into, each for a process or a machine of its own.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::Serialize;

/// Most parts.
const MOST: usize = 10_000_000;

/// Which part of a job: `number` of `of`, counted from 1; as text `I/N`.
///
/// Part `I` of `N` of a job of `count` pieces has those from `(I - 1) count / N` to before `I count / N`, rounded down: none,
/// where there are more parts than pieces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Part {
    number: usize,
    of: usize,
}

/// Text or numbers that name no part.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{found}` is no part, expected I/N, two whole numbers with 1 <= I <= N <= {MOST}, such as 2/7"
)]
pub struct InvalidPart {
    /// What was found.
    pub found: String,
}

impl Part {
    /// Part `number` of `of`.
    ///
    /// # Errors
    /// [`InvalidPart`] unless `1 <= number <= of <= 10000000`.
    pub fn new(number: usize, of: usize) -> Result<Self, InvalidPart> {
        if (1..=of).contains(&number) && of <= MOST {
            return Ok(Self { number, of });
        }
        Err(InvalidPart {
            found: format!("{number}/{of}"),
        })
    }

    /// Which part, from 1.
    pub fn number(self) -> usize {
        self.number
    }

    /// Number of parts in all.
    pub fn of(self) -> usize {
        self.of
    }

    /// The part's pieces of a job of `count` pieces, counted from 0.
    pub fn range(self, count: usize) -> Range<usize> {
        let end_of = |parts: usize| (parts as u128 * count as u128 / self.of as u128) as usize;
        end_of(self.number - 1)..end_of(self.number)
    }
}

impl fmt::Display for Part {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        write!(out, "part {} of {}", self.number, self.of)
    }
}

/// Reads `I/N`.
impl FromStr for Part {
    type Err = InvalidPart;

    fn from_str(text: &str) -> Result<Self, InvalidPart> {
        let numbers = text.split_once('/').and_then(|(number, of)| {
            let whole = |digits: &str| digits.parse().ok();
            Some((whole(number)?, whole(of)?))
        });
        let (number, of) = numbers.ok_or_else(|| InvalidPart {
            found: text.to_owned(),
        })?;
        Self::new(number, of)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn parts_have_every_piece_once_in_order_and_are_of_equal_size(count in 0..3000_usize, of in 1..4000_usize) {
            let mut end = 0;
            for number in 1..=of {
                let pieces = Part::new(number, of).unwrap().range(count);
                prop_assert_eq!(pieces.start, end);
                prop_assert!((count / of..=count.div_ceil(of)).contains(&pieces.len()));
                end = pieces.end;
            }
            prop_assert_eq!(end, count);
        }
    }

    #[test]
    fn a_part_is_two_whole_numbers_of_which_the_first_counts_up_to_the_second() {
        let part: Part = "2/7".parse().unwrap();
        assert_eq!((part.number(), part.of()), (2, 7));
        assert_eq!(part.to_string(), "part 2 of 7");
        let largest: Part = "10000000/10000000".parse().unwrap();
        assert_eq!(largest.range(10_000_000), 9_999_999..10_000_000);
        for text in [
            "",
            "2",
            "0/3",
            "4/3",
            "1/0",
            "-1/3",
            "1/3/3",
            "1.0/3",
            "1/10000001",
            "a/b",
        ] {
            let error = text.parse::<Part>().unwrap_err().to_string();
            let expected = format!("`{text}` is no part, expected I/N");
            assert!(error.starts_with(&expected), "{error}");
        }
    }
}
