//! `tdcr new`: a first robot file.

use std::io::{BufRead, IsTerminal, Write};
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, bail, ensure};
use clap::{Args, ValueEnum};
use serde::Serialize;
use tdcr::sim::formats::{Sketch, SketchedBackbone, SketchedServos};

use super::console::{Console, say};
use super::output;

/// Write a robot file to start from: asks six questions, or takes options
///
/// What is not given is asked for where somebody can answer, and else is as the options say. For example:
/// tdcr new mine.toml && tdcr view --robot mine.toml
#[derive(Debug, Args)]
pub(super) struct NewArgs {
    /// The robot file to write (.toml)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Segments that bend on their own [default: 2]
    #[arg(long, value_name = "N")]
    segments: Option<usize>,
    /// Discs of each segment [default: 10]
    #[arg(long, value_name = "N")]
    discs: Option<usize>,
    /// Tendons of each segment [default: 3]
    #[arg(long, value_name = "N")]
    tendons: Option<usize>,
    /// Length of each segment (m) [default: 0.1]
    #[arg(long, value_name = "M", value_parser = super::positive)]
    length: Option<f64>,
    /// What holds the discs apart [default: steel]
    #[arg(long, value_enum)]
    backbone: Option<Backbone>,
    /// Radius of the backbone's wire (m) [default: 0.0005]
    #[arg(long, value_name = "M", value_parser = super::positive)]
    radius: Option<f64>,
    /// What servos are told [default: tension]
    #[arg(long, value_enum)]
    servos: Option<Servos>,
    /// Replace a file that is there
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Backbone {
    /// A wire of spring steel
    Steel,
    /// A wire of superelastic nickel titanium
    Nitinol,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Servos {
    /// How much of each tendon is not wound up (m)
    Position,
    /// The tension of each tendon (N)
    Tension,
}

impl FromStr for Backbone {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        ValueEnum::from_str(text, true)
    }
}

impl FromStr for Servos {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        ValueEnum::from_str(text, true)
    }
}

#[derive(Serialize)]
struct Written {
    file: PathBuf,
    /// One that bends the first segment (m or N).
    command: Vec<f64>,
}

pub(super) fn run(args: &NewArgs, console: &Console) -> anyhow::Result<()> {
    let is_toml = (args.file.extension()).is_some_and(|ending| ending.eq_ignore_ascii_case("toml"));
    ensure!(
        is_toml,
        "{} is no name of a robot file that has comments; expected the extension .toml",
        args.file.display()
    );
    if args.file.exists() && !args.force {
        bail!(
            "{} is there already; --force replaces it",
            args.file.display()
        );
    }
    let sketch = sketch(args)?;
    let name = args.file.file_stem().unwrap_or_default().to_string_lossy();
    let text = sketch.to_toml(&name)?;
    output::write(&args.file, &text)?;
    let written = Written {
        file: args.file.clone(),
        command: sketch.command(),
    };
    console.summary(&written, |written| {
        let file = written.file.display();
        let command: Vec<String> = written.command.iter().map(ToString::to_string).collect();
        format!(
            "{file}: a robot; see it with\n  tdcr view --robot {file}\n  tdcr settle --robot {file} --command {}",
            command.join(",")
        )
    })
}

fn sketch(args: &NewArgs) -> anyhow::Result<Sketch> {
    let segments = asked("Segments", args.segments, 2)?;
    let discs = asked("Discs of each segment", args.discs, 10)?;
    let tendons = asked("Tendons of each segment", args.tendons, 3)?;
    let length = asked("Length of each segment (m)", args.length, 0.1)?;
    let backbone = asked("Backbone (steel, nitinol)", args.backbone, Backbone::Steel)?;
    let servos = asked(
        "Servos are told (tension, position)",
        args.servos,
        Servos::Tension,
    )?;
    let radius = args.radius.unwrap_or(0.0005);
    let backbone = match backbone {
        Backbone::Steel => SketchedBackbone::steel(radius),
        Backbone::Nitinol => SketchedBackbone::nitinol(radius),
    };
    let servos = match servos {
        Servos::Position => SketchedServos::Position,
        Servos::Tension => SketchedServos::Tension,
    };
    Ok(Sketch {
        segments,
        discs,
        tendons,
        length,
        backbone,
        servos,
    })
}

/// What was given; else what is answered where stdin is a terminal, until it makes sense; else the default.
fn asked<T>(question: &str, given: Option<T>, default: T) -> anyhow::Result<T>
where
    T: FromStr<Err: ToString> + std::fmt::Debug,
{
    if let Some(given) = given {
        return Ok(given);
    }
    let stdin = std::io::stdin();
    if !stdin.is_terminal() {
        return Ok(default);
    }
    loop {
        let shown = format!("{default:?}").to_lowercase();
        let mut stderr = std::io::stderr().lock();
        write!(stderr, "{question} [{shown}]: ")
            .and_then(|()| stderr.flush())
            .context("cannot write to stderr")?;
        drop(stderr);
        let mut answer = String::new();
        let read = stdin.lock().read_line(&mut answer);
        if read.context("cannot read the answer")? == 0 || answer.trim().is_empty() {
            return Ok(default);
        }
        match answer.trim().parse() {
            Ok(value) => return Ok(value),
            Err(error) => say(&format!("{}: {}", answer.trim(), error.to_string())),
        }
    }
}
