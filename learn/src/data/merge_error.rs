//! Why folders are not the parts of one data set.

use std::path::PathBuf;

use tdcr_base::Part;

/// Why folders are not the parts of one data set.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MergeError {
    /// No folder was given.
    #[error("there are no parts to merge, expected the folders of all parts of a data set")]
    NoParts,
    /// A folder holds no part.
    #[error("{} holds {found}, expected a part of a data set", .path.display())]
    NotAPart {
        /// The folder.
        path: PathBuf,
        /// What it holds.
        found: &'static str,
    },
    /// A part is of another data set than the first one.
    #[error(
        "{} holds a part of another data set than {}: its `{field}` is {found}, not {expected}; expected parts collected with \
         the same options by the same version of tdcr",
        .path.display(), .first.display()
    )]
    OtherSet {
        /// The part's folder.
        path: PathBuf,
        /// Folder of the first part.
        first: PathBuf,
        /// The first field that differs, as a dotted path into `meta.json`; `parts` for the number of parts.
        field: String,
        /// The value of the first part.
        expected: String,
        /// The value found.
        found: String,
    },
    /// A part is there twice.
    #[error("{} and {} both hold {part}, expected each part once", .paths[0].display(), .paths[1].display())]
    Twice {
        /// The two folders.
        paths: [PathBuf; 2],
        /// The part.
        part: Part,
    },
    /// Parts are not there.
    #[error(
        "{} of {of} parts {} missing: {}; expected all {of}",
        .missing.len(), if .missing.len() == 1 { "is" } else { "are" }, listed(.missing)
    )]
    Missing {
        /// Numbers of the missing parts.
        missing: Vec<usize>,
        /// Number of parts in all.
        of: usize,
    },
    /// A part was interrupted, or is still being collected.
    #[error(
        "{} holds {part} unfinished: {missing} of its {samples} samples are missing; expected a finished part, collect it again \
         to resume",
        .path.display()
    )]
    Unfinished {
        /// The folder.
        path: PathBuf,
        /// The part.
        part: Part,
        /// Samples that are missing.
        missing: usize,
        /// Samples of the part.
        samples: usize,
    },
}

/// Numbers of parts in words; the first ones, where there are many.
fn listed(numbers: &[usize]) -> String {
    const MOST: usize = 10;
    let first: Vec<_> = numbers.iter().take(MOST).map(ToString::to_string).collect();
    let more = if numbers.len() > MOST { ", ..." } else { "" };
    format!("{}{more}", first.join(", "))
}
