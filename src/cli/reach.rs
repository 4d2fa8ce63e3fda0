//! `tdcr reach`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;
use serde::Serialize;
use serde_json::{Value, json};
use tdcr::pipeline::Monitor;
use tdcr::sim::inverse::shape::{
    Bound, Outcome, Search, ShapeController, ShapeError, ShapeSolution, Target,
};
use tdcr::sim::robot::Robot;

use super::commands::read_points;
use super::console::{Console, Interrupted};
use super::loads::{LoadArgs, LoadsSaid, vector};
use super::output;

/// Find the command that brings the tip to a point, or along a path of points
#[derive(Debug, Args)]
pub(super) struct ReachArgs {
    /// 2m, 3m, 5m, or the path of a robot file (.toml, .json, .xml or .urdf)
    #[arg(long, default_value = "2m")]
    robot: String,
    /// Where the tip disc's origin should be, world frame (m)
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_parser = vector,
        allow_hyphen_values = true,
        required_unless_present = "path",
        conflicts_with = "path"
    )]
    tip: Option<[f64; 3]>,
    /// Points to bring it to one after another: CSV, a line each, with a first line of names if need be (x, y and z among
    /// others), or JSON, a list of lists. Each command is sought near the one before
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    #[command(flatten)]
    loads: LoadArgs,
    /// Largest distance from a point that counts as reached (m)
    #[arg(long, default_value_t = 1e-6, value_parser = super::positive, value_name = "M")]
    tolerance: f64,
    /// Seed of the commands that the search starts from
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The table of commands to write (.csv or .json); settle, simulate and predict read the .csv with --commands
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// The commands found.
#[derive(Serialize)]
struct Table {
    tdcr_version: &'static str,
    /// Name of the robot.
    robot: String,
    loads: LoadsSaid,
    units: Value,
    /// Largest error that counts as reached (m).
    tolerance: f64,
    found: Vec<Found>,
}

/// The command for one point.
#[derive(Serialize)]
struct Found {
    /// The point (m).
    target: [f64; 3],
    /// The command that comes nearest.
    command: Vec<f64>,
    /// Where it brings the tip (m).
    tip_position: [f64; 3],
    /// Distance of that from the point (m).
    error: f64,
    reached: bool,
    /// Why not; `None` where it is reached.
    reason: Option<String>,
}

impl Found {
    fn new(robot: &Robot, target: [f64; 3], solution: &ShapeSolution) -> Self {
        let tip = solution.equilibrium.positions[robot.discs().len() - 1];
        Self {
            target,
            command: solution.command.as_slice().to_vec(),
            tip_position: tip.into(),
            error: solution.errors[0],
            reached: solution.outcome == Outcome::Reached,
            reason: reason(&solution.outcome),
        }
    }
}

/// Why a search ended short of its target.
fn reason(outcome: &Outcome) -> Option<String> {
    match outcome {
        Outcome::Reached => None,
        Outcome::Unreachable { active, .. } if active.is_empty() => {
            Some("out of reach: no command near it comes nearer".to_owned())
        }
        Outcome::Unreachable { active, .. } => {
            let end = |bound| match bound {
                Bound::Low => "low",
                Bound::High => "high",
            };
            let bounds = active
                .iter()
                .map(|a| format!("{} ({})", a.tendon, end(a.bound)));
            let bounds: Vec<String> = bounds.collect();
            let bounds = bounds.join(", ");
            Some(format!(
                "out of reach: tendons are at an end of their range: {bounds}"
            ))
        }
        Outcome::Stalled { .. } => Some("the search came to a halt".to_owned()),
    }
}

