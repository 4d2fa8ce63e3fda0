//! Reading a data set from disk.

use std::fs;
use std::path::{Path, PathBuf};

use super::folder::STAGING;
use super::meta::{META_FILE, Meta};
use super::part::PartFolder;
use super::shard::{Array, Sizes};
use super::shard_file::ShardFile;
use crate::channels::Channels;

use super::{CloudSet, Condition, DataError, Normalisation, Sample, Split};

/// How far a normalised copy may stray from what the normalisation files say: far above rounding, far below a
/// difference in meaning. Dimensionless; for a scale, a fraction of it.
pub(super) const TOLERANCE: f32 = 1e-4;

/// A data set on disk: one of ours, or another program's in the same layout.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSet {
    dir: PathBuf,
    meta: Option<Meta>,
    normalisation: Normalisation,
}

impl DataSet {
    /// Opens the data set in the folder `dir`.
    ///
    /// # Errors
    /// [`DataError::Incomplete`] if collecting was interrupted, [`DataError::Unmerged`] for a part of a set,
    /// [`DataError::NoDataSet`] if none was begun; else as [`Normalisation::load`], and the same for a `meta.json` that is
    /// there.
    pub fn open(dir: &Path) -> Result<Self, DataError> {
        let meta = Meta::load(&dir.join(META_FILE))?;
        if meta.is_none()
            && let Some(found) = PartFolder::load(dir)?
        {
            return Err(DataError::Unmerged {
                path: dir.to_owned(),
                part: found.part,
            });
        }
        if meta.is_none() && dir.join(STAGING).exists() {
            return Err(DataError::Incomplete {
                path: dir.to_owned(),
            });
        }
        if meta.is_none() && !Normalisation::is_in(dir) {
            return Err(DataError::NoDataSet {
                path: dir.to_owned(),
            });
        }
        Ok(Self {
            dir: dir.to_owned(),
            meta,
            normalisation: Normalisation::load(dir)?,
        })
    }

    /// What the data set was made with; `None` for another program's.
    pub fn meta(&self) -> Option<&Meta> {
        self.meta.as_ref()
    }

    /// The normalisation over all splits.
    pub fn normalisation(&self) -> &Normalisation {
        &self.normalisation
    }

    /// Reads a split in metres: 15 bytes of memory a point. It has no sample only where the data set has fewer than ten.
    ///
    /// # Errors
    /// [`DataError::NoShards`], [`DataError::SampleCount`], and whatever is wrong with a shard, by file and dataset.
    pub fn read_split(&self, split: Split) -> Result<Vec<Sample>, DataError> {
        let shards = self.shards(split)?;
        let mut samples = Vec::with_capacity(shards.sizes.samples);
        for path in &shards.paths {
            let batch = ShardFile::open(path, &Array::SHARD)?.read_batch()?;
            samples.extend(batch.samples());
        }
        Ok(samples)
    }

    /// Reads the conditions of a split alone.
    ///
    /// # Errors
    /// As [`read_split`](Self::read_split).
    pub fn conditions(&self, split: Split) -> Result<Vec<Condition>, DataError> {
        let mut conditions = vec![];
        for path in &self.shards(split)?.paths {
            let shard = ShardFile::open(path, &Array::SHARD)?;
            let motors = shard.read_floats(Array::Motors)?;
            conditions.extend(shard.sizes().conditions(&motors));
        }
        Ok(conditions)
    }

    /// Number of points in each cloud of a split.
    ///
    /// # Errors
    /// As [`read_split`](Self::read_split), of what the shards' headers tell.
    pub fn points_per_cloud(&self, split: Split) -> Result<usize, DataError> {
        Ok(self.shards(split)?.sizes.points)
    }

    /// Reads a split in the units that a network sees, without colours: 12 bytes of memory a point.
    ///
    /// Points and commands are normalised as they are read; the copies `motors_norm` and `scale` in the shards serve
    /// to check that their writer meant the same normalisation.
    ///
    /// # Errors
    /// As [`read_split`](Self::read_split), [`DataError::EmptySplit`], and [`DataError::Disagrees`] for a copy that does not match.
    pub fn cloud_set(&self, split: Split) -> Result<CloudSet, DataError> {
        self.cloud_set_in(split, &self.normalisation, Channels::Xyz)
    }

