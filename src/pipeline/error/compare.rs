//! Why two data sets were not compared.

use std::path::PathBuf;

use thiserror::Error;

/// Why two data sets, or a data set and the simulator, cannot be compared.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CompareError {
    /// They have commands of different lengths.
    #[error(
        "commands of the first data set have {} numbers, those of the second {}: expected data sets of robots with as many \
         motors",
        found[0],
        found[1]
    )]
    OtherMotors {
        /// Motors of each.
        found: [usize; 2],
    },
    /// No configuration is in both.
    #[error(
        "no configuration of the first data set is one of the second within {tolerance} of each motor's range: expected the \
         same commands and payloads, in the same units"
    )]
    NothingInCommon {
        /// Allowed difference, as a part of a motor's range.
        tolerance: f64,
    },
    /// No index is in both.
    #[error(
        "no sample of the first data set has the place of one in the second: expected samples in the same split"
    )]
    NoCommonIndex,
    /// A data set does not say which robot it shows, and that is to be simulated.
    #[error("{} does not say which robot it shows, so that it cannot be simulated", path.display())]
    NoRobot {
        /// Folder of the data set.
        path: PathBuf,
    },
}
