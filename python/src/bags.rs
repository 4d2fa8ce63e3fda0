//! Logs of rigs for other tools.

use std::path::PathBuf;

use pyo3::prelude::*;
use tdcr::hw::log;

use crate::errors::{Failure, Outcome};
use crate::run;

/// What a bag has: by topic its type and its messages; messages left out; whether all of the log could be read.
type Written = (Vec<(String, &'static str, u64)>, u64, bool);

/// Writes a log as a bag of ROS 2.
#[pyfunction]
pub fn export_rosbag2(py: Python<'_>, file: PathBuf, out: PathBuf) -> Outcome<Written> {
    let bag = run::long(py, None, |_| log::export_rosbag2(&file, &out))?
        .map_err(|error| Failure::Of("DataError", error.to_string()))?;
    let topics = (bag.topics.into_iter()).map(|(topic, (kind, messages))| (topic, kind, messages));
    Ok((topics.collect(), bag.left_out, bag.recovery.is_whole()))
}
