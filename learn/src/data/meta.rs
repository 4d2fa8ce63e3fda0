//! What a data set was made with.

use std::io;
use std::path::Path;

use tdcr_base::files::{LARGEST_TEXT, read_text, write_atomically};

use super::DataError;
use super::conditions::{Design, PayloadRange};
use super::sample_count::{MAX_SAMPLES, MIN_SAMPLES};
use super::shard::Sizes;
use super::simulator::{Recipe, Subject};
use super::split::{require_count, split_size};
use super::{Split, SplitIndices, split_indices};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tdcr_sim::cloud::VoxelGrid;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::RobotSpec;
use tdcr_sim::scene::Scene;

/// File name of a complete data set's [`Meta`].
pub(super) const META_FILE: &str = "meta.json";

/// Most motors: as many as a network takes.
const MAX_MOTORS: usize = 4096;

/// Most points of a cloud: far above any camera's.
const MAX_POINTS: usize = 10_000_000;

/// Everything needed to make a data set again; stored beside it as `meta.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Version of the layout on disk: [`Meta::FORMAT`].
    pub format: u32,
    /// Version of `tdcr` that made the data set.
    pub tdcr_version: String,
    /// Seed of the conditions, of the clouds' sampling and of the splits.
    pub seed: u64,
    /// Number of samples, all splits together.
    pub count: usize,
    /// Motors per sample.
    pub motors: usize,
    /// Points per cloud `N`.
    pub points_per_cloud: usize,
    /// Samples in each shard, the last of a split excepted.
    pub samples_per_shard: usize,
    /// Where the samples come from.
    pub origin: Origin,
}

/// Where samples come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(clippy::large_enum_variant, reason = "there is one for each data set")]
#[non_exhaustive]
pub enum Origin {
    /// Simulation: what it takes, with the seed, to make them again.
    Simulated {
        /// Robot, cameras, base, payloads and voxels.
        recipe: Recipe,
        /// How the conditions were chosen.
        design: Design,
    },
    /// A rig of servos and cameras, real or simulated.
    Recorded {
        /// What it was.
        recording: Recording,
    },
    /// Files of another program, or of a real robot.
    Imported {
        /// What they were, for people.
        source: String,
        /// Which sample is in which split; `None` where chance decides.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        split: Option<SplitIndices>,
    },
}

/// What a data set was recorded of, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Name of the rig.
    pub rig: String,
    /// Its robot, watched by its cameras.
    pub robot: RobotSpec,
    /// Whether the base is in the clouds.
    pub base: BaseVisibility,
    /// Edge of the voxel grid that thinned the fused clouds (m).
    pub voxel_size: f64,
    /// Number of commands after which they come again, so that sample `i` has command `i % cycle`: all samples of a command are in
    /// the same split. `None` where each sample has a command of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cycle: Option<usize>,
    /// Payloads (kg) that hung at the tip, one after another, each for as many samples as the others; none where conditions have
    /// no payload.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub payloads: Vec<f64>,
    /// What else of the rig decides about commands and clouds.
    pub settings: Value,
}

impl Recording {
    /// Smallest payload besides 0 and largest; `None` where none hung there.
    fn payload(&self) -> Option<PayloadRange> {
        let loaded = self.payloads.iter().copied().filter(|&mass| mass != 0.0);
        (!self.payloads.is_empty()).then(|| PayloadRange {
            min: loaded.clone().fold(f64::INFINITY, f64::min),
            max: loaded.fold(0.0, f64::max),
        })
    }

    /// What was seen, where payloads hung at the robot.
    fn loaded(&self) -> Option<Subject> {
        self.payload().map(|payload| Subject {
            robot: self.robot.clone(),
            base: self.base,
            payload: Some(payload),
            scene: Scene::default(),
            obstacles: None,
        })
    }
}

impl Origin {
    /// How the clouds were simulated; `None` for others.
    pub fn recipe(&self) -> Option<&Recipe> {
        match self {
            Self::Simulated { recipe, .. } => Some(recipe),
            Self::Recorded { .. } | Self::Imported { .. } => None,
        }
    }

    /// Fewest samples of a data set. A first try on a rig is one or two.
    fn fewest_samples(&self) -> usize {
        match self {
            Self::Simulated { .. } | Self::Imported { .. } => MIN_SAMPLES,
            Self::Recorded { .. } => 1,
        }
    }

