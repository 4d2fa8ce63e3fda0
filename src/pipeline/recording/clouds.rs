//! Recordings whose rows are clouds of a robot at rest: data sets, and logs of captures.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};
use tdcr_base::files;
use tdcr_hw::recorded::{LoggedCloud, LoggedClouds};
use tdcr_learn::data::{DataError, DataSet, Meta, Split};
use tdcr_sim::chain::Configuration;
use tdcr_sim::inverse::recording::{Order, Recording, Shown};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Drive, Robot};

use super::{BadRow, MOST_ROWS, RecordingFile, RecordingFileError};

/// Points of a cloud that are used, at most.
const CLOUD_POINTS: usize = 200;
/// Points of all clouds together that are used, at most, as far as each cloud keeps [`FEWEST`].
const ALL_POINTS: usize = 60_000;
const FEWEST: usize = 20;
/// Samples that are in memory at a time with all their points.
const AT_A_TIME: usize = 64;
/// First bytes of an MCAP file.
const MCAP: &[u8] = b"\x89MCAP0\r\n";

/// What a recording is on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// A table of markers.
    Table,
    /// A folder with a data set.
    DataSet,
    /// The log of a rig.
    Log,
}

impl Source {
    /// A folder is a data set; a log is told by its name or its first bytes.
    pub fn of(path: &Path) -> Self {
        let begins = || -> std::io::Result<Vec<u8>> {
            let mut bytes = Vec::new();
            let mut start = files::open(path)?.take(MCAP.len() as u64);
            start.read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        let named = |extension: &std::ffi::OsStr| extension.eq_ignore_ascii_case("mcap");
        if path.is_dir() {
            Self::DataSet
        } else if path.extension().is_some_and(named) || begins().is_ok_and(|b| b == MCAP) {
            Self::Log
        } else {
            Self::Table
        }
    }

    /// Whether rows are clouds.
    pub fn has_clouds(self) -> bool {
        self != Self::Table
    }
}

impl RecordingFile {
    /// Reads some splits of the data set in the folder `dir`: each sample is a row. Conditions are commands of `robot`; `frame` is the
    /// pose of the clouds' frame in the world (m).
    ///
    /// Splits without samples are left out where another one has some.
    pub(super) fn of_data_set(
        dir: &Path,
        splits: &[Split],
        robot: &Robot,
        frame: Isometry3<f64>,
    ) -> Result<Self, RecordingFileError> {
        let set = DataSet::open(dir)?;
        let mut rows = Rows::new(robot, frame, base_of(set.meta()));
        let mut missing = None;
        for &split in splits {
            match rows.add_split(&set, split, dir) {
                Ok(()) => {}
                Err(RecordingFileError::DataSet(
                    error @ (DataError::NoShards { .. } | DataError::EmptySplit { .. }),
                )) => {
                    missing = Some(error);
                }
                Err(error) => return Err(error),
            }
        }
        match missing {
            Some(error) if rows.is_empty() => Err(error.into()),
            _ => Ok(rows.finish()),
        }
    }

    /// Reads the log at `path`: each sample of a capture is a row, or where there is none each cloud after a command. A sample that
    /// was captured again counts once, the last time.
    pub(super) fn of_log(
        path: &Path,
        robot: &Robot,
        frame: Isometry3<f64>,
    ) -> Result<Self, RecordingFileError> {
        let mut clouds = LoggedClouds::open(path)?;
        let (mut samples, mut others) = (BTreeMap::new(), BTreeMap::new());
        while let Some(mut next) = clouds.next_cloud()? {
            next.cloud.colors = Vec::new();
            thin(&mut next.cloud.points);
            match next.sample {
                Some(sample) => samples.insert(sample, next),
                None => others.insert(others.len() as u64, next),
            };
            let found = samples.len().max(others.len());
            if found > MOST_ROWS {
                let path = path.to_owned();
                return Err(RecordingFileError::TooManyRows { path, found });
            }
        }
        let chosen: BTreeMap<u64, LoggedCloud> = match samples.is_empty() {
            true => others,
            false => samples,
        };
        if chosen.is_empty() {
            return Err(RecordingFileError::NoClouds {
                path: path.to_owned(),
            });
        }
        // A log does not say whether the base was in sight; the data set that it was written beside does.
        let set = path.parent().and_then(|dir| DataSet::open(dir).ok());
        let mut rows = Rows::new(robot, frame, base_of(set.as_ref().and_then(DataSet::meta)));
        for (number, logged) in &chosen {
            let (command, points) = (&logged.command, &logged.cloud.points);
            rows.add(path, *number as usize, "", command, 0.0, points)?;
        }
        Ok(rows.finish())
    }
}

/// Whether a data set's clouds show the base.
fn base_of(meta: Option<&Meta>) -> bool {
    meta.and_then(Meta::base) == Some(BaseVisibility::Shown)
}

/// Leaves [`CLOUD_POINTS`] points at most, evenly spread over the cloud.
fn thin(points: &mut Vec<[f32; 3]>) {
    let count = points.len();
    if count > CLOUD_POINTS {
        let kept = (0..CLOUD_POINTS).map(|k| points[k * count / CLOUD_POINTS]);
        *points = kept.collect();
    }
}

/// A recording in the making.
struct Rows<'a> {
    robot: &'a Robot,
    /// Lengths of the tendons in the straight pose (m).
    lengths: Vec<f64>,
    frame: Isometry3<f64>,
    file: RecordingFile,
}

