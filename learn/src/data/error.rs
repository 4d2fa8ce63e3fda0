//! What can be wrong with a data set.

use std::io;
use std::path::{Path, PathBuf};

use tdcr_base::Part;
use tdcr_base::limits::OverLimit;

use super::exchange::EXTENSIONS;
use super::merge_error::MergeError;
use super::sample_count::{MAX_SAMPLES, MIN_SAMPLES};

/// Why a data set could not be made or read. Every variant says what was found, where, and what would be right.
///
/// A data set is a folder, a `dataset` an array in an HDF5 file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DataError {
    /// The operating system refused: a missing or unwritable path, a full disk, an I/O error.
    #[error("cannot {action} {}: {source}", .path.display())]
    Io {
        /// What was tried, as a verb.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// A file is not HDF5, is truncated or is corrupt.
    #[error("{}: cannot read {what}: {reason}", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The part that could not be read: the file, or a named dataset in it.
        what: String,
        /// The HDF5 reader's reason.
        reason: String,
    },
    /// A dataset that the layout demands is not in the file.
    #[error("{}: no dataset `{dataset}`, expected one of shape {expected}", .path.display())]
    MissingDataset {
        /// The file.
        path: PathBuf,
        /// The dataset's name.
        dataset: &'static str,
        /// The shape it should have, in symbols.
        expected: &'static str,
    },
    /// A dataset's shape differs from the layout's, or from the other datasets' in the file.
    #[error("{}: dataset `{dataset}` has shape {found:?}, expected {expected}", .path.display())]
    WrongShape {
        /// The file.
        path: PathBuf,
        /// The dataset's name.
        dataset: &'static str,
        /// The shape it should have.
        expected: String,
        /// The shape it has.
        found: Vec<u64>,
    },
    /// A dataset's element type differs from the layout's.
    #[error("{}: dataset `{dataset}` has elements of type {found}, expected {expected}", .path.display())]
    WrongType {
        /// The file.
        path: PathBuf,
        /// The dataset's name.
        dataset: &'static str,
        /// The type it should have.
        expected: &'static str,
        /// The type it has.
        found: String,
    },
    /// A dataset asks for more memory than the length of its file warrants.
    #[error("{}: dataset `{dataset}` of shape {found:?}: {source}", .path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The dataset's name.
        dataset: &'static str,
        /// The shape it claims.
        found: Vec<u64>,
        /// How much it asks for, and how much it may.
        source: OverLimit,
    },
    /// A dataset holds a NaN or an infinity.
    #[error("{}: dataset `{dataset}`: sample {sample} holds {found}, expected finite numbers", .path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The dataset's name.
        dataset: &'static str,
        /// Row of the first such value, counted within the file.
        sample: usize,
        /// The value.
        found: f32,
    },
    /// A normalised copy does not follow from the raw values and the data set's normalisation.
    #[error("{}: dataset `{dataset}`: sample {sample} holds {found}, expected {expected} by the normalisation files", .path.display())]
    Disagrees {
        /// The file.
        path: PathBuf,
        /// The dataset's name.
        dataset: &'static str,
        /// Row of the first such value, counted within the file.
        sample: usize,
        /// What the normalisation files say.
        expected: f32,
        /// The value.
        found: f32,
    },
    /// A JSON file does not parse, or lacks a field.
    #[error("{}: {source}", .path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Line, column and reason.
        source: serde_json::Error,
    },
    /// A JSON file parses but its values make no sense.
    #[error("{}: {problem}", .path.display())]
    InvalidJson {
        /// The file.
        path: PathBuf,
        /// What was found, and what would be right.
        problem: String,
    },
    /// A field of [`Meta`](super::Meta) makes no sense.
    #[error("data set field `{field}` is {found}, expected {expected}")]
    InvalidMeta {
        /// The field.
        field: &'static str,
        /// Its value.
        found: String,
        /// The values it may take.
        expected: &'static str,
    },
    /// A file of another program could not be read.
    #[error(transparent)]
    CloudFile(#[from] super::CloudFileError),
    /// A folder to import without clouds.
    #[error(
        "no file in {} ends in {EXTENSIONS}: there is no cloud to import{}", .path.display(), endings(.found)
    )]
    NoClouds {
        /// The folder.
        path: PathBuf,
        /// How files in it end.
        found: Vec<String>,
    },
    /// A design of experiments without points for the data set.
    #[error("{problem}")]
    Design {
        /// What was asked for, and what would be right.
        problem: String,
    },
    /// The robot has fewer commands than are asked for.
    #[error(
        "the conditions repeat themselves after {index}, expected {count} different ones; the ranges of the robot's tendons are too narrow"
    )]
    NotUnique {
        /// Index of the first condition that could not be unlike all before.
        index: usize,
        /// Conditions asked for.
        count: usize,
    },
    /// A shard has payloads and others of its data set have none, or the reverse.
    #[error("{}: {} dataset `payload`, unlike the rest of the data set", .path.display(), if *.expected { "no" } else { "a" })]
    PayloadArray {
        /// The file.
        path: PathBuf,
        /// Whether it should have payloads.
        expected: bool,
    },
    /// Too few samples to fill the three splits.
    #[error("{found} samples cannot be split 80/10/10, expected at least {fewest}")]
    TooFewSamples {
        /// The number of samples.
        found: usize,
        /// The fewest there may be.
        fewest: usize,
    },
    /// A split that has no sample is to be learned from, or scored on.
    #[error(
        "{} has no sample in {split}, as the whole data set has fewer than {MIN_SAMPLES}: add some", path.display()
    )]
    EmptySplit {
        /// The data set's folder.
        path: PathBuf,
        /// Name of the split.
        split: &'static str,
    },
    /// Too many samples for their indices to fit into memory.
    #[error("{found} samples cannot be split, expected at most {MAX_SAMPLES}")]
    TooManySamples {
        /// The number of samples.
        found: usize,
    },
    /// The folder holds a data set made with other settings.
    #[error("{} holds another data set: its `{field}` is {found}, not {expected}; choose another folder", .path.display())]
    OtherSet {
        /// The folder.
        path: PathBuf,
        /// The first field that differs, as a dotted path into `meta.json`.
        field: String,
        /// The value asked for.
        expected: String,
        /// The value found.
        found: String,
    },
    /// The folder holds a data set with another number of samples, which cannot become this one.
    #[error(
        "{} holds {found} samples and `samples` is {expected}: {reason}; ask for {found}, or choose another folder",
        .path.display()
    )]
    OtherCount {
        /// The folder.
        path: PathBuf,
        /// Samples of the set there.
        found: usize,
        /// Samples asked for.
        expected: usize,
        /// Why the one does not become the other.
        reason: String,
    },
    /// The folder holds another part of a data set than the one that is collected there, or one of the two is a whole set.
    #[error("{} holds {}, expected {}; choose another folder", .path.display(), of_a_set(.found), of_a_set(.expected))]
    OtherPart {
        /// The folder.
        path: PathBuf,
        /// The part found; `None` for a whole set.
        found: Option<Part>,
        /// The part to be collected; `None` for a whole set.
        expected: Option<Part>,
    },
    /// The folder holds a part of a data set, and nothing but [`merge`](super::merge()) reads parts.
    #[error(
        "{} holds {}; merge all {} first",
        .path.display(), of_a_set(&Some(*.part)), .part.of()
    )]
    Unmerged {
        /// The folder.
        path: PathBuf,
        /// The part.
        part: Part,
    },
    /// Folders cannot be merged to a data set.
    #[error(transparent)]
    Merge(Box<MergeError>),
    /// The caller asked to stop. What was done is kept.
    #[error("interrupted; the same call goes on")]
    Interrupted,
    /// The folder holds something that is not a data set.
    #[error("{} holds `{found}` and is no data set of ours, expected a new, an empty or a data set's folder", .path.display())]
    ForeignFolder {
        /// The folder.
        path: PathBuf,
        /// An entry that does not belong to a data set.
        found: String,
    },
    /// A folder that is to hold clouds, and only those of one export, holds something.
    #[error("{} holds `{found}`, expected an empty folder, or a new one", .path.display())]
    NotEmpty {
        /// The folder.
        path: PathBuf,
        /// An entry in it.
        found: String,
    },
    /// Another collector is writing to the folder.
    #[error("{} is being written by another process, expected to be the only one", .path.display())]
    InUse {
        /// The folder.
        path: PathBuf,
    },
    /// The data set is complete: nothing can be added.
    #[error("{} holds a complete data set, which takes no more samples", .path.display())]
    Complete {
        /// The folder.
        path: PathBuf,
    },
    /// The data set is not complete: samples are missing, or collecting was interrupted before the shards were made.
    #[error("{} holds an unfinished data set, expected a complete one; collect or merge again to resume", .path.display())]
    Incomplete {
        /// The folder.
        path: PathBuf,
    },
    /// A split has no sample of an index.
    #[error("there is no sample {index}, expected 0 to {}", .count - 1)]
    NoSample {
        /// The index.
        index: usize,
        /// Samples of the split, at least 1.
        count: usize,
    },
    /// Samples were handed over that do not form a block.
    #[error("samples {first}..{end} are not one block, expected a range of `missing_blocks`")]
    NotABlock {
        /// Index of the first sample.
        first: usize,
        /// One past the index of the last sample.
        end: usize,
    },
    /// A sample does not fit the data set.
    #[error("sample {index}: {problem}")]
    InvalidSample {
        /// Index of the sample.
        index: usize,
        /// What was found, and what would be right.
        problem: String,
    },
    /// A folder that is not there, or holds nothing of a data set.
    #[error("there is no data set in {}", .path.display())]
    NoDataSet {
        /// The folder.
        path: PathBuf,
    },
    /// A folder holds no shard.
    #[error("{} holds no shard, expected shard-00000.h5 and so on", .path.display())]
    NoShards {
        /// The folder.
        path: PathBuf,
    },
    /// A split does not hold the number of samples that `meta.json` calls for.
    #[error("{} holds {found} samples, expected {expected} by meta.json", .path.display())]
    SampleCount {
        /// The split's folder.
        path: PathBuf,
        /// Samples called for.
        expected: usize,
        /// Samples found.
        found: usize,
    },
    /// A command's length differs from the data set's.
    #[error("the command has {found} values, expected {expected}")]
    ConditionLength {
        /// Dimension of the data set's conditions.
        expected: usize,
        /// Dimension given.
        found: usize,
    },
}

impl From<MergeError> for DataError {
    fn from(error: MergeError) -> Self {
        Self::Merge(Box::new(error))
    }
}

impl DataError {
    /// For `map_err`: an operating-system error while doing `action` (a verb) to `path`.
    pub(super) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io {
            action,
            path: path.to_owned(),
            source,
        }
    }
}

/// How files end, in words.
fn endings(found: &[String]) -> String {
    match found {
        [] => String::new(),
        found => format!("; its files end in {}", found.join(", ")),
    }
}

/// A part in words, or a whole data set.
fn of_a_set(part: &Option<Part>) -> String {
    part.map_or("a whole data set".to_owned(), |part| {
        format!("{part} of a data set")
    })
}
