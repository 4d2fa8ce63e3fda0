//! `tdcr deploy`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde::Serialize;
use serde_json::{Value, json};
use tdcr::control::plan::follow_the_leader::{
    BaseMotion, DeploymentError, DeploymentStage, DeploymentTask, deploy_while,
};
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::robot::Robot;

use super::commands::read_points;
use super::console::{Console, Interrupted};
use super::loads::{LoadArgs, LoadsJson};
use super::output;
use super::scene::SceneArgs;
use super::units::command_columns;

/// Deploy a robot along a curve so that its body stays where its tip has gone (follow the leader): the base moves, too
#[derive(Debug, Args)]
pub(super) struct DeployArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    /// Points of the curve (m), from its start on: CSV, one per line, optionally with a header (x, y and z among others), or JSON,
    /// a list of lists. It is no longer than the robot
    #[arg(long, value_name = "FILE")]
    along: PathBuf,
    /// How the base moves
    #[arg(long, value_enum, default_value_t = Base::Free)]
    base: Base,
    /// Stages, of which the first has the tip at the curve's start and the last at its end
    #[arg(long, default_value_t = 40, value_parser = super::amount, value_name = "N")]
    stages: usize,
    #[command(flatten)]
    loads: LoadArgs,
    #[command(flatten)]
    scene: SceneArgs,
    /// The table of stages to write (.csv or .json)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Base {
    /// In any way, as a manipulator carries it: the tip is exactly on the curve
    Free,
    /// Along the direction in which the curve begins
    Carriage,
}

impl From<Base> for BaseMotion {
    fn from(base: Base) -> Self {
        match base {
            Base::Free => Self::Free,
            Base::Carriage => Self::Carriage,
        }
    }
}

/// A deployment.
#[derive(Serialize)]
struct Deployed {
    tdcr_version: &'static str,
    /// Name of the robot.
    robot: String,
    loads: LoadsJson,
    units: Value,
    /// Mean distance of the body from the curve, over the stages (m).
    mean_deviation: f64,
    /// That of the worst stage (m).
    largest_deviation: f64,
    /// The first over the robot's length.
    relative_deviation: f64,
    stages: Vec<StageJson>,
}

#[derive(Serialize)]
struct StageJson {
    /// Of the curve at the tip (m).
    arc_length: f64,
    command: Vec<f64>,
    /// Of the base (m).
    base_position: [f64; 3],
    /// Of the base: a quaternion (w, x, y, z).
    base_orientation: [f64; 4],
    /// Origin of the tip disc (m).
    tip_position: [f64; 3],
    /// Mean distance from the curve of what is as far from the tip at most as the tip is along the curve (m).
    deviation: f64,
    /// Distance of the tip from its place (m).
    tip_error: f64,
    /// Sum of the forces of its contacts with obstacles and itself (N).
    contact_force: f64,
}

impl From<&DeploymentStage> for StageJson {
    fn from(stage: &DeploymentStage) -> Self {
        let q = stage.base.rotation;
        Self {
            arc_length: stage.arc_length,
            command: stage.command.as_slice().to_vec(),
            base_position: stage.base.translation.vector.into(),
            base_orientation: [q.w, q.i, q.j, q.k],
            tip_position: stage.positions[stage.positions.len() - 1].into(),
            deviation: stage.deviation,
            tip_error: stage.tip_error,
            contact_force: stage.contact_force(),
        }
    }
}

pub(super) fn run(args: &DeployArgs, console: &Console) -> anyhow::Result<()> {
    let format = |out: &PathBuf| output::format("--out", out, &["csv", "json"]);
    let format = args.out.as_ref().map(format).transpose()?;
    let robot = Robot::new(args.robot.load()?)?;
    let loads = args.loads.on(&robot)?;
    let points = read_points(&args.along)?;
    let points: Vec<_> = points.into_iter().map(Into::into).collect();
    let scene = args.scene.load()?;
    let task = DeploymentTask {
        robot: &robot,
        scene: &scene,
        loads: &loads,
        points: &points,
        motion: args.base.into(),
        stages: args.stages,
    };
    let mut begun = false;
    let deployed = deploy_while(&task, |_, steps| {
        if !std::mem::replace(&mut begun, true) {
            console.begin("deploy", steps as u64, 0);
        }
        console.advance(1);
        !console.interrupted()
    });
    console.end();
    let deployment = match deployed {
        Err(DeploymentError::Interrupted) => return Err(Interrupted.into()),
        deployed => deployed?,
    };
    let length = robot.arc_lengths().last().copied().unwrap_or_default();
    let command_units: Vec<&str> = robot.tendons().iter().map(|t| t.unit().symbol()).collect();
    let deployed = Deployed {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        robot: robot.spec().name.clone(),
        loads: LoadsJson::new(&loads),
        units: json!({
            "command": command_units,
            "arc_length": "m",
            "base_position": "m",
            "base_orientation": "unit quaternion (w, x, y, z)",
            "tip_position": "m",
            "deviation": "m",
            "tip_error": "m",
            "contact_force": "N",
        }),
        mean_deviation: deployment.mean_deviation,
        largest_deviation: deployment.largest_deviation,
        relative_deviation: deployment.mean_deviation / length,
        stages: deployment.stages.iter().map(Into::into).collect(),
    };
    if let Some((out, format)) = args.out.as_deref().zip(format) {
        write(out, format, &robot, &deployed)?;
    }
    console.result(&deployed, human_readable)
}

fn write(out: &Path, format: &str, robot: &Robot, deployed: &Deployed) -> anyhow::Result<()> {
    if format == "json" {
        return output::write(out, serde_json::to_string_pretty(deployed)? + "\n");
    }
    let mut header = command_columns(robot);
    header.extend(
        [
            "arc_length (m)",
            "base_x (m)",
            "base_y (m)",
            "base_z (m)",
            "base_qw",
            "base_qx",
            "base_qy",
            "base_qz",
            "x (m)",
            "y (m)",
            "z (m)",
            "deviation (m)",
            "tip_error (m)",
            "contact_force (N)",
        ]
        .map(str::to_owned),
    );
    let mut text = header.join(",") + "\n";
    for stage in &deployed.stages {
        let numbers = (stage.command.iter())
            .chain([&stage.arc_length])
            .chain(&stage.base_position)
            .chain(&stage.base_orientation)
            .chain(&stage.tip_position)
            .chain([&stage.deviation, &stage.tip_error, &stage.contact_force]);
        let row: Vec<String> = numbers.map(|number| format!("{number:?}")).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}", row.join(","));
    }
    output::write(out, &text)
}

fn human_readable(deployed: &Deployed) -> String {
    let most = |of: fn(&StageJson) -> f64| deployed.stages.iter().map(of).fold(0.0, f64::max);
    let (tip, force) = (
        most(|stage| stage.tip_error),
        most(|stage| stage.contact_force),
    );
    let touching = match force {
        0.0 => String::new(),
        force => format!("; contacts bear {force:.3} N together at most"),
    };
    format!(
        "{}: the body is {:.3} mm off the curve in the mean, {:.3} % of the robot's length, {:.3} mm at the worst stage; the tip {tip:.1e} m at most{touching}\n",
        counted(deployed.stages.len(), "stage"),
        1e3 * deployed.mean_deviation,
        100.0 * deployed.relative_deviation,
        1e3 * deployed.largest_deviation,
    )
}