    /// Samples that are stored at once, and at worst lost: those of a rig, each of which takes seconds of its time, one by one.
    pub(super) fn block(&self) -> usize {
        match self {
            Self::Simulated { .. } | Self::Imported { .. } => 8,
            Self::Recorded { .. } => 1,
        }
    }
}

impl Meta {
    /// Version of the layout that this crate reads and writes.
    pub const FORMAT: u32 = 2;

    /// Reads `path`; `None` where there is no such file.
    pub(super) fn load(path: &Path) -> Result<Option<Self>, DataError> {
        let text = match read_text(path, LARGEST_TEXT) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            text => text.map_err(DataError::io("read", path))?,
        };
        let json = |source| DataError::Json {
            path: path.to_owned(),
            source,
        };
        // The version says how to read the rest.
        let version: Version = serde_json::from_str(&text).map_err(json)?;
        version.require_known(path)?;
        let meta: Self = serde_json::from_str(&text).map_err(json)?;
        meta.validate().map_err(|problem| DataError::InvalidJson {
            path: path.to_owned(),
            problem: problem.to_string(),
        })?;
        Ok(Some(meta))
    }

    /// Writes `meta.json` in the folder `dir`.
    pub(super) fn save(&self, dir: &Path) -> Result<(), DataError> {
        save_json(&dir.join(META_FILE), self)
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
            return invalid("format", &self.format, "2, the version this program knows");
        }
        require_count(self.count, self.origin.fewest_samples())?;
        for (field, value, most, expected) in [
            ("motors", self.motors, MAX_MOTORS, "1 to 4096"),
            (
                "points_per_cloud",
                self.points_per_cloud,
                MAX_POINTS,
                "1 to 10000000",
            ),
            (
                "samples_per_shard",
                self.samples_per_shard,
                MAX_SAMPLES,
                "1 to 10000000",
            ),
        ] {
            if !(1..=most).contains(&value) {
                return invalid(field, &value, expected);
            }
        }
        if let Some(problem) = self.given_split().and_then(|split| split.fault(self.count)) {
            return invalid("split", &problem, "every sample in one split, none empty");
        }
        if let Origin::Recorded { recording } = &self.origin
            && !VoxelGrid::is_size(recording.voxel_size)
        {
            let expected = VoxelGrid::EXPECTED_SIZE;
            return invalid("voxel_size", &recording.voxel_size, expected);
        }
        if let Origin::Recorded { recording } = &self.origin
            && recording.cycle == Some(0)
        {
            return invalid("cycle", &0, "1 or more commands");
        }
        if let Origin::Recorded { recording } = &self.origin
            && let Some(range) = recording.payload()
        {
            range.check()?;
        }
        self.origin.recipe().map_or(Ok(()), Recipe::check)
    }

    /// What the clouds show, as far as conditions depend on it; `None` where they were neither simulated nor recorded with payloads.
    pub fn subject(&self) -> Option<Subject> {
        match &self.origin {
            Origin::Simulated { recipe, .. } => Some(recipe.subject.clone()),
            Origin::Recorded { recording } => recording.loaded(),
            Origin::Imported { .. } => None,
        }
    }

    /// The robot that the clouds show; `None` where nobody says.
    pub fn robot(&self) -> Option<&RobotSpec> {
        match &self.origin {
            Origin::Simulated { recipe, .. } => Some(&recipe.subject.robot),
            Origin::Recorded { recording } => Some(&recording.robot),
            Origin::Imported { .. } => None,
        }
    }

    /// Whether the base is in the clouds; `None` where nobody says.
    pub fn base(&self) -> Option<BaseVisibility> {
        match &self.origin {
            Origin::Simulated { recipe, .. } => Some(recipe.subject.base),
            Origin::Recorded { recording } => Some(recording.base),
            Origin::Imported { .. } => None,
        }
    }

    /// Whether the conditions have payloads.
    pub fn has_payload(&self) -> bool {
        match &self.origin {
            Origin::Simulated { recipe, .. } => recipe.subject.payload.is_some(),
            Origin::Recorded { recording } => !recording.payloads.is_empty(),
            Origin::Imported { .. } => false,
        }
    }

    /// Values of a condition `D`: the motors, and the payload if there is one.
    pub fn condition_dim(&self) -> usize {
        self.motors + usize::from(self.has_payload())
    }

    /// Sizes of so many samples.
    pub(super) fn sizes(&self, samples: usize) -> Sizes {
        Sizes {
            samples,
            points: self.points_per_cloud,
            values: self.condition_dim(),
            payload: self.has_payload(),
        }
    }

    /// Which samples are in which split.
    pub(super) fn splits(&self) -> Result<SplitIndices, DataError> {
        match (self.given_split(), self.cycle()) {
            (Some(split), _) => Ok(split.clone()),
            (None, Some(cycle)) => Ok(split_indices(cycle, self.seed)?.repeated(self.count, cycle)),
            (None, None) => split_indices(self.count, self.seed),
        }
    }

    /// Samples of a split.
    pub(super) fn split_size(&self, split: Split) -> usize {
        match (self.given_split(), self.cycle()) {
            (Some(given), _) => given.of(split).len(),
            (None, Some(_)) => self.splits().map_or(0, |splits| splits.of(split).len()),
            (None, None) => split_size(self.count, split),
        }
    }

    /// Number of commands after which they come again, where that is less than all.
    pub(super) fn cycle(&self) -> Option<usize> {
        match &self.origin {
            Origin::Recorded { recording } => recording.cycle.filter(|&cycle| cycle < self.count),
            Origin::Simulated { .. } | Origin::Imported { .. } => None,
        }
    }

    fn given_split(&self) -> Option<&SplitIndices> {
        match &self.origin {
            Origin::Simulated { .. } | Origin::Recorded { .. } => None,
            Origin::Imported { split, .. } => split.as_ref(),
        }
    }

    /// Whether the data set `found` in `folder` is to grow to `self`; false where it is `self`.
    ///
    /// # Errors
    /// [`DataError::OtherSet`] where they differ in more than their number of samples, [`DataError::OtherCount`] where
    /// `found` cannot grow to that of `self`.
    pub(super) fn grows_from(&self, found: &Self, folder: &Path) -> Result<bool, DataError> {
        let resized = Self {
            count: found.count,
            ..self.clone()
        };
        resized.require_same(found, folder)?;
        let reason = match &self.origin {
            _ if self.count == found.count => return Ok(false),
            _ if self.count < found.count => "a data set can grow, not shrink".to_owned(),
            Origin::Simulated { design, .. } if design.can_grow() => return Ok(true),
            Origin::Simulated { design, .. } => {
                let name = design.name();
                format!("the places of a {name} design depend on how many there are")
            }
            // Each command follows from its index.
            Origin::Recorded { .. } => return Ok(true),
            Origin::Imported { .. } => "its clouds were imported all at once".to_owned(),
        };
        Err(DataError::OtherCount {
            path: folder.to_owned(),
            found: found.count,
            expected: self.count,
            reason,
        })
    }

    /// Dotted path of the first field in which `found` differs, the value there of `self`, and that of `found`.
    pub(super) fn difference(&self, found: &Self) -> Option<(String, String, String)> {
        let as_value =
            |meta: &Self| serde_json::to_value(meta).expect("a struct of plain values serialises");
        first_difference("", &as_value(self), &as_value(found))
    }

    /// Refuses `found`, the meta of the data set in `folder`, unless it is `self`.
    fn require_same(&self, found: &Self, folder: &Path) -> Result<(), DataError> {
        match self.difference(found) {
            None => Ok(()),
            Some((field, expected, found)) => Err(DataError::OtherSet {
                path: folder.to_owned(),
                field,
                expected,
                found,
            }),
        }
    }
}

/// What every version of a meta says.
#[derive(Deserialize)]
pub(super) struct Version {
    format: u32,
}

impl Version {
    /// Refuses the meta in the file `path` unless this program knows its layout.
    pub(super) fn require_known(&self, path: &Path) -> Result<(), DataError> {
        match self.format {
            Meta::FORMAT => Ok(()),
            format => Err(DataError::InvalidJson {
                path: path.to_owned(),
                problem: format!(
                    "the data set is of format {format}, expected {}, the version this program knows",
                    Meta::FORMAT
                ),
            }),
        }
    }
}

/// Writes plain values as a file of JSON that is whole or not there.
pub(super) fn save_json(path: &Path, values: &impl Serialize) -> Result<(), DataError> {
    let mut bytes = serde_json::to_vec_pretty(values).expect("plain values serialise");
    bytes.push(b'\n');
    write_atomically(path, |file| io::Write::write_all(file, &bytes))
        .map_err(DataError::io("write", path))
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
