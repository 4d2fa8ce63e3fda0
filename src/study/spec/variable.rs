//! What a study varies, by name.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use tdcr_sim::robot::{Axis, Parameter, ParameterKind};

use super::field::Field;

/// Something that a configuration consists of, by name: of the robot, its command, its loads, or the seed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Variable {
    name: String,
    pub(in crate::study) target: Target,
}

/// A value for a variable.
pub(in crate::study) type Setting<'a> = (&'a Variable, Value);

/// What a name means.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::study) enum Target {
    /// A part of the path of a trained model.
    Model,
    /// The robot, by name or path.
    Robot,
    /// The scene around the robot, by the path of its file.
    Scene,
    /// The number of modules.
    Modules,
    /// The number of discs of every module.
    Discs,
    /// Stiffness of all joints in bending and torsion.
    Stiffness,
    /// Coefficient of friction of all tendons.
    Friction,
    /// A field of the robot's file.
    Field(Field),
    /// Parameters of the robot that take the same value: of all tendons, modules or bodies.
    Every(&'static ParameterKind),
    /// A parameter of the robot.
    Parameter(Parameter),
    /// The seed of what is sampled.
    Seed,
    /// The whole command.
    Command,
    /// The command of one tendon.
    Tendon(usize),
    /// The mass of the payload.
    Payload,
    /// A force on a disc.
    Force(Place, Axis),
    /// A moment on a disc.
    Moment(Place, Axis),
}

/// A disc.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::study) enum Place {
    /// The distal one, however many there are.
    Tip,
    /// By number.
    Disc(usize),
}

impl Variable {
    /// Its name in files and tables.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Unit of its values; empty for names and numbers without one.
    pub fn unit(&self) -> &'static str {
        match &self.target {
            Target::Model
            | Target::Robot
            | Target::Scene
            | Target::Modules
            | Target::Discs
            | Target::Friction
            | Target::Seed => "",
            Target::Stiffness => Parameter::Torsion(0).unit(),
            Target::Field(field) => field.unit(),
            Target::Every(kind) => kind.quantity.unit,
            Target::Parameter(parameter) => parameter.unit(),
            Target::Command | Target::Tendon(_) => Parameter::Command(0).unit(),
            Target::Payload => Parameter::Payload.unit(),
            Target::Force(_, axis) => Parameter::Force(0, *axis).unit(),
            Target::Moment(_, axis) => Parameter::Moment(0, *axis).unit(),
        }
    }

    /// Whether its values are whole numbers.
    pub(in crate::study) fn is_whole(&self) -> bool {
        matches!(self.target, Target::Modules | Target::Discs | Target::Seed)
    }

    /// Whether it is part of the robot or what is around it, not of its command, its loads or the seed.
    pub(in crate::study) fn is_of_robot(&self) -> bool {
        self.rank() < RANK_OF_COMMAND
    }

    /// The order in which variables are applied: a number of modules before what the modules have.
    pub(in crate::study) fn rank(&self) -> usize {
        match self.target {
            Target::Model | Target::Robot | Target::Scene => 0,
            Target::Modules => 1,
            Target::Discs => 2,
            Target::Field(_) => 3,
            Target::Stiffness | Target::Friction | Target::Every(_) => 4,
            Target::Parameter(_) => 5,
            Target::Command => RANK_OF_COMMAND,
            Target::Tendon(_) => RANK_OF_COMMAND + 1,
            Target::Seed | Target::Payload | Target::Force(..) | Target::Moment(..) => {
                RANK_OF_COMMAND + 2
            }
        }
    }

    /// Whether it is a part of the path of a model.
    pub(in crate::study) fn names_model(&self) -> bool {
        self.target == Target::Model
    }

    /// Its name in figures, and in the path of a model: `base` for `model.base`.
    pub(in crate::study) fn shown(&self) -> &str {
        self.name()
            .strip_prefix(MODEL_PREFIX)
            .unwrap_or(self.name())
    }

    /// How the path of a model names it.
    pub(in crate::study) fn in_braces(&self) -> String {
        format!("{{{}}}", self.shown())
    }
}

/// What the names of variables begin with that are parts of a model's path.
const MODEL_PREFIX: &str = "model.";
const RANK_OF_COMMAND: usize = 6;

/// What names there are.
pub(in crate::study) const NAMES: &str = "robot, scene, modules, discs, stiffness, friction, payload, command, seed, force[tip].x, \
     moment[tip].x, model.NAME (in the path of a model), a parameter of all (gain, pitch, density, hole_radius, ...), one of a tendon, module or disc \
     (gain[2], pitch[1], command[0], force[9].x), or a field of a robot file (modules[*].radius, gravity[2])";

impl FromStr for Variable {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let target = match name {
            "robot" => Some(Target::Robot),
            "scene" => Some(Target::Scene),
            "modules" => Some(Target::Modules),
            "discs" => Some(Target::Discs),
            "stiffness" => Some(Target::Stiffness),
            "friction" => Some(Target::Friction),
            "command" => Some(Target::Command),
            "seed" => Some(Target::Seed),
            _ if is_part_of_path(name) => Some(Target::Model),
            _ => ParameterKind::named(name)
                .filter(|kind| kind.is_shared())
                .map(Target::Every)
                .or_else(|| parameter(name))
                .or_else(|| Field::parse(name).map(Target::Field)),
        };
        target.map_or_else(
            || Err(format!("expected one of {NAMES}")),
            |target| {
                Ok(Self {
                    name: name.to_owned(),
                    target,
                })
            },
        )
    }
}

/// Whether it is `model.` and a word, which the path of a model may name.
fn is_part_of_path(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let word = name.strip_prefix(MODEL_PREFIX);
    word.is_some_and(|word| !word.is_empty() && word.chars().all(plain))
}

/// What the key of a parameter means; a disc may be the tip.
fn parameter(name: &str) -> Option<Target> {
    let at_tip = name.contains("[tip]");
    let place = |disc| match at_tip {
        true => Place::Tip,
        false => Place::Disc(disc),
    };
    Some(match name.replace("[tip]", "[0]").parse().ok()? {
        Parameter::Force(disc, axis) => Target::Force(place(disc), axis),
        Parameter::Moment(disc, axis) => Target::Moment(place(disc), axis),
        _ if at_tip => return None,
        Parameter::Command(tendon) => Target::Tendon(tendon),
        Parameter::Payload => Target::Payload,
        other => Target::Parameter(other),
    })
}

impl TryFrom<String> for Variable {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        name.parse()
    }
}

impl From<Variable> for String {
    fn from(variable: Variable) -> Self {
        variable.name
    }
}

impl fmt::Display for Variable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

/// Values of variables, with their units.
pub(in crate::study) fn phrase(settings: &[Setting]) -> String {
    let phrases = settings.iter().map(|(what, value)| {
        let value = plain(value);
        match what.unit() {
            "" => format!("{what} {value}"),
            unit => format!("{what} {value} {unit}"),
        }
    });
    phrases.collect::<Vec<_>>().join(", ")
}

/// A value as one writes it: text without quotes, numbers without needless zeros.
pub(in crate::study) fn plain(value: &Value) -> String {
    match (value.as_str(), value.as_f64()) {
        (Some(text), _) => text.to_owned(),
        (None, Some(number)) => number.to_string(),
        (None, None) => value.to_string(),
    }
}