pub(super) fn run(args: &ReachArgs, console: &Console) -> anyhow::Result<()> {
    let format = |out: &PathBuf| output::format("--out", out, &["csv", "json"]);
    let format = args.out.as_ref().map(format).transpose()?;
    let robot = Robot::new(super::load_robot(&args.robot)?)?;
    let loads = args.loads.on(&robot)?;
    let targets = match (&args.path, args.tip) {
        (Some(file), _) => read_points(file)?,
        (None, Some(tip)) => vec![tip],
        (None, None) => bail!("say --tip or --path"),
    };
    let search = Search {
        tolerance: args.tolerance,
        seed: args.seed,
        ..Search::default()
    };
    let controller = ShapeController::new(&robot, &loads, search)?;
    let command_units: Vec<&str> = robot.tendons().iter().map(|t| t.unit().symbol()).collect();
    let table = Table {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        robot: robot.spec().name.clone(),
        loads: LoadsSaid::new(&loads),
        units: json!({"command": command_units, "target": "m", "tip_position": "m", "error": "m"}),
        tolerance: args.tolerance,
        found: follow(&robot, &controller, &targets, console)?,
    };
    if let Some((out, format)) = args.out.as_deref().zip(format) {
        write(out, format, &robot, &table)?;
    }
    console.result(&table, for_people)?;
    let missed = table.found.iter().filter(|found| !found.reached).count();
    match (missed, table.found.as_slice()) {
        (0, _) => Ok(()),
        (_, [only]) => bail!(
            "the point is not reached, the tip stays {:.3e} m off: {}",
            only.error,
            only.reason.as_deref().unwrap_or_default()
        ),
        (_, all) => bail!("{missed} of {} points are not reached", all.len()),
    }
}

/// The commands for targets one after another, each sought near the one before.
fn follow(
    robot: &Robot,
    controller: &ShapeController,
    targets: &[[f64; 3]],
    console: &Console,
) -> anyhow::Result<Vec<Found>> {
    let mut all = Vec::with_capacity(targets.len());
    let mut last: Option<ShapeSolution> = None;
    console.begin("reach", targets.len() as u64, 0);
    for &target in targets {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        let solution = next(robot, controller, target, last.as_ref())?;
        all.push(Found::new(robot, target, &solution));
        last = Some(solution);
        console.advance(1);
    }
    console.end();
    Ok(all)
}

fn next(
    robot: &Robot,
    controller: &ShapeController,
    target: [f64; 3],
    last: Option<&ShapeSolution>,
) -> Result<ShapeSolution, ShapeError> {
    let target = [Target::tip(robot, target.into())];
    match last {
        Some(last) => controller.reach_from(&target, &last.command),
        None => controller.reach(&target),
    }
}

fn write(out: &Path, format: &str, robot: &Robot, table: &Table) -> anyhow::Result<()> {
    if format == "json" {
        return output::write(out, &(serde_json::to_string_pretty(table)? + "\n"));
    }
    let commands = robot.tendons().iter().enumerate();
    let mut header: Vec<String> = commands
        .map(|(t, tendon)| format!("c{t} ({})", tendon.unit()))
        .collect();
    header.extend(
        [
            "target_x (m)",
            "target_y (m)",
            "target_z (m)",
            "x (m)",
            "y (m)",
            "z (m)",
            "error (m)",
            "reached",
        ]
        .map(str::to_owned),
    );
    let mut text = header.join(",") + "\n";
    for found in &table.found {
        let numbers = (found.command.iter())
            .chain(&found.target)
            .chain(&found.tip_position)
            .chain([&found.error]);
        for number in numbers {
            // Writing to a string cannot fail.
            let _ = write!(text, "{number},");
        }
        let _ = writeln!(text, "{}", found.reached);
    }
    output::write(out, &text)
}

fn for_people(table: &Table) -> String {
    let mut text = String::new();
    for found in &table.found {
        let command: Vec<String> = found.command.iter().map(|c| format!("{c:.6}")).collect();
        let [x, y, z] = found.tip_position;
        let _ = writeln!(
            text,
            "--command {}   tip {x:.6}, {y:.6}, {z:.6} m, {:.1e} m from the point{}",
            command.join(","),
            found.error,
            match &found.reason {
                Some(reason) => format!(": {reason}"),
                None => String::new(),
            }
        );
    }
    text
}
