//! A data set in numbers.

use std::path::{Path, PathBuf};

use serde::Serialize;
use tdcr_learn::data::{DataError, Meta, Origin};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::CommandUnit;

use crate::pipeline::{PipelineError, Survey};
use crate::report::MotorGroup;

/// Obstacles that are named in a phrase.
const MOST_NAMED: usize = 10;

/// A data set in numbers.
#[derive(Clone, Debug, Serialize)]
pub struct SetInfo {
    /// Its folder.
    pub dir: PathBuf,
    /// Name of the robot; `None` where the data set does not say.
    pub robot: Option<String>,
    /// Whether the base is in view; `None` where the data set does not say.
    pub base: Option<bool>,
    /// Names of the obstacles around the robot; `None` where the data set does not say.
    pub obstacles: Option<Vec<String>>,
    /// What the data set was made from.
    pub origin: String,
    /// Samples of the train split.
    pub train: usize,
    /// Samples of the val split.
    pub val: usize,
    /// Samples of the test split.
    pub test: usize,
    /// Points of a cloud; `None` where the data set does not say.
    pub points: Option<usize>,
    /// Smallest and largest value of each motor.
    pub motors: Vec<[f64; 2]>,
    /// Unit of each motor's values; `None` where the data set does not say.
    pub motor_units: Vec<Option<&'static str>>,
    /// Its payloads; `None` where it has none.
    pub payload: Option<PayloadInfo>,
    /// The largest distance of a point from the world's origin (m).
    pub scale: f64,
    /// Size on disk (bytes).
    pub bytes: u64,
}

/// The payloads of a data set.
#[derive(Clone, Debug, Serialize)]
pub struct PayloadInfo {
    /// Smallest and largest payload (kg).
    pub range: [f64; 2],
    /// Samples whose payload is exactly 0.
    pub zeros: usize,
}

impl SetInfo {
    /// Of the data set in the folder `dir`, which `survey` has read.
    ///
    /// # Errors
    /// [`PipelineError::Data`] where the size of its files cannot be read.
    pub fn new(dir: &Path, survey: &Survey) -> Result<Self, PipelineError> {
        let [train, val, test] = survey.counts;
        let meta = survey.set.meta();
        let origin = match meta.map(|meta| &meta.origin) {
            Some(Origin::Simulated { design, .. }) => {
                let seed = meta.map_or(0, |meta| meta.seed);
                format!("simulation, {} design, seed {seed}", design.name())
            }
            Some(Origin::Recorded { recording }) => format!(
                "recording of robot {} on rig {}, seed {}",
                recording.robot.name,
                recording.rig,
                meta.map_or(0, |meta| meta.seed)
            ),
            Some(Origin::Imported { source, .. }) => format!("import of {source}"),
            _ => "another program".to_owned(),
        };
        let units = survey.normalisation();
        let ends = units.motor_min.iter().zip(&units.motor_max);
        let ends = ends.map(|(low, high)| [*low, *high]);
        let mut motors: Vec<[f64; 2]> = ends.collect();
        let payloads = survey.payloads();
        let payload = match payloads.as_slice() {
            [] => None,
            payloads => motors.pop().map(|range| PayloadInfo {
                range,
                zeros: payloads.iter().filter(|&&mass| mass == 0.0).count(),
            }),
        };
        let robot = survey.robot();
        let motor_units = MotorGroup::of(robot, motors.len()).into_iter();
        let motor_units = motor_units.flat_map(|group| {
            let unit = group.unit.map(CommandUnit::symbol);
            group.motors.map(move |_| unit)
        });
        Ok(Self {
            motor_units: motor_units.collect(),
            dir: dir.to_owned(),
            robot: robot.map(|robot| robot.name.clone()),
            base: (meta.and_then(Meta::base)).map(|base| base == BaseVisibility::Shown),
            obstacles: (meta.and_then(Meta::subject)).map(|subject| {
                let obstacles = subject.scene.obstacles().iter();
                obstacles.map(|obstacle| obstacle.name.clone()).collect()
            }),
            origin,
            train,
            val,
            test,
            points: meta.map(|meta| meta.points_per_cloud),
            motors,
            payload,
            scale: units.scale,
            bytes: bytes_in(dir).map_err(|source| DataError::Io {
                action: "read",
                path: dir.to_owned(),
                source,
            })?,
        })
    }

