//! `tdcr view`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use clap::Args;
use serde::Serialize;
use tdcr::learn::data::Subject;
use tdcr::pipeline::Monitor;
use tdcr::sim::robot::{Robot, RobotSpec};
use tdcr::view::{Exhibit, OverlayFiles, Overlays, Source, View};

use super::commands::read_commands;
use super::console::Console;
use super::loads::LoadArgs;
use super::scene::SceneArgs;
use super::{CommandArg, load_rig, load_robot};

/// How often it is seen whether the command is to end.
const PATIENCE: Duration = Duration::from_millis(50);

/// Show a robot in the browser that follows the hand
///
/// The page is served on this machine alone, at an address with a random token; nothing is fetched from elsewhere. Drag a disc, and the
/// robot follows; with Shift it is pushed. A robot file is watched, and shown again when it changes. Ctrl-C ends it.
#[derive(Debug, Args)]
pub(super) struct ViewArgs {
    /// 2m, 3m, 5m, or the path of a robot file (.toml, .json, .xml for MuJoCo's MJCF, or .urdf) [default: the robot of the model, the
    /// data set or the study; else 2m]
    #[arg(long, value_name = "ROBOT")]
    robot: Option<String>,
    #[command(flatten)]
    command: CommandArg,
    /// Commands that the page can play: CSV, one per line, optionally with a header, or JSON, a list of lists
    #[arg(long, value_name = "FILE")]
    commands: Option<PathBuf>,
    /// Data set whose clouds are shown over the robot, sample by sample
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Trained model whose cloud follows the robot, with its distance from what cameras would see
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Log of a rig (MCAP) to scrub through: commands, servos and clouds
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Rig to look at live, and to move by the page that arms it; its robot is shown where its servos stand
    #[arg(long, value_name = "FILE", conflicts_with_all = ["robot", "lengths", "commands", "scene", "data", "log", "study"])]
    rig: Option<PathBuf>,
    /// Folder of the rig's log: DIR/log.mcap has all that its servos and cameras do, log-2.mcap the next time; no log without
    #[arg(long, value_name = "DIR", requires = "rig")]
    out: Option<PathBuf>,
    /// Folder of a finished study: a point of its figure shows the robot of the row
    #[arg(long, value_name = "DIR")]
    study: Option<PathBuf>,
    #[command(flatten)]
    loads: LoadArgs,
    #[command(flatten)]
    scene: SceneArgs,
    /// Port of 127.0.0.1; 0 for any free one
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// Print the address as the first line on stdout instead of opening a browser
    #[arg(long)]
    no_browser: bool,
}

/// Where the page is.
#[derive(Serialize)]
struct Served {
    address: String,
    /// The log of the rig.
    log: Option<PathBuf>,
}

pub(super) fn run(args: &ViewArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(out) = &args.out {
        super::output::folder("--out", out, "a folder for the log")?;
    }
    let overlays = Overlays::open(OverlayFiles {
        data: args.data.as_deref(),
        model: args.model.as_deref(),
        log: args.log.as_deref(),
        study: args.study.as_deref(),
    })?;
    let rig = args.rig.as_deref().map(load_rig).transpose()?;
    let spec = match (&rig, &args.robot, overlays.robot()) {
        (Some(rig), ..) => rig.robot.clone(),
        (None, Some(name_or_path), _) => load_robot(name_or_path)?,
        (None, None, Some(robot)) => robot.clone(),
        (None, None, None) => load_robot(Subject::ROBOT)?,
    };
    let robot = Robot::new(spec.clone())?;
    let start = args.command.lengths.as_deref();
    let start = start.map(|start| robot.command(start)).transpose()?;
    let recorded = match &args.commands {
        Some(file) => read_commands(file, |row| Ok(robot.command(&row.command)?))?,
        None => Vec::new(),
    };
    let around = args.scene.given()?;
    let around = around.or_else(|| rig.as_ref()?.scene.clone());
    let exhibit = Exhibit {
        scene: around.unwrap_or_default(),
        loads: args.loads.on(&robot)?,
        start: start.map(|start| start.as_slice().to_vec()),
        recorded: recorded
            .iter()
            .map(|command| command.as_slice().to_vec())
            .collect(),
        source: args.robot.as_deref().map(source).unwrap_or_default(),
        robot: spec,
        overlays,
        rig,
        out: args.out.clone(),
    };
    let view = View::open(exhibit, args.port)?;
    let served = Served {
        address: view.address().to_owned(),
        log: view.log().map(Path::to_owned),
    };
    if let Some(log) = &served.log {
        tracing::info!("the log is {}", log.display());
    }
    if args.no_browser || console.is_json() {
        console.result(&served, |served| served.address.clone())?;
    } else if open(&served.address) {
        tracing::info!("opened {}; Ctrl-C ends it", served.address);
    } else {
        tracing::warn!("no browser could be started; open {}", served.address);
    }
    while !console.interrupted() {
        thread::sleep(PATIENCE);
    }
    // The tension of a rig is released here; a second Ctrl-C switches its motors off at once.
    drop(view);
    Ok(())
}

/// Where the robot of a name or a path is from.
fn source(name_or_path: &str) -> Source {
    match RobotSpec::STANDARD.contains(&name_or_path) {
        true => Source::Memory,
        false => Source::File(Path::new(name_or_path).to_owned()),
    }
}

/// Opens an address in the browser; whether there is one.
fn open(address: &str) -> bool {
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ => "xdg-open",
    };
    let started = Command::new(program)
        .arg(address)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    started.is_ok()
}
