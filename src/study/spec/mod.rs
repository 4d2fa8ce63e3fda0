//! What a study is: its file, variables, configurations and wants.

pub(in crate::study) mod case;
pub(in crate::study) mod cases;
mod column;
mod field;
mod file;
pub(in crate::study) mod models;
mod output;
mod overlap;
mod scenes;
mod starter;
pub(in crate::study) mod variable;
pub(in crate::study) mod vary;

pub use column::{Column, Kind};
pub use output::Output;
pub use starter::Starter;
pub use variable::Variable;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use tdcr_learn::data::Design;
use tdcr_sim::robot::{Drive, RobotSpec};
use tdcr_sim::scene::Scene;

use crate::report::{Spacing, counted};
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
    pub(in crate::study) robots: BTreeMap<String, RobotSpec>,
    /// What is around the robot.
    #[serde(default, skip_serializing_if = "Scene::is_empty")]
    pub scene: Scene,
    /// Scenes that take its place, by the paths that the file gives.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(in crate::study) scenes: BTreeMap<String, Scene>,
    /// Trained models that are tried, whose robots are then those of the study.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(in crate::study) models: Option<Models>,
    /// Seed of what is sampled.
    pub seed: u64,
    /// What is other than in the robot's file, in all configurations.
    pub(in crate::study) set: Vec<(Variable, Value)>,
    /// Variables with their values, the first changing slowest.
    pub(in crate::study) levels: Vec<Levels>,
    /// Variables that are sampled.
    pub(in crate::study) sampled: Vec<Sampled>,
    /// How they are; `None` where there is none.
    pub(in crate::study) sample: Option<Sample>,
    /// What is computed.
    pub want: Vec<Output>,
    /// Largest tension that a tendon or its servo bears (N).
    pub tension_limit: Option<f64>,
    /// Radius of the balls that carve a workspace's boundary (m); `None` for the smallest that leaves it in one piece.
    pub alpha: Option<f64>,
    /// Distance (m) within which tips count as at one place, of the output `dexterity`.
    pub(in crate::study) dexterity_radius: f64,
    /// The loop of the output `hysteresis`.
    pub(in crate::study) hysteresis: HysteresisLoop,
}

/// A variable and its values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::study) struct Levels {
    pub(in crate::study) what: Variable,
    pub(in crate::study) values: Vec<Value>,
}

/// A variable that is sampled: in a range, or a command in the ranges of all tendons.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::study) struct Sampled {
    pub(in crate::study) what: Variable,
    pub(in crate::study) range: Option<[f64; 2]>,
    pub(in crate::study) log: bool,
}

/// How variables are sampled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::study) struct Sample {
    pub(in crate::study) design: Design,
    pub(in crate::study) count: usize,
}

/// A loop of one tendon's command, out and back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(in crate::study) struct HysteresisLoop {
    /// The tendon.
    pub(in crate::study) tendon: usize,
    /// How far its command goes (m, or N for a tension drive).
    pub(in crate::study) by: f64,
    /// Commands on the way out, and on the way back.
    pub(in crate::study) points: usize,
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
    pub(in crate::study) fn new(what: Variable, range: Option<([f64; 2], Spacing)>) -> Self {
        Self {
            what,
            range: range.map(|(range, _)| range),
            log: range.is_some_and(|(_, spacing)| spacing == Spacing::Log),
        }
    }

    pub(in crate::study) fn range(&self) -> Option<([f64; 2], Spacing)> {
        let spacing = match self.log {
            true => Spacing::Log,
            false => Spacing::Linear,
        };
        self.range.map(|range| (range, spacing))
    }
}

impl Study {
    /// Points sampled under each combination of levels; 1 where nothing is sampled.
    pub(in crate::study) fn samples(&self) -> usize {
        self.sample.map_or(1, |sample| sample.count)
    }

    /// Which robot it is, a sentence for captions, or how models are compared; nothing where robots are varied.
    pub(in crate::study) fn robot_phrase(&self) -> String {
        match (&self.models, self.robots.is_empty()) {
            (Some(models), _) => models.phrase(),
            (None, true) => format!("Robot {}{}.", self.robot_name, self.among()),
            (None, false) => String::new(),
        }
    }

    /// What is around the robot in all configurations, a phrase; nothing where that is nothing, or varied.
    fn among(&self) -> String {
        match (self.scene.obstacles().len(), self.scenes.is_empty()) {
            (0, _) | (_, false) => String::new(),
            (count, true) => format!(" among {}", counted(count, "obstacle")),
        }
    }

    /// All scenes of the configurations, those that models were trained in included.
    pub(in crate::study) fn all_scenes(&self) -> impl Iterator<Item = &Scene> {
        let of_models = self.models.iter().flat_map(Models::all);
        std::iter::once(&self.scene)
            .chain(self.scenes.values())
            .chain(of_models.map(|(_, model)| &model.subject.scene))
    }

    /// Unit of a variable's values; empty where there is none. Commands are in metres, or in newtons, where all tendons of all
    /// robots take that.
    pub(in crate::study) fn unit(&self, what: &Variable) -> &'static str {
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
    pub(in crate::study) fn command_unit(&self) -> &'static str {
        "command".parse().map_or("", |what| self.unit(&what))
    }

    /// Sampled variables with a range.
    pub(in crate::study) fn scalars(&self) -> impl Iterator<Item = &Sampled> {
        self.sampled
            .iter()
            .filter(|sampled| sampled.range.is_some())
    }

    /// Whether whole commands are sampled, in the tendons' own ranges.
    pub(in crate::study) fn samples_command(&self) -> bool {
        let mut sampled = self.sampled.iter();
        sampled.any(|s| s.range.is_none() && s.what.target == Target::Command)
    }
}
