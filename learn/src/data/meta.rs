//! What a data set was made with.

use std::fs;
use std::io;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::RobotSpec;

use super::{DataError, split::MIN_SAMPLES};

/// File name of a complete data set's [`Meta`].
pub(super) const META_FILE: &str = "meta.json";

/// Everything needed to make a data set again; stored beside it as `meta.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Version of the layout on disk: [`Meta::FORMAT`].
    pub format: u32,
    /// Version of `tdcr` that made the data set.
    pub tdcr_version: String,
    /// Seed of the commands, of the clouds' sampling and of the splits.
    pub seed: u64,
    /// Number of samples, all splits together.
    pub count: usize,
    /// Motors per sample `D`.
    pub motors: usize,
    /// Points per cloud `N`.
    pub points_per_cloud: usize,
    /// Samples in each shard, the last of a split excepted.
    pub samples_per_shard: usize,
    /// Edge length of the voxel grid that thinned the clouds (m).
    pub voxel_size: f64,
    /// The robot, and the cameras that saw it.
    pub robot: RobotSpec,
    /// Whether the robot's base was in view.
    pub base: BaseVisibility,
}

impl Meta {
    /// Version of the layout that this crate reads and writes.
    pub const FORMAT: u32 = 1;

    /// Reads `path`; `None` where there is no such file.
    pub(super) fn load(path: &Path) -> Result<Option<Self>, DataError> {
        let bytes = match fs::read(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            bytes => bytes.map_err(DataError::io("read", path))?,
        };
        let meta: Self = serde_json::from_slice(&bytes).map_err(|source| DataError::Json {
            path: path.to_owned(),
            source,
        })?;
        meta.validate().map_err(|problem| DataError::InvalidJson {
            path: path.to_owned(),
            problem: problem.to_string(),
        })?;
        Ok(Some(meta))
    }

    /// The contents of `meta.json`.
    pub(super) fn to_json(&self) -> Vec<u8> {
        let mut bytes =
            serde_json::to_vec_pretty(self).expect("a struct of plain values serialises");
        bytes.push(b'\n');
        bytes
    }

    /// Refuses values of which no data set can be made.
    pub(super) fn validate(&self) -> Result<(), DataError> {
        let invalid = |field, found: &dyn std::fmt::Display, expected| {
            Err(DataError::InvalidMeta {
                field,
                found: found.to_string(),
                expected,
            })
        };
        if self.format != Self::FORMAT {
            return invalid("format", &self.format, "1, the version this program knows");
        }
        if self.count < MIN_SAMPLES {
            return Err(DataError::TooFewSamples { count: self.count });
        }
        for (field, value) in [
            ("motors", self.motors),
            ("points_per_cloud", self.points_per_cloud),
            ("samples_per_shard", self.samples_per_shard),
        ] {
            if value == 0 {
                return invalid(field, &value, "at least 1");
            }
        }
        if !(self.voxel_size.is_finite() && self.voxel_size > 0.0) {
            return invalid("voxel_size", &self.voxel_size, "a finite length above 0");
        }
        Ok(())
    }

    /// Refuses `found`, the meta of the data set in `folder`, unless it is `self`.
    pub(super) fn require_same(&self, found: &Self, folder: &Path) -> Result<(), DataError> {
        let as_value =
            |meta: &Self| serde_json::to_value(meta).expect("a struct of plain values serialises");
        match first_difference("", &as_value(self), &as_value(found)) {
            None => Ok(()),
            Some((field, wanted, found)) => Err(DataError::OtherSet {
                path: folder.to_owned(),
                field,
                wanted,
                found,
            }),
        }
    }
}

/// Dotted path of the first value in which `wanted` and `found` differ, and the two values there.
fn first_difference(path: &str, wanted: &Value, found: &Value) -> Option<(String, String, String)> {
    match (wanted, found) {
        (Value::Object(a), Value::Object(b)) => a.keys().chain(b.keys()).find_map(|key| {
            let path = if path.is_empty() {
                key.clone()
            } else {
                format!("{path}.{key}")
            };
            first_difference(
                &path,
                a.get(key).unwrap_or(&Value::Null),
                b.get(key).unwrap_or(&Value::Null),
            )
        }),
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => std::iter::zip(a, b)
            .enumerate()
            .find_map(|(k, (a, b))| first_difference(&format!("{path}[{k}]"), a, b)),
        _ if wanted == found => None,
        _ => Some((path.to_owned(), wanted.to_string(), found.to_string())),
    }
}
