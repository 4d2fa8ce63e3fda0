//! `tdcr export`.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, ValueEnum};
use serde::Serialize;
use tdcr::sim::mjcf::{self, ExportOptions};
use tdcr::sim::render::BaseVisibility;
use tdcr::sim::robot::{Payload, RobotSpec};

use super::console::Console;
use super::output;

/// Write a robot as a file of another tool, or as a robot file
#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    #[arg(long, default_value = "2m", help = super::ROBOT)]
    robot: String,
    /// The format to write
    #[arg(long, value_enum, default_value_t = Format::Mjcf)]
    format: Format,
    /// Show the base below the robot (mjcf)
    #[arg(long)]
    base: bool,
    /// Mass that hangs from the tip disc (kg; mjcf)
    #[arg(
        long,
        default_value_t = 0.0,
        allow_hyphen_values = true,
        value_name = "KG"
    )]
    payload: f64,
    /// The file to write [default: stdout]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
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
    let spec = super::load_robot(&args.robot)?;
    let text = text_of(&spec, args)?;
    let Some(out) = &args.out else {
        return console.result(&Printed { text }, |printed| printed.text.clone());
    };
    output::write(out, &text)?;
    let exported = Exported {
        file: out.clone(),
        bytes: text.len(),
    };
    console.result(&exported, |e| {
        format!("{}: {} bytes", e.file.display(), e.bytes)
    })
}

fn text_of(spec: &RobotSpec, args: &ExportArgs) -> anyhow::Result<String> {
    if args.format != Format::Mjcf && (args.base || args.payload != 0.0) {
        bail!("--base and --payload go with --format mjcf: other formats hold the robot alone");
    }
    Ok(match args.format {
        Format::Mjcf => {
            let base = if args.base {
                BaseVisibility::Shown
            } else {
                BaseVisibility::Hidden
            };
            let payload = Payload {
                mass: args.payload,
                ..Payload::default()
            };
            mjcf::export(spec, &ExportOptions { base, payload })?
        }
        Format::Urdf => tdcr::sim::urdf::export(spec)?,
        Format::Json => serde_json::to_string_pretty(spec)? + "\n",
        Format::Toml => toml::to_string(spec)?,
    })
}
