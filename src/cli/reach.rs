//! `tdcr reach`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;
use nalgebra::Vector3;
use serde::Serialize;
use serde_json::{Value, json};
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::contact::ContactSettler;
use tdcr::sim::inverse::shape::{Search, ShapeController, Target};
use tdcr::sim::robot::{Loads, Robot};
use tdcr::sim::scene::Scene;

use super::commands::read_points;
use super::console::{Console, Interrupted};
use super::loads::{LoadArgs, LoadsJson, vector};
use super::output;
use super::reach_cloud::{self, CloudArgs};
use super::reach_contact::{ContactArgs, PressJson};
use super::reach_found::Found;
use super::scene::SceneArgs;
use super::units::command_columns;

/// Find the command that brings the tip to a point, along a path of points, or the robot into the shape of a cloud or against an obstacle
#[derive(Debug, Args)]
pub(super) struct ReachArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    /// Target of the tip disc's origin, world frame (m)
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_parser = vector,
        allow_hyphen_values = true,
        required_unless_present_any = ["path", "cloud", "presses"],
        conflicts_with_all = ["path", "CloudArgs"]
    )]
    tip: Option<[f64; 3]>,
    /// Targets to reach one after another: CSV, one per line, optionally with a header (x, y and z among others), or JSON, a
    /// list of lists. The robot follows them without jumps where it can
    #[arg(long, value_name = "FILE", conflicts_with = "CloudArgs")]
    path: Option<PathBuf>,
    #[command(flatten)]
    cloud: CloudArgs,
    #[command(flatten)]
    loads: LoadArgs,
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    contact: ContactArgs,
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
    loads: LoadsJson,
    units: Value,
    /// Largest error that counts as reached (m).
    tolerance: f64,
    /// Least distance from obstacles that was asked for (m).
    #[serde(skip_serializing_if = "Option::is_none")]
    clearance: Option<f64>,
    found: Vec<Found>,
}

pub(super) fn run(args: &ReachArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(cloud) = &args.cloud.cloud {
        return reach_cloud::run(&args.cloud, cloud, args.loads.payload, args.seed, console);
    }
    let format = |out: &PathBuf| output::format("--out", out, &["csv", "json"]);
    let format = args.out.as_ref().map(format).transpose()?;
    let robot = Robot::new(args.robot.load()?)?;
    let loads = args.loads.on(&robot)?;
    let search = Search {
        tolerance: args.tolerance,
        seed: args.seed,
        ..Search::default()
    };
    let scene = args.scene.load()?;
    let controller = ShapeController::among(&robot, &scene, &loads, search)?;
    let found = match &args.path {
        Some(file) => follow(&robot, &scene, &controller, &read_points(file)?, console)?,
        None => {
            let goals = args.contact.on(&robot, &scene)?;
            let tip = args.tip.map(|tip| Target::tip(&robot, tip.into()));
            let solution = controller.reach_with(tip.as_slice(), &goals)?;
            vec![Found::new((&robot, &scene), args.tip, &goals, &solution)]
        }
    };
    if args.path.is_some() {
        warn(&robot, &scene, &loads, args.tolerance, &found)?;
    }
    let command_units: Vec<&str> = robot.tendons().iter().map(|t| t.unit().symbol()).collect();
    let table = Table {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        robot: robot.spec().name.clone(),
        loads: LoadsJson::new(&loads),
        units: json!({
            "command": command_units,
            "target": "m",
            "tip_position": "m",
            "error": "m",
            "disc_change": "m",
            "force": "N",
            "clearance": "m",
        }),
        tolerance: args.tolerance,
        clearance: args.contact.clearance(),
        found,
    };
    if let Some((out, format)) = args.out.as_deref().zip(format) {
        write(out, format, &robot, &table)?;
    }
    console.result(&table, human_readable)?;
    let missed = table.found.iter().filter(|found| !found.reached).count();
    match (missed, table.found.as_slice()) {
        (0, _) => Ok(()),
        (_, [only]) => bail!("{}", only.missed()),
        (_, all) => bail!(
            "{missed} of {} points {} not reached",
            all.len(),
            if missed == 1 { "is" } else { "are" }
        ),
    }
}

