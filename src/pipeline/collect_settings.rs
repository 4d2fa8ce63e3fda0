//! What a data set is made of.

use clap::{Args, ValueEnum};
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use tdcr_base::Part;
use tdcr_learn::data::{Design, Meta, ObstacleVariation, Origin, PayloadRange, Recipe, Subject};
use tdcr_learn::options::cli::{amount, named, positive};
use tdcr_sim::render::{BaseVisibility, Sensor};
use tdcr_sim::robot::RobotSpec;
use tdcr_sim::scene::Scene;

/// Samples per file on disk.
const SAMPLES_PER_SHARD: usize = 250;

/// What a data set is made of, beside the robot and the obstacles around it. The one list of these options: the command line
/// (`tdcr collect`) and Python (`tdcr.collect`) take their names and types from it, and the former its documentation. In
/// JSON a field has the name of its option.
#[derive(Clone, Debug, PartialEq, Args, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CollectSettings {
    /// Number of commands, split 80/10/10 into train, val and test
    #[arg(long, default_value_t = Self::default().samples, value_name = "N", value_parser = amount)]
    pub samples: usize,
    /// Points per cloud
    #[arg(long, default_value_t = Self::default().points, value_name = "N", value_parser = amount)]
    pub points: usize,
    /// Edge of the voxels that thin the fused clouds (m)
    #[arg(long, default_value_t = Self::default().voxel, value_name = "M", value_parser = positive, allow_hyphen_values = true)]
    pub voxel: f64,
    /// Show the robot's base to the cameras
    #[arg(long)]
    pub base: bool,
    /// Hang payloads from the tip (kg): a tenth exactly 0, the others uniform from MIN to MAX
    #[arg(long, value_name = "MIN:MAX", value_parser = payload_range, allow_hyphen_values = true)]
    pub payload: Option<PayloadRange>,
    /// Move the scene's obstacles anew for each sample, by up to SHIFT along each axis (m) and, where it is given, TURN about each
    /// (degrees); where they are is part of the condition. Half spaces stay
    #[arg(long, value_name = "SHIFT[:TURN]", value_parser = obstacle_variation)]
    pub vary_obstacles: Option<ObstacleVariation>,
    /// Simulate the noise of a real depth camera
    #[arg(long, value_enum)]
    #[serde(deserialize_with = "noise")]
    pub noise: Option<Noise>,
    /// How commands and payloads are chosen
    #[arg(long, default_value = Self::default().design.name(), value_parser = named(Design::ALL, Design::name))]
    #[serde(deserialize_with = "design")]
    pub design: Design,
    /// Seed of commands, samples, faults and splits
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Collect part I of N of the samples, in a folder of its own; tdcr data merge makes a data set of all parts
    #[arg(long, value_name = "I/N")]
    #[serde(deserialize_with = "part")]
    pub part: Option<Part>,
}

/// 1,000 clouds of 10,000 points of the default recipe, under uniform commands.
impl Default for CollectSettings {
    fn default() -> Self {
        Self {
            samples: 1000,
            points: 10_000,
            voxel: Recipe::default().voxel_size,
            base: false,
            payload: None,
            vary_obstacles: None,
            noise: None,
            design: Design::Uniform,
            seed: 0,
            part: None,
        }
    }
}

impl CollectSettings {
    pub(super) fn recipe(&self, robot: &RobotSpec, scene: &Scene) -> Recipe {
        Recipe {
            subject: Subject {
                robot: robot.clone(),
                base: visibility(self.base),
                payload: self.payload,
                scene: scene.clone(),
                obstacles: self.vary_obstacles,
            },
            voxel_size: self.voxel,
            sensor: self.noise.map(Noise::sensor),
        }
    }

