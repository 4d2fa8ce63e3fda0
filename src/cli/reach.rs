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
use tdcr::sim::inverse::shape::{
    Arrival, Bound, Outcome, PathPoint, Search, ShapeController, ShapeSolution, Target,
};
use tdcr::sim::robot::{Loads, Robot};
use tdcr::sim::scene::Scene;

use super::commands::read_points;
use super::console::{Console, Interrupted};
use super::loads::{LoadArgs, LoadsJson, vector};
use super::output;
use super::reach_cloud::{self, CloudArgs};
use super::scene::SceneArgs;
use super::settle_contacts::ContactJson;
use super::units::command_columns;

/// Find the command that brings the tip to a point, along a path of points, or the robot into the shape of a cloud
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
        required_unless_present_any = ["path", "cloud"],
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
    /// What the robot touches; `None` without obstacles.
    #[serde(skip_serializing_if = "Option::is_none")]
    contacts: Option<Vec<ContactJson>>,
    /// Why not; `None` where it is reached.
    reason: Option<String>,
    /// How the robot comes here from the point before; `None` for a single point.
    arrival: Option<&'static str>,
    /// Commands to go through before this one, so that it comes here without a jump.
    via: Vec<Vec<f64>>,
    /// How far the disc that moves most comes since the point before (m).
    disc_change: f64,
}

impl Found {
    fn new(robot: &Robot, scene: &Scene, target: [f64; 3], solution: &ShapeSolution) -> Self {
        let contacts = solution.among.as_ref().map(|among| {
            let contacts = among.contacts.iter();
            contacts
                .map(|contact| ContactJson::of(contact, scene))
                .collect()
        });
        let tip = solution.equilibrium.positions[robot.discs().len() - 1];
        Self {
            target,
            command: solution.command.as_slice().to_vec(),
            tip_position: tip.into(),
            error: solution.errors[0],
            reached: solution.outcome == Outcome::Reached,
            contacts,
            reason: reason(&solution.outcome, scene),
            arrival: None,
            via: Vec::new(),
            disc_change: 0.0,
        }
    }

    fn on_path(robot: &Robot, scene: &Scene, target: [f64; 3], point: &PathPoint) -> Self {
        let arrival = match point.arrival {
            Arrival::First => "first",
            Arrival::Followed => "followed",
            Arrival::Switched => SWITCHED,
        };
        let via = point.via.iter().map(|command| command.as_slice().to_vec());
        Self {
            arrival: Some(arrival),
            via: via.collect(),
            disc_change: point.disc_change,
            ..Self::new(robot, scene, target, &point.solution)
        }
    }

    fn switched(&self) -> bool {
        self.arrival == Some(SWITCHED)
    }
}

/// The robot jumps to another branch of solutions.
const SWITCHED: &str = "switched";

/// Why a search ended short of its target.
fn reason(outcome: &Outcome, scene: &Scene) -> Option<String> {
    let name = |obstacle: usize| &scene.obstacles()[obstacle].name;
    match outcome {
        Outcome::Reached => None,
        Outcome::Unreachable {
            active, obstacles, ..
        } => {
            let end = |bound| match bound {
                Bound::Low => "low",
                Bound::High => "high",
            };
            let bounds = (active.iter()).map(|a| format!("{} ({})", a.tendon, end(a.bound)));
            let discs = (obstacles.iter())
                .map(|one| format!("{:?} (disc {})", name(one.obstacle), one.disc));
            let [bounds, discs] =
                [bounds.collect(), discs.collect()].map(|all: Vec<_>| all.join(", "));
            let why = match (bounds.as_str(), discs.as_str()) {
                ("", "") => "no command near it comes nearer".to_owned(),
                (bounds, "") => format!("tendons are at an end of their range: {bounds}"),
                ("", discs) => format!("the robot keeps clear of {discs}"),
                (bounds, discs) => format!(
                    "the robot keeps clear of {discs}, and tendons are at an end of their range: {bounds}"
                ),
            };
            Some(format!("out of reach: {why}"))
        }
        Outcome::TooNear { nearest } => Some(format!(
            "no command was found that keeps clear: disc {} is {:.6} m from {:?}",
            nearest.disc,
            nearest.gap,
            name(nearest.obstacle)
        )),
        Outcome::Stalled { .. } => Some("the search came to a halt".to_owned()),
    }
}

pub(super) fn run(args: &ReachArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(cloud) = &args.cloud.cloud {
        return reach_cloud::run(&args.cloud, cloud, args.loads.payload, args.seed, console);
    }
    let format = |out: &PathBuf| output::format("--out", out, &["csv", "json"]);
    let format = args.out.as_ref().map(format).transpose()?;
    let robot = Robot::new(args.robot.load()?)?;
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
    let scene = args.scene.load()?;
    let controller = ShapeController::among(&robot, &scene, &loads, search)?;
    let found = match (&args.path, targets.as_slice()) {
        (None, [tip]) => {
            let solution = controller.reach(&[Target::tip(&robot, (*tip).into())])?;
            vec![Found::new(&robot, &scene, *tip, &solution)]
        }
        _ => follow(&robot, &scene, &controller, &targets, console)?,
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
        }),
        tolerance: args.tolerance,
        found,
    };
    if let Some((out, format)) = args.out.as_deref().zip(format) {
        write(out, format, &robot, &table)?;
    }
    console.result(&table, human_readable)?;
    let missed = table.found.iter().filter(|found| !found.reached).count();
    match (missed, table.found.as_slice()) {
        (0, _) => Ok(()),
        (_, [only]) => bail!(
            "the point is not reached, the tip stays {:.3e} m off: {}",
            only.error,
            only.reason.as_deref().unwrap_or_default()
        ),
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
        let numbers = (found.command.iter())
            .chain(&found.target)
            .chain(&found.tip_position)
            .chain([&found.error, &found.disc_change]);
        for number in numbers {
            let _ = write!(text, "{number:?},");
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
            "--command {}   tip {x:.6}, {y:.6}, {z:.6} m, {:.1e} m from the point{}{}",
            command.join(","),
            found.error,
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

/// What the robot touches, as the end of a sentence.
fn touched(found: &Found) -> String {
    let contacts = found.contacts.as_deref().unwrap_or_default();
    match contacts {
        [] => String::new(),
        contacts => format!("; {}", counted(contacts.len(), "contact")),
    }
}
