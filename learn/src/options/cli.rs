//! The options on a command line, and what other front ends learn of them from there.

use std::any::TypeId;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::LazyLock;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Args, Command};
use serde::Serialize;
use serde_json::{Map, Value};

use super::{Net, Preset, RobotChoice, TrainOptions};
use crate::net::ContextLayers;

/// Heading of the context network's options.
pub(super) const CONTEXT: &str = "Context of --net hybrid";

/// An option of [`TrainOptions`], for a front end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OptionInfo {
    /// Name of its field.
    pub name: String,
    /// What its values are.
    pub kind: Kind,
    /// What stands for a value in the help, such as `N`.
    pub placeholder: String,
    /// Names of all values, where they are few.
    pub choices: Vec<String>,
    /// Its default; null where its help says what else is taken.
    pub default: Value,
    /// Its documentation, with the presets' values.
    pub help: String,
    /// Heading of its group; none for the first group.
    pub heading: Option<String>,
}

/// What the values of an option are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Whole numbers from 0 on.
    Count,
    /// Whole numbers, one per stage.
    Counts,
    /// Numbers.
    Number,
    /// Yes or no.
    Flag,
    /// One of some names.
    Choice,
    /// Text.
    Text,
    /// Files.
    File,
    /// Robots: [`RobotChoice`].
    Robot,
}

/// Every option that has a field in JSON, in the order of the command line.
pub fn options() -> Vec<OptionInfo> {
    let default = json(&TrainOptions::default());
    let command = TrainOptions::augment_args(Command::new("train"));
    let known = command.get_arguments().filter_map(|arg| {
        let value = default.get(arg.get_id().as_str())?;
        Some(info(arg, value.clone()))
    });
    known.collect()
}

/// The help of the option of this name.
///
/// # Panics
/// Where there is none.
pub fn help(name: &str) -> String {
    let found = options().into_iter().find(|option| option.name == name);
    found.expect("an option of training").help
}

fn info(arg: &Arg, default: Value) -> OptionInfo {
    let choices = arg.get_possible_values();
    let choices: Vec<_> = (choices.iter().map(PossibleValue::get_name))
        .map(str::to_owned)
        .collect();
    let placeholder = arg.get_value_names().and_then(|names| names.first());
    OptionInfo {
        name: arg.get_id().to_string(),
        kind: kind(arg, !choices.is_empty()),
        placeholder: placeholder.map(ToString::to_string).unwrap_or_default(),
        choices,
        default,
        help: arg.get_help().map(ToString::to_string).unwrap_or_default(),
        heading: arg.get_help_heading().map(str::to_owned),
    }
}

fn kind(arg: &Arg, has_choices: bool) -> Kind {
    let value = arg.get_value_parser().type_id();
    if value == TypeId::of::<bool>() {
        Kind::Flag
    } else if has_choices {
        Kind::Choice
    } else if value == TypeId::of::<RobotChoice>() {
        Kind::Robot
    } else if value == TypeId::of::<PathBuf>() {
        Kind::File
    } else if value == TypeId::of::<f32>() || value == TypeId::of::<f64>() {
        Kind::Number
    } else if value == TypeId::of::<usize>() || value == TypeId::of::<u64>() {
        match arg.get_value_delimiter() {
            Some(_) => Kind::Counts,
            None => Kind::Count,
        }
    } else {
        Kind::Text
    }
}

/// Adds the values of all presets to the help of an option that is left to them.
pub(super) fn with_preset_values(arg: Arg) -> Arg {
    static VALUES: LazyLock<BTreeMap<String, String>> = LazyLock::new(preset_values);
    let (Some(values), Some(about)) = (VALUES.get(arg.get_id().as_str()), arg.get_help()) else {
        return arg;
    };
    let help = format!("{about} [default: {values}]");
    arg.help(help)
}