    /// What there is to say, as name and value.
    pub fn facts(&self) -> Vec<(String, String)> {
        let unknown = || "not known".to_owned();
        let base = self
            .base
            .map(|base| if base { "in view" } else { "not in view" });
        let samples = self.train + self.val + self.test;
        let payload = self.payload.as_ref().map(|payload| {
            let [low, high] = payload.range;
            let share = 100.0 * payload.zeros as f64 / samples as f64;
            format!("{low:.4} to {high:.4} kg, {share:.1} % exactly 0")
        });
        let mut facts = vec![
            ("Robot", self.robot.clone().unwrap_or_else(unknown)),
            ("Base", base.map_or_else(unknown, str::to_owned)),
            ("Made from", self.origin.clone()),
            (
                "Samples",
                format!("{} train, {} val, {} test", self.train, self.val, self.test),
            ),
            (
                "Points per cloud",
                self.points
                    .map_or_else(unknown, |points| points.to_string()),
            ),
            (
                "Motors",
                format!("{}, {}", self.tendons(), self.motor_ranges()),
            ),
            ("Payloads", payload.unwrap_or_else(|| "none".to_owned())),
            ("Scale", format!("{:.4} m", self.scale)),
            ("On disk", format!("{:.1} MB", self.bytes as f64 / 1e6)),
        ];
        // Recordings and imported sets have no scene.
        if let Some(obstacles) = self.obstacles_phrase() {
            let numbers = self.motors.len() - self.tendons();
            let moved = match numbers {
                0 => obstacles,
                _ => format!("{obstacles}; moved by {numbers} numbers of a sample (m, rad)"),
            };
            facts.insert(2, ("Obstacles", moved));
        }
        (facts.into_iter())
            .map(|(name, value)| (name.to_owned(), value))
            .collect()
    }
}

impl SetInfo {
    /// How many obstacles there are, and their names.
    fn obstacles_phrase(&self) -> Option<String> {
        let names = self.obstacles.as_ref()?;
        let (named, more) = names.split_at(names.len().min(MOST_NAMED));
        let more = match more.len() {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        Some(match names.len() {
            0 => "none".to_owned(),
            count => format!("{count}: {}{more}", named.join(", ")),
        })
    }

    /// How many of the motors pull tendons: those behind them move obstacles.
    fn tendons(&self) -> usize {
        match self.robot {
            Some(_) => self.motor_units.iter().flatten().count(),
            None => self.motors.len(),
        }
    }

    /// Smallest and largest value over the motors of each unit.
    fn motor_ranges(&self) -> String {
        let mut ranges: Vec<(Option<&str>, [f64; 2])> = Vec::new();
        let tendons = self.motor_units.iter().zip(&self.motors);
        for (&unit, &[low, high]) in tendons.take(self.tendons()) {
            match ranges.iter_mut().find(|range| range.0 == unit) {
                Some((_, range)) => *range = [range[0].min(low), range[1].max(high)],
                None => ranges.push((unit, [low, high])),
            }
        }
        let texts = ranges.iter().map(|(unit, [low, high])| {
            let unit = unit.unwrap_or("in motor units");
            format!("values from {low:.5} to {high:.5} {unit}")
        });
        texts.collect::<Vec<_>>().join(", ")
    }
}

/// Size of all files in a folder (bytes).
fn bytes_in(dir: &Path) -> std::io::Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(dir)? {
        let entry = entry?;
        bytes += match entry.file_type()?.is_dir() {
            true => bytes_in(&entry.path())?,
            false => entry.metadata()?.len(),
        };
    }
    Ok(bytes)
}