    pub(super) fn meta(&self, recipe: &Recipe) -> Meta {
        Meta {
            format: Meta::FORMAT,
            tdcr_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.seed,
            count: self.samples,
            motors: recipe.subject.robot.tendon_count() + recipe.subject.obstacle_numbers(),
            points_per_cloud: self.points,
            samples_per_shard: SAMPLES_PER_SHARD,
            origin: Origin::Simulated {
                recipe: recipe.clone(),
                design: self.design,
            },
        }
    }
}

/// Cameras whose noise can be simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Noise {
    /// Intel RealSense D435
    D435,
}

impl Noise {
    /// The camera of this name.
    ///
    /// # Errors
    /// The names that there are.
    pub fn named(name: &str) -> Result<Self, String> {
        named_value("noise", name)
    }

    /// Its faults.
    pub fn sensor(self) -> Sensor {
        match self {
            Self::D435 => Sensor::d435(),
        }
    }
}

/// Whether the base is in view, from a flag.
pub fn visibility(base: bool) -> BaseVisibility {
    match base {
        true => BaseVisibility::Shown,
        false => BaseVisibility::Hidden,
    }
}

/// Parses the ends of a payload range (kg), `MIN:MAX`. The data set checks that they make a range.
///
/// # Errors
/// What was expected.
pub fn payload_range(text: &str) -> Result<PayloadRange, String> {
    let ends = text.split_once(':');
    let ends = ends.and_then(|(min, max)| Some((min.parse().ok()?, max.parse().ok()?)));
    let (min, max) = ends.ok_or("expected MIN:MAX, two masses in kg")?;
    Ok(PayloadRange { min, max })
}

/// Parses how far obstacles are moved, `SHIFT` or `SHIFT:TURN` (m, degrees).
///
/// # Errors
/// What was expected.
pub fn obstacle_variation(text: &str) -> Result<ObstacleVariation, String> {
    let (shift, turn) = text.split_once(':').unwrap_or((text, "0"));
    let parsed = shift.parse::<f64>().ok().zip(turn.parse::<f64>().ok());
    let (shift, turn) = parsed.ok_or("expected SHIFT or SHIFT:TURN, in metres and degrees")?;
    let turn = turn.to_radians();
    Ok(ObstacleVariation { shift, turn })
}

/// The camera of this name, in JSON.
pub(super) fn noise<'de, D: Deserializer<'de>>(value: D) -> Result<Option<Noise>, D::Error> {
    let name = Option::<String>::deserialize(value)?;
    let named = name.map(|name| Noise::named(&name));
    named.transpose().map_err(D::Error::custom)
}

/// The value of this name of an option, in JSON.
pub(super) fn value_named<'de, T: ValueEnum, D: Deserializer<'de>>(
    option: &str,
    value: D,
) -> Result<T, D::Error> {
    let name = String::deserialize(value)?;
    named_value(option, &name).map_err(D::Error::custom)
}

/// The value of this name of an option, or what was expected.
fn named_value<T: ValueEnum>(option: &str, name: &str) -> Result<T, String> {
    let name_of = |value: &T| {
        value
            .to_possible_value()
            .map(|value| value.get_name().to_owned())
    };
    let names: Vec<String> = T::value_variants().iter().filter_map(name_of).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    T::from_str(name, false).map_err(|_| other(option, name, &names))
}

fn design<'de, D: Deserializer<'de>>(value: D) -> Result<Design, D::Error> {
    let name = String::deserialize(value)?;
    let found = Design::ALL.into_iter().find(|design| design.name() == name);
    found.ok_or_else(|| D::Error::custom(other("design", &name, &Design::ALL.map(Design::name))))
}

fn part<'de, D: Deserializer<'de>>(value: D) -> Result<Option<Part>, D::Error> {
    let text = Option::<String>::deserialize(value)?;
    text.map(|text| text.parse().map_err(D::Error::custom))
        .transpose()
}

/// A name that is none of those known.
fn other(field: &str, found: &str, known: &[&str]) -> String {
    let known = known.iter().map(|name| format!("{name:?}"));
    let known = known.collect::<Vec<_>>().join(", ");
    format!("{field} is {found:?}; expected one of {known}")
}