/// What the presets say, by option: `quick 96, laptop 128, paper 512`, and where it is another for a hybrid,
/// `quick 128; laptop 128; paper 8, hybrid 32`.
fn preset_values() -> BTreeMap<String, String> {
    let of_presets = Preset::ALL.map(|preset| {
        [Net::Mlp, Net::Hybrid].map(|net| {
            let mut values = json(&preset.options(net));
            let steps = values.entry("steps").or_insert(Value::Null);
            if steps.is_null() {
                *steps = Value::String(format!("{} epochs", Preset::EPOCHS));
            }
            values
        })
    });
    let left_to_presets = json(&TrainOptions::default()).into_iter();
    let left_to_presets = left_to_presets.filter(|(_, value)| value.is_null());
    let said = left_to_presets.filter_map(|(option, _)| {
        let values: Option<Vec<[String; 2]>> = (of_presets.iter())
            .map(|[mlp, hybrid]| Some([in_words(&mlp[&option])?, in_words(&hybrid[&option])?]))
            .collect();
        let values = values?;
        let alike = values.iter().all(|[mlp, hybrid]| mlp == hybrid);
        let texts = Preset::ALL
            .iter()
            .zip(&values)
            .map(|(preset, [mlp, hybrid])| match mlp == hybrid {
                true => format!("{} {mlp}", preset.name()),
                false => format!("{} {mlp}, hybrid {hybrid}", preset.name()),
            });
        let texts: Vec<_> = texts.collect();
        Some((option, texts.join(if alike { ", " } else { "; " })))
    });
    said.collect()
}

/// A value as a user writes it; `None` where there is none.
fn in_words(value: &Value) -> Option<String> {
    match value {
        Value::Bool(true) => Some("yes".to_owned()),
        Value::Bool(false) => Some("no".to_owned()),
        Value::String(text) => Some(text.clone()),
        Value::Number(number) => number.as_f64().map(|number| number.to_string()),
        _ => None,
    }
}

/// The fields in JSON, in which an f32 has as many digits as distinguish it from others.
fn json(options: &TrainOptions) -> Map<String, Value> {
    let text = serde_json::to_string(options).expect("options are names and numbers");
    serde_json::from_str(&text).expect("an object")
}

/// Parses the name of a preset.
pub(super) fn preset() -> impl TypedValueParser<Value = Preset> {
    let value = |preset: Preset| PossibleValue::new(preset.name()).help(preset.purpose());
    one_of(Preset::ALL, Preset::name, Preset::ALL.map(value))
}

/// Parses the name of the context network's layers.
pub(super) fn layers() -> impl TypedValueParser<Value = ContextLayers> {
    let value = |layers: ContextLayers| {
        PossibleValue::new(layers.name()).help(match layers {
            ContextLayers::Residual => {
                "Residual blocks with GroupNorm, which learn from clouds one after another"
            }
            ContextLayers::Pvcnn => {
                "The authors', with BatchNorm: trained by `python -m tdcr.torch.train`"
            }
        })
    };
    let all = ContextLayers::ALL;
    one_of(all, ContextLayers::name, all.map(value))
}

/// Parses a number of things, at least one.
///
/// # Errors
/// What was expected.
pub fn amount(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(number) if (1..=10_000_000).contains(&number) => Ok(number),
        _ => Err("expected a whole number, 1 to 10000000".to_owned()),
    }
}

/// Parses a finite number above 0.
///
/// # Errors
/// What was expected.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if f64::is_finite(number) && number > 0.0 => Ok(number),
        _ => Err("expected a finite number above 0".to_owned()),
    }
}

/// Parses the name of one of `all`.
pub fn named<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [T; N],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    one_of(all, name, all.map(|one| PossibleValue::new(name(one))))
}

fn one_of<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [T; N],
    name: fn(T) -> &'static str,
    values: [PossibleValue; N],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(values).map(move |asked| {
        let found = all.into_iter().find(|&one| name(one) == asked);
        found.expect("one of the possible values")
    })
}
