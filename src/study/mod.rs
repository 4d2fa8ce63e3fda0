//! Studies: sweeps over designs, loads and commands, as one file that says what varies and what is wanted.
//!
//! A [`Study`] is read from a TOML file ([`Study::load`]; `docs/studies.md` has every key) and [`run`] into a folder:
//!
//! ```text
//! table.csv        a row for each configuration: what it is, whether it settled, what was wanted; units in the header
//! table.parquet    the same
//! summary.csv      where commands or other variables are sampled, a row for each combination of the others: quantiles, workspace
//! study.json       what was run: version, seed, the study with its robots, times
//! report.html      figures that fit what varied, on one self-contained page
//! figures/*.svg    each of them as a picture
//! ```
//!
//! Row `i` is a function of the study and `i` alone: the table is the same for any number of threads, after any interruption,
//! and put together of parts ([`merge`]). Only a time on the clock (the output `cost`) differs from run to run.
//!
//! ```
//! use tdcr::pipeline::Silent;
//! use tdcr::study::{Study, run};
//!
//! let text = r#"
//!     robot = "2m"
//!     want = ["tip", "deflection"]
//!     vary = [{ what = "payload", range = [0.0, 0.03], steps = 4 }]
//! "#;
//! let here = std::path::Path::new("");
//! let study = Study::parse(text, here, here)?;
//! let folder = tempfile::tempdir()?;
//! let done = run(&study, folder.path(), None, &Silent)?;
//! assert_eq!((done.rows, done.settled), (4, 4));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod alpha_shape;
mod axes;
mod case;
mod cases;
mod delaunay;
mod dexterity;
mod distribution;
mod drawing;
mod error;
mod field;
mod figures;
mod file;
mod finish;
mod hysteresis;
mod measure;
mod merge;
mod models;
mod overlap;
mod parquet_file;
mod progress;
mod record;
mod report;
mod run;
mod starter;
mod summary;
mod table;
mod thinned;
mod training;
mod variable;
mod vary;
mod want;
mod worker;
mod workspace;

pub use error::{Refusal, StudyError};
pub use merge::merge;
pub use run::{Finished, run};
pub use starter::Starter;
pub use table::{Column, Kind};
pub use variable::Variable;
pub use want::Want;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use tdcr_learn::data::Design;
use tdcr_sim::robot::{Drive, RobotSpec};

use crate::report::Spacing;
use models::Models;
use variable::Target;

/// A study: which configurations, and what is wanted of them. With all that it needs: robots are not read again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Study {
    /// What it is about: the report's title.
    pub title: String,
    /// The robot, by the name or path that the file gives.
    pub robot_name: String,
    /// The robot that everything else changes.
    pub robot: RobotSpec,
    /// Robots that take its place, by the names or paths that the file gives.
    robots: BTreeMap<String, RobotSpec>,
    /// Trained models that are tried, whose robots are then those of the study.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    models: Option<Models>,
    /// Seed of what is sampled.
    pub seed: u64,
    /// What is other than in the robot's file, in all configurations.
    set: Vec<(Variable, Value)>,
    /// Variables with their values, the first changing slowest.
    levels: Vec<Levels>,
    /// Variables that are sampled.
    sampled: Vec<Sampled>,
    /// How they are; `None` where there is none.
    sample: Option<Sample>,
    /// What is computed.
    pub want: Vec<Want>,
    /// Largest tension that a tendon or its servo bears (N).
    pub tension_limit: Option<f64>,
    /// Radius of the balls that carve a workspace's boundary (m); `None` for the smallest that leaves it in one piece.
    pub alpha: Option<f64>,
    /// Distance (m) within which tips count as at one place, of the output `dexterity`.
    dexterity_radius: f64,
    /// The loop of the output `hysteresis`.
    hysteresis: HysteresisLoop,
}

/// A variable and its values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Levels {
    what: Variable,
    values: Vec<Value>,
}

/// A variable that is sampled: in a range, or a command in the ranges of all tendons.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Sampled {
    what: Variable,
    range: Option<[f64; 2]>,
    log: bool,
}

/// How variables are sampled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Sample {
    design: Design,
    count: usize,
}

/// A loop of one tendon's command, out and back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct HysteresisLoop {
    /// The tendon.
    tendon: usize,
    /// How far its command goes (m, or N for a tension drive).
    by: f64,
    /// Commands on the way out, and on the way back.
    points: usize,
}

impl Default for HysteresisLoop {
    fn default() -> Self {
        Self {
            tendon: 0,
            by: -0.01,
            points: 10,
        }
    }
}

impl Sampled {
    fn new(what: Variable, range: Option<([f64; 2], Spacing)>) -> Self {
        Self {
            what,
            range: range.map(|(range, _)| range),
            log: range.is_some_and(|(_, spacing)| spacing == Spacing::Log),
        }
    }

    fn range(&self) -> Option<([f64; 2], Spacing)> {
        let spacing = match self.log {
            true => Spacing::Log,
            false => Spacing::Linear,
        };
        self.range.map(|range| (range, spacing))
    }
}

impl Study {
    /// Points sampled under each combination of levels; 1 where nothing is sampled.
    fn samples(&self) -> usize {
        self.sample.map_or(1, |sample| sample.count)
    }

    /// Which robot it is, as captions say it, or how models are compared; nothing where robots are varied.
    fn robot_said(&self) -> String {
        match (&self.models, self.robots.is_empty()) {
            (Some(models), _) => models.said(),
            (None, true) => format!("Robot {}.", self.robot_name),
            (None, false) => String::new(),
        }
    }

    /// Unit of a variable's values; empty where there is none. Commands are in metres, or in newtons, where all tendons of all
    /// robots take that.
    fn unit(&self, what: &Variable) -> &'static str {
        if !matches!(what.target, Target::Command | Target::Tendon(_)) {
            return what.unit();
        }
        let of_models = self.models.iter().flat_map(Models::all);
        let of_models = of_models.map(|(_, model)| &model.subject.robot);
        let robots: Vec<&RobotSpec> = std::iter::once(&self.robot)
            .chain(self.robots.values())
            .chain(of_models)
            .collect();
        let all = |tension: bool| {
            let mut drives = robots.iter().flat_map(|robot| robot.tendons());
            drives.all(|tendon| (tendon.drive == Drive::Tension) == tension)
        };
        match (all(false), all(true)) {
            (true, _) => "m",
            (_, true) => "N",
            _ => what.unit(),
        }
    }

    /// Unit of a whole command's numbers, as of [`unit`](Self::unit).
    fn command_unit(&self) -> &'static str {
        "command".parse().map_or("", |what| self.unit(&what))
    }

    /// Sampled variables with a range.
    fn scalars(&self) -> impl Iterator<Item = &Sampled> {
        self.sampled
            .iter()
            .filter(|sampled| sampled.range.is_some())
    }

    /// Whether whole commands are sampled, in the tendons' own ranges.
    fn samples_command(&self) -> bool {
        let mut sampled = self.sampled.iter();
        sampled.any(|s| s.range.is_none() && s.what.target == Target::Command)
    }
}