impl<'a> Rows<'a> {
    fn new(robot: &'a Robot, frame: Isometry3<f64>, base: bool) -> Self {
        let straight = Configuration::straight(robot);
        Self {
            robot,
            lengths: robot.tendon_kinematics(&straight).0,
            frame,
            file: RecordingFile {
                recording: Recording {
                    shown: Shown::of(robot.spec(), base),
                    order: Order::AtRest,
                    ..Recording::default()
                },
                patterns: Vec::new(),
                lines: Vec::new(),
                bad: Vec::new(),
            },
        }
    }

    fn is_empty(&self) -> bool {
        self.file.recording.is_empty() && self.file.bad.is_empty()
    }

    fn add_split(
        &mut self,
        set: &DataSet,
        split: Split,
        dir: &Path,
    ) -> Result<(), RecordingFileError> {
        let samples = set.samples(split)?;
        set.require_some(split, samples.len())?;
        let found = self.file.recording.len() + samples.len();
        if found > MOST_ROWS {
            let path = dir.to_owned();
            return Err(RecordingFileError::TooManyRows { path, found });
        }
        for first in (0..samples.len()).step_by(AT_A_TIME) {
            let some = samples.read(first..samples.len().min(first + AT_A_TIME))?;
            for (number, mut sample) in (first..).zip(some) {
                let motors = sample.condition.motors.iter();
                let command: Vec<f64> = motors.map(|&motor| motor.into()).collect();
                let payload = sample.condition.payload.unwrap_or(0.0).into();
                thin(&mut sample.cloud.points);
                let points = &sample.cloud.points;
                self.add(dir, number, split.folder(), &command, payload, points)?;
            }
        }
        Ok(())
    }

    /// Adds a row, or tells what is wrong with it.
    fn add(
        &mut self,
        path: &Path,
        number: usize,
        pattern: &str,
        command: &[f64],
        payload: f64,
        points: &[[f32; 3]],
    ) -> Result<(), RecordingFileError> {
        let (found, tendons) = (command.len(), self.lengths.len());
        if found != tendons {
            return Err(RecordingFileError::Commands {
                path: path.to_owned(),
                found,
                tendons,
            });
        }
        let coordinates = points.iter().flatten().map(|&x| f64::from(x));
        let mut numbers = command.iter().copied().chain([payload]).chain(coordinates);
        let wrong = match points {
            [] => Some("its cloud has no point"),
            _ if numbers.any(|x| !x.is_finite()) => Some("a number is not finite"),
            _ if payload < 0.0 => Some("its payload is below 0 kg"),
            _ => None,
        };
        if let Some(reason) = wrong {
            self.file.bad.push(BadRow {
                line: number,
                reason: reason.to_owned(),
            });
            return Ok(());
        }
        let pull = |(t, &command): (usize, &f64)| match self.robot.tendons()[t].drive {
            Drive::Tension => command,
            Drive::Gain(_) | Drive::Length => self.lengths[t] - command,
        };
        let place =
            |p: &[f32; 3]| -> Vector3<f64> { (self.frame * Point3::from(p.map(f64::from))).coords };
        let pulls = command.iter().enumerate().map(pull).collect();
        let cloud = points.iter().map(place).collect();
        let recording = &mut self.file.recording;
        recording.times.push(recording.times.len() as f64);
        recording.pulls.push(pulls);
        recording.points.push(Vec::new());
        recording.clouds.push(cloud);
        recording.payloads.push(payload);
        self.file.patterns.push(pattern.to_owned());
        self.file.lines.push(number);
        Ok(())
    }

    fn finish(mut self) -> RecordingFile {
        let recording = &mut self.file.recording;
        let each = ALL_POINTS / recording.len().max(1);
        recording.thin_clouds(each.clamp(FEWEST, CLOUD_POINTS));
        self.file
    }
}
