//! `tdcr export`.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use serde::Serialize;
use tdcr::sim::formats::mjcf::{self, ExportOptions, Integrator, Part};
use tdcr::sim::render::BaseVisibility;
use tdcr::sim::robot::{HingeRow, Payload, RobotSpec};
use tdcr::sim::scene::Scene;

use super::console::Console;
use super::output;
use super::scene::SceneArgs;

/// Write a robot as a file of another tool or as a robot file, or the obstacles of a MuJoCo model as a scene file
#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    /// The format to write
    #[arg(long, value_enum, default_value_t = Format::Mjcf)]
    format: Format,
    /// How ball joints are written: hinges and universal joints are approximations, as other programs have them
    #[arg(long, value_enum, default_value_t = Joints::Ball)]
    joints: Joints,
    /// Show the base below the robot (mjcf)
    #[arg(long)]
    base: bool,
    /// Mass that hangs from the tip disc (kg; mjcf)
    #[arg(long, default_value_t = 0.0, value_name = "KG")]
    payload: f64,
    /// Time step (s; mjcf), which must be stable [default: the longest of 0.002, 0.001, 0.0005, 0.0002, .. that is]
    #[arg(long, value_name = "S", value_parser = super::positive)]
    dt: Option<f64>,
    /// How MuJoCo takes a step (mjcf) [default: euler]
    #[arg(long, value_enum)]
    integrator: Option<Method>,
    /// Command of the keyframe, in which the robot must settle (m, or N for a tension drive; mjcf) [default: the middle of
    /// every tendon's range, with a little more pull by the first tendon of each module]
    #[arg(
        long,
        value_delimiter = ',',
        allow_hyphen_values = true,
        value_name = "C,C,..."
    )]
    command: Option<Vec<f64>>,
    #[command(flatten)]
    scene: SceneArgs,
    /// Write a part to be mounted on another model (mjcf): its base stands at the origin, its names begin with PREFIX, and cameras,
    /// gravity, time step and keyframe are left to that model
    #[arg(long, value_name = "PREFIX", conflicts_with_all = ["base", "dt", "command", "scene"])]
    attach: Option<String>,
    /// The file to write [default: stdout]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace a file that is there
    #[arg(long, requires = "out")]
    force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// MuJoCo model
    Mjcf,
    /// Unified Robot Description Format
    Urdf,
    /// Robot file of this program
    Json,
    /// Robot file of this program
    Toml,
    /// Scene file of this program (toml): the obstacles of the MuJoCo model that --robot names
    Scene,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Joints {
    /// As they are
    Ball,
    /// As three hinges, about x, y, then z
    Hinges,
    /// As two hinges, about x, then y: discs cannot twist
    Universal,
}

impl Joints {
    fn row(self) -> Option<HingeRow> {
        match self {
            Self::Ball => None,
            Self::Hinges => Some(HingeRow::Three),
            Self::Universal => Some(HingeRow::Universal),
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Method {
    /// First order, joint damping implicit
    Euler,
    /// First order, implicit in velocities but for Coriolis forces
    Implicitfast,
    /// First order, implicit in velocities
    Implicit,
    /// Fourth order, explicit
    Rk4,
}

impl From<Method> for Integrator {
    fn from(method: Method) -> Self {
        match method {
            Method::Euler => Self::Euler,
            Method::Implicitfast => Self::ImplicitFast,
            Method::Implicit => Self::Implicit,
            Method::Rk4 => Self::RungeKutta4,
        }
    }
}

#[derive(Serialize)]
struct Printed {
    text: String,
}

#[derive(Serialize)]
struct Exported {
    file: PathBuf,
    bytes: usize,
}

pub(super) fn run(args: &ExportArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(out) = &args.out {
        // A device or a pipe loses nothing.
        let is_there = std::fs::metadata(out).is_ok_and(|found| found.is_file());
        if is_there && !args.force {
            bail!("{} is there already; --force replaces it", out.display());
        }
    }
    let text = text_of(args)?;
    let Some(out) = &args.out else {
        return console.result(&Printed { text }, |printed| printed.text.clone());
    };
    output::write(out, &text)?;
    let exported = Exported {
        file: out.clone(),
        bytes: text.len(),
    };
    console.summary(&exported, |e| {
        format!("{}: {} bytes", e.file.display(), e.bytes)
    })
}

/// The obstacles of the MuJoCo model that is the robot's file, as a scene's file.
fn scene_of(args: &ExportArgs) -> anyhow::Result<String> {
    let path = Path::new(&args.robot.name_or_path);
    let is_model = path
        .extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
    if !is_model {
        bail!(
            "--robot {} has no obstacles; expected a MuJoCo model (.xml) with --format scene",
            args.robot.name_or_path
        );
    }
    let imported = mjcf::import_scene(path)?;
    super::warn_of(&imported.notes);
    imported.scene.to_toml().context("cannot write the scene")
}

/// Refuses options that go with MuJoCo models.
fn refuse_for_mjcf_alone(args: &ExportArgs) -> anyhow::Result<()> {
    if args.format == Format::Scene && args.joints != Joints::Ball {
        bail!("--joints goes with formats that hold a robot; --format scene holds obstacles alone");
    }
    let motion = args.dt.is_some() || args.integrator.is_some() || args.command.is_some();
    let beside = args.scene.is_given() || args.attach.is_some();
    if args.format != Format::Mjcf && (args.base || args.payload != 0.0 || motion || beside) {
        bail!(
            "--base, --payload, --dt, --integrator, --command, --scene and --attach go with --format mjcf: other formats hold the \
             robot alone"
        );
    }
    Ok(())
}

/// The robot, on hinges if so asked.
fn spec_of(args: &ExportArgs) -> anyhow::Result<RobotSpec> {
    let spec = args.robot.load()?;
    let Some(row) = args.joints.row() else {
        return Ok(spec);
    };
    for note in mjcf::hinge_notes(&spec, row)? {
        tracing::warn!("{note}");
    }
    Ok(spec.on_hinges(row)?)
}

fn mjcf_of(args: &ExportArgs) -> anyhow::Result<String> {
    let payload = Payload {
        mass: args.payload,
        ..Payload::default()
    };
    let integrator = args.integrator.map(Into::into).unwrap_or_default();
    let spec = spec_of(args)?;
    let (text, scene) = match &args.attach {
        Some(prefix) => {
            let part = Part {
                prefix: prefix.clone(),
                payload,
                integrator,
            };
            (mjcf::export_part(&spec, &part)?, Scene::default())
        }
        None => {
            let options = ExportOptions {
                base: match args.base {
                    true => BaseVisibility::Shown,
                    false => BaseVisibility::Hidden,
                },
                payload,
                timestep: args.dt,
                integrator,
                command: args.command.clone(),
                scene: args.scene.load()?,
            };
            (mjcf::export(&spec, &options)?, options.scene)
        }
    };
    let notes = mjcf::export_notes(&spec)?.into_iter();
    for note in notes.chain(mjcf::scene_notes(&scene)) {
        tracing::warn!("{note}");
    }
    Ok(text)
}

fn text_of(args: &ExportArgs) -> anyhow::Result<String> {
    refuse_for_mjcf_alone(args)?;
    let spec = || spec_of(args);
    Ok(match args.format {
        Format::Mjcf => mjcf_of(args)?,
        Format::Urdf => tdcr::sim::formats::urdf::export(&spec()?)?,
        Format::Json => serde_json::to_string_pretty(&spec()?)? + "\n",
        Format::Toml => spec()?.to_toml()?,
        Format::Scene => scene_of(args)?,
    })
}