/// The commands for targets one after another, on one branch of solutions where there is one.
fn follow(
    robot: &Robot,
    scene: &Scene,
    controller: &ShapeController,
    targets: &[[f64; 3]],
    console: &Console,
) -> anyhow::Result<Vec<Found>> {
    let mut all = Vec::with_capacity(targets.len());
    let mut path = controller.path();
    console.begin("reach", targets.len() as u64, 0);
    for &target in targets {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        let point = path.follow(&[Target::tip(robot, target.into())])?;
        all.push(Found::on_path(robot, scene, target, &point));
        console.advance(1);
    }
    console.end();
    Ok(all)
}

/// Says where a path's commands do not tell all: where the robot jumps, and where a command alone, from the straight
/// pose, leads elsewhere.
fn warn(
    robot: &Robot,
    scene: &Scene,
    loads: &Loads,
    tolerance: f64,
    path: &[Found],
) -> anyhow::Result<()> {
    let switches = path.iter().filter(|found| found.switched()).count();
    if switches > 0 {
        let points = counted(switches, "point");
        tracing::warn!("at {points} the robot jumps to another branch of solutions");
    }
    let mut settler = ContactSettler::new(robot, scene);
    let mut elsewhere = 0;
    for found in path {
        let settled = settler.settle(&robot.command(&found.command)?, loads)?;
        let tip = settled.equilibrium.positions[robot.discs().len() - 1];
        let there = (tip - Vector3::from(found.tip_position)).norm() <= tolerance;
        elsewhere += usize::from(!there);
    }
    if elsewhere > 0 {
        tracing::warn!(
            "from the straight pose, {} of {} leads elsewhere: go through all from the first",
            elsewhere,
            counted(path.len(), "command")
        );
    }
    Ok(())
}

fn write(out: &Path, format: &str, robot: &Robot, table: &Table) -> anyhow::Result<()> {
    if format == "json" {
        return output::write(out, serde_json::to_string_pretty(table)? + "\n");
    }
    let mut header = command_columns(robot);
    header.extend(
        [
            "target_x (m)",
            "target_y (m)",
            "target_z (m)",
            "x (m)",
            "y (m)",
            "z (m)",
            "error (m)",
            "disc_change (m)",
            "reached",
            "arrival",
        ]
        .map(str::to_owned),
    );
    let mut text = header.join(",") + "\n";
    // Writing to a string cannot fail.
    for found in &table.found {
        for command in &found.via {
            for entry in command {
                let _ = write!(text, "{entry:?},");
            }
            text.push_str(",,,,,,,,,via\n");
        }
        let target = found.target.map_or([None; 3], |target| target.map(Some));
        let numbers = (found.command.iter().copied().map(Some))
            .chain(target)
            .chain(found.tip_position.map(Some))
            .chain([found.error, Some(found.disc_change)]);
        for number in numbers {
            let number = number.map_or_else(String::new, |number| format!("{number:?}"));
            let _ = write!(text, "{number},");
        }
        let arrival = found.arrival.unwrap_or_default();
        let _ = writeln!(text, "{},{arrival}", found.reached);
    }
    output::write(out, &text)
}

fn human_readable(table: &Table) -> String {
    let mut text = String::new();
    for found in &table.found {
        let command: Vec<String> = found.command.iter().map(|c| format!("{c:.9}")).collect();
        let [x, y, z] = found.tip_position;
        let _ = writeln!(
            text,
            "--command {}   tip {x:.6}, {y:.6}, {z:.6} m{}{}{}",
            command.join(","),
            found.error.map_or_else(String::new, |error| {
                format!(", {error:.1e} m from the point")
            }),
            match &found.reason {
                Some(reason) => format!(": {reason}"),
                None => touched(found),
            },
            match found.switched() {
                true => format!("; a JUMP of up to {:.3} m", found.disc_change),
                false => String::new(),
            }
        );
    }
    text
}

/// What the robot touches and what not, as the end of a sentence.
fn touched(found: &Found) -> String {
    let mut said = Vec::new();
    match found.contacts.as_deref().unwrap_or_default() {
        [] => {}
        contacts => said.push(counted(contacts.len(), "contact")),
    }
    said.extend(found.presses.iter().map(PressJson::in_words));
    if let Some(clearance) = found.clearance {
        said.push(format!("clear by {clearance:.6} m"));
    }
    said.iter().map(|said| format!("; {said}")).collect()
}
