//! `tdcr data info`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use tdcr::learn::data::Origin;
use tdcr::pipeline::Survey;
use tdcr::report::MotorGroup;
use tdcr::sim::render::BaseVisibility;
use tdcr::sim::robot::CommandUnit;

use super::{Console, Dirs};

/// Summarise data sets: robot, splits, ranges
#[derive(Debug, Args)]
pub(in crate::cli) struct InfoArgs {
    #[command(flatten)]
    dirs: Dirs,
}

/// A data set in numbers.
#[derive(Serialize)]
pub(super) struct Info {
    dir: PathBuf,
    /// Name of the robot; `null` where the data set does not say.
    robot: Option<String>,
    /// Whether the base is in view; `null` where the data set does not say.
    base: Option<bool>,
    /// What the data set was made from.
    origin: String,
    train: usize,
    val: usize,
    test: usize,
    points: Option<usize>,
    /// Smallest and largest value of each motor.
    motors: Vec<[f64; 2]>,
    /// Unit of each motor's values; `null` where the data set does not say.
    motor_units: Vec<Option<&'static str>>,
    payload: Option<PayloadInfo>,
    /// The largest distance of a point from the world's origin (m).
    scale: f64,
    /// Size on disk (bytes).
    bytes: u64,
}

#[derive(Serialize)]
struct PayloadInfo {
    /// Smallest and largest payload (kg).
    range: [f64; 2],
    /// Samples whose payload is exactly 0.
    zeros: usize,
}

impl Info {
    pub fn new(dir: &Path, survey: &Survey) -> anyhow::Result<Self> {
        let [train, val, test] = survey.counts;
        let subject = survey.recipe().map(|recipe| &recipe.subject);
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
        let robot = subject.map(|subject| &subject.robot);
        let motor_units = MotorGroup::of(robot, motors.len()).into_iter();
        let motor_units = motor_units.flat_map(|group| {
            let unit = group.unit.map(CommandUnit::symbol);
            group.motors.map(move |_| unit)
        });
        Ok(Self {
            motor_units: motor_units.collect(),
            dir: dir.to_owned(),
            robot: subject.map(|subject| subject.robot.name.clone()),
            base: subject.map(|subject| subject.base == BaseVisibility::Shown),
            origin,
            train,
            val,
            test,
            points: meta.map(|meta| meta.points_per_cloud),
            motors,
            payload,
            scale: units.scale,
            bytes: bytes_in(dir)?,
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
        [
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
                format!("{}, {}", self.motors.len(), self.motor_ranges()),
            ),
            ("Payloads", payload.unwrap_or_else(|| "none".to_owned())),
            ("Scale", format!("{:.4} m", self.scale)),
            ("On disk", format!("{:.1} MB", self.bytes as f64 / 1e6)),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
    }
}

impl Info {
    /// Smallest and largest value over the motors of each unit.
    fn motor_ranges(&self) -> String {
        let mut ranges: Vec<(Option<&str>, [f64; 2])> = Vec::new();
        for (&unit, &[low, high]) in self.motor_units.iter().zip(&self.motors) {
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

pub(super) fn run(args: &InfoArgs, console: &Console) -> anyhow::Result<()> {
    let info = |dir: &PathBuf| Info::new(dir, &Survey::open(dir)?);
    let infos: Vec<Info> = args.dirs.dirs.iter().map(info).collect::<Result<_, _>>()?;
    console.result(&infos, |infos| {
        let text = infos.iter().map(|info| {
            let facts = info.facts().into_iter();
            let lines: String = facts
                .map(|(name, value)| format!("  {name:17} {value}\n"))
                .collect();
            format!("{}\n{lines}", info.dir.display())
        });
        text.collect()
    })
}
