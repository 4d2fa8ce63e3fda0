//! Whether a data set is what it says it is.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ops::{ControlFlow, RangeInclusive};
use std::path::Path;

use super::dataset::{DataSet, TOLERANCE};
use super::shard::Array;
use super::shard_file::ShardFile;
use super::{Condition, DataError, Split};

/// Something about a readable data set that will mislead a learner.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Finding {
    /// A condition occurs twice.
    #[error("{second} has the condition of {first}, {condition:?}{}", if .second.split == .first.split { "" } else { ": a split knows what another asks" })]
    Duplicate {
        /// Where it stands first, in the order of the splits.
        first: Place,
        /// Where it stands again.
        second: Place,
        /// The command, then the payload if there is one.
        condition: Vec<f32>,
    },
    /// A motor's smallest or largest value is not that of the normalisation files.
    #[error("motor {} runs from {} to {}, the normalisation files say {} to {}", motor + 1, .found[0], .found[1], .stated[0], .stated[1])]
    MotorRange {
        /// The motor, from 0 (people read it from 1); the payload counts as the last.
        motor: usize,
        /// Range over all splits.
        found: [f64; 2],
        /// Range by the normalisation files.
        stated: [f64; 2],
    },
    /// The farthest point is not as far from the origin as the normalisation files say.
    #[error(
        "the farthest point is {found} m from the origin, the normalisation files say {stated} m"
    )]
    Scale {
        /// Distance over all splits (m).
        found: f64,
        /// Distance by the normalisation files (m).
        stated: f64,
    },
    /// The clouds are of no size that a robot before depth cameras has.
    #[error(
        "the farthest point is {found:.4} m from the origin, expected {} to {} m for a robot before depth cameras: \
         clouds in millimetres or centimetres must be imported as such", PLAUSIBLE.start(), PLAUSIBLE.end()
    )]
    Size {
        /// Distance by the normalisation files (m).
        found: f64,
    },
}

/// Distances of a cloud's farthest point from the origin (m) that can be meant so: depth cameras resolve a millimetre
/// and see some ten metres.
const PLAUSIBLE: RangeInclusive<f64> = 2e-3..=20.0;

impl Finding {
    /// What is wrong with the scale of a data set (m), if anything.
    pub fn of_scale(scale: f64) -> Option<Self> {
        (!PLAUSIBLE.contains(&scale)).then_some(Self::Size { found: scale })
    }
}

/// Where a sample stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The split.
    pub split: Split,
    /// Index in the split.
    pub index: usize,
}

impl std::fmt::Display for Place {
    fn fmt(&self, out: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(out, "sample {} of {}", self.index, self.split.folder())
    }
}

/// Reads all of the data set in `dir` and says what is wrong with it: nothing, where the list is empty. A shard at a
/// time is in memory.
///
/// # Errors
/// [`DataError`] for the first thing that cannot be read: a missing file, a wrong shape or type, a number that is not
/// finite, a normalised copy that does not follow from its original.
pub fn check(dir: &Path) -> Result<Vec<Finding>, DataError> {
    check_with(dir, |_, _| ControlFlow::Continue(()))
}

/// [`check`]; `progress` is called with the shards done and the shards in all, and may ask to stop.
///
/// # Errors
/// As [`check`]; [`DataError::Interrupted`] where `progress` asked for it.
pub fn check_with(
    dir: &Path,
    mut progress: impl FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Vec<Finding>, DataError> {
    let set = DataSet::open(dir)?;
    let mut shards = vec![];
    for split in Split::ALL {
        shards.push((split, set.shards(split)?.paths));
    }
    let steps = shards.iter().map(|(_, paths)| paths.len()).sum();
    let mut done = 0;
    let mut findings = vec![];
    let mut seen = HashMap::new();
    let repeats = set.meta().is_some_and(|meta| meta.cycle().is_some());
    let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; set.normalisation().motor_min.len()];
    let mut radius: f64 = 0.0;
    for (split, paths) in shards {
        let mut index = 0;
        for path in paths {
            let (conditions, far) = check_shard(&set, &path)?;
            radius = radius.max(far);
            for condition in conditions {
                for (range, value) in ranges.iter_mut().zip(condition.to_vec()) {
                    *range = [range[0].min(value), range[1].max(value)];
                }
                let second = Place { split, index };
                match seen.entry(condition.key()) {
                    Entry::Vacant(vacant) => drop(vacant.insert(second)),
                    // Repeats of a command are all in one split.
                    Entry::Occupied(first) if repeats && first.get().split == split => {}
                    Entry::Occupied(first) => findings.push(Finding::Duplicate {
                        first: *first.get(),
                        second,
                        condition: condition.values().collect(),
                    }),
                }
                index += 1;
            }
            done += 1;
            if progress(done, steps).is_break() {
                return Err(DataError::Interrupted);
            }
        }
    }
    let units = set.normalisation();
    for (motor, found) in ranges.into_iter().enumerate() {
        let stated = [units.motor_min[motor], units.motor_max[motor]];
        let slack = f64::from(TOLERANCE) * (stated[1] - stated[0]).max(f64::MIN_POSITIVE);
        if std::iter::zip(found, stated).any(|(a, b)| (a - b).abs() > slack) {
            findings.push(Finding::MotorRange {
                motor,
                found,
                stated,
            });
        }
    }
    if (radius - units.scale).abs() > f64::from(TOLERANCE) * units.scale {
        findings.push(Finding::Scale {
            found: radius,
            stated: units.scale,
        });
    }
    findings.extend(Finding::of_scale(units.scale));
    Ok(findings)
}

/// Checks one shard's arrays against each other; returns its conditions, and the farthest point's distance (m).
fn check_shard(set: &DataSet, path: &Path) -> Result<(Vec<Condition>, f64), DataError> {
    let shard = ShardFile::open(path, &Array::SHARD)?;
    let units = set.normalisation();
    let (batch, scale) = (shard.read_batch()?, units.scale as f32);
    let samples = shard.sizes().samples;
    let motors = units.conditions(&batch.motors);
    shard.require_values(Array::MotorsNorm, &motors, TOLERANCE)?;
    shard.require_values(Array::Center, &vec![0.0; 3 * samples], TOLERANCE * scale)?;
    shard.require_values(Array::Scale, &vec![scale; samples], TOLERANCE * scale)?;
    let norm = |p: &[f32; 3]| p.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    let radius = batch
        .data
        .as_chunks()
        .0
        .iter()
        .map(norm)
        .fold(0.0, f64::max);
    let mut points = batch.data;
    units.normalise_points(&mut points);
    shard.require_values(Array::DataNorm, &points, TOLERANCE)?;
    let conditions = shard.sizes().conditions(&batch.motors).collect();
    Ok((conditions, radius))
}