    /// Reads a split in the units of another normalisation, as [`cloud_set`](Self::cloud_set), and with colours where
    /// `channels` has them: 3 more bytes a point.
    ///
    /// # Errors
    /// As [`cloud_set`](Self::cloud_set); [`DataError::ConditionLength`] where `units` is of another number of motors.
    pub fn cloud_set_in(
        &self,
        split: Split,
        units: &Normalisation,
        channels: Channels,
    ) -> Result<CloudSet, DataError> {
        units.require_length(self.normalisation.motor_min.len())?;
        let shards = self.shards(split)?;
        self.require_some(split, shards.sizes.samples)?;
        let Sizes {
            samples,
            points,
            values,
            ..
        } = shards.sizes;
        let mut set = CloudSet {
            condition_dim: values,
            points_per_cloud: points,
            conditions: Vec::with_capacity(samples * values),
            points: Vec::with_capacity(samples * points * 3),
            colors: match channels {
                Channels::Xyz => None,
                Channels::XyzRgb => Some(Vec::with_capacity(samples * points * 3)),
            },
            starts: None,
        };
        for path in &shards.paths {
            let shard = ShardFile::open(path, &Array::SHARD)?;
            let motors = shard.read_floats(Array::Motors)?;
            let conditions = self.normalisation.conditions(&motors);
            let scale = self.normalisation.scale as f32;
            let samples = shard.sizes().samples;
            shard.require_values(Array::MotorsNorm, &conditions, TOLERANCE)?;
            shard.require_values(Array::Center, &vec![0.0; 3 * samples], TOLERANCE * scale)?;
            shard.require_values(Array::Scale, &vec![scale; samples], TOLERANCE * scale)?;
            set.conditions.extend(units.conditions(&motors));
            set.points.extend(shard.read_floats(Array::Data)?);
            if let Some(colors) = &mut set.colors {
                colors.extend(shard.read_colors()?);
            }
        }
        units.normalise_points(&mut set.points);
        Ok(set)
    }

    /// Refuses a split of no samples.
    ///
    /// # Errors
    /// [`DataError::EmptySplit`] unless there are some.
    pub fn require_some(&self, split: Split, samples: usize) -> Result<(), DataError> {
        match samples {
            0 => Err(DataError::EmptySplit {
                path: self.dir.clone(),
                split: split.folder(),
            }),
            _ => Ok(()),
        }
    }

    /// Finds a split's shards and checks that they fit together.
    pub(super) fn shards(&self, split: Split) -> Result<Shards, DataError> {
        let dir = self.dir.join(split.folder());
        let paths = shard_paths(&dir)?;
        let mut points = self.meta.as_ref().map(|meta| meta.points_per_cloud);
        let values = self.normalisation.motor_min.len();
        let mut payload = self.meta.as_ref().map(Meta::has_payload);
        let mut counts = vec![];
        for path in &paths {
            let found = ShardFile::open(path, &Array::SHARD)?.sizes();
            let expected = Sizes {
                samples: found.samples,
                points: *points.get_or_insert(found.points),
                values,
                payload: *payload.get_or_insert(found.payload),
            };
            if found.payload != expected.payload {
                return Err(DataError::PayloadArray {
                    path: path.clone(),
                    expected: expected.payload,
                });
            }
            for array in [Array::Data, Array::Motors] {
                if array.shape(found) != array.shape(expected) {
                    return Err(DataError::WrongShape {
                        path: path.clone(),
                        dataset: array.name(),
                        expected: format!(
                            "{:?} as in the rest of the data set",
                            array.shape(expected)
                        ),
                        found: array.shape(found),
                    });
                }
            }
            counts.push(found.samples);
        }
        let samples = counts.iter().sum();
        let is_empty = self
            .meta
            .as_ref()
            .is_some_and(|meta| meta.split_size(split) == 0);
        let Some(points) = points.filter(|_| samples > 0 || is_empty) else {
            return Err(DataError::NoShards { path: dir });
        };
        if let Some(meta) = &self.meta {
            let expected = meta.split_size(split);
            if samples != expected {
                return Err(DataError::SampleCount {
                    path: dir,
                    expected,
                    found: samples,
                });
            }
        }
        Ok(Shards {
            paths,
            counts,
            sizes: Sizes {
                samples,
                points,
                values,
                payload: payload.unwrap_or(false),
            },
        })
    }
}

/// The shards of one split.
pub(super) struct Shards {
    pub(super) paths: Vec<PathBuf>,
    /// Samples in each of them.
    pub(super) counts: Vec<usize>,
    /// Samples in all of them.
    pub(super) sizes: Sizes,
}

/// Paths of `shard-*.h5` in `dir`, in name order.
fn shard_paths(dir: &Path) -> Result<Vec<PathBuf>, DataError> {
    let mut paths = vec![];
    for entry in fs::read_dir(dir).map_err(DataError::io("list", dir))? {
        let path = entry.map_err(DataError::io("list", dir))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with("shard-") && name.ends_with(".h5") {
            paths.push(path);
        }
    }
    paths.sort_unstable();
    Ok(paths)
}
