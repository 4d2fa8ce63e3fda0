//! `tdcr plan`.

use std::cell::Cell;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use serde_json::{Value, json};
use tdcr::control::plan::{
    Goal, Insertion, MotionPlan, MotionPlanner, PlanError, PlanSettings, PlanStep, Stance,
};
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::robot::{Loads, Robot};
use tdcr::sim::scene::Scene;

use super::console::{Console, Interrupted};
use super::loads::{LoadArgs, LoadsJson, vector};
use super::picture::{MotionPicture, PictureArg};
use super::scene::SceneArgs;
use super::units::command_columns;
use super::{numbers, output};

/// Time of a step in pictures (s).
const STEP_TIME: f64 = 0.04;

/// Find a motion from one command to another, or to a place of the tip, clear of obstacles and without jumps
#[derive(Debug, Args)]
pub(super) struct PlanArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    /// Command to start from: of every tendon (m, or N for a tension drive), separated by commas
    #[arg(long, value_parser = numbers, allow_hyphen_values = true, value_name = "C,C,...")]
    from: Box<[f64]>,
    /// Command to end at
    #[arg(
        long,
        value_parser = numbers,
        allow_hyphen_values = true,
        required_unless_present = "tip",
        conflicts_with = "tip",
        value_name = "C,C,..."
    )]
    to: Option<Box<[f64]>>,
    /// Where the tip disc's origin is to end, world frame (m), under any command
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    tip: Option<[f64; 3]>,
    #[command(flatten)]
    loads: LoadArgs,
    #[command(flatten)]
    scene: SceneArgs,
    /// Least distance of the discs from obstacles (m), between the steps, too
    #[arg(long, default_value_t = PlanSettings::default().clearance, value_name = "M")]
    clearance: f64,
    /// Least tension of a tendon (N) [default: none]
    #[arg(long, value_name = "N")]
    min_tension: Option<f64>,
    /// Largest tension of a tendon (N) [default: none]
    #[arg(long, value_name = "N")]
    max_tension: Option<f64>,
    /// Move the base along its axis, too: least and largest insertion from where it is (m). The plan starts at 0
    #[arg(long, value_parser = range, allow_hyphen_values = true, value_name = "LOW,HIGH")]
    insertion: Option<[f64; 2]>,
    /// Insertion to end at (m), with --to
    #[arg(
        long,
        default_value_t = 0.0,
        requires = "insertion",
        conflicts_with = "tip",
        value_name = "M"
    )]
    to_insertion: f64,
    /// Seed of the search
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Time that the search takes at most (s)
    #[arg(long, default_value_t = PlanSettings::default().seconds, value_parser = super::positive, value_name = "S")]
    seconds: f64,
    /// Places that the search reaches at most
    #[arg(long, default_value_t = PlanSettings::default().nodes, value_parser = super::amount, value_name = "N")]
    nodes: usize,
    /// The table of steps to write (.csv or .json); settle, simulate and predict read the .csv with --commands
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    picture: PictureArg,
}

/// Parses the ends of a range.
fn range(text: &str) -> Result<[f64; 2], String> {
    let ends = numbers(text)?;
    <[f64; 2]>::try_from(ends.as_ref())
        .map_err(|_| format!("`{text}` has another number of ends; expected LOW,HIGH"))
}

/// A plan.
#[derive(Serialize)]
struct Planned {
    tdcr_version: &'static str,
    /// Name of the robot.
    robot: String,
    loads: LoadsJson,
    units: Value,
    /// Least distance from obstacles that was asked for (m).
    clearance: f64,
    steps: Vec<StepJson>,
    /// Places that the search reached.
    nodes: usize,
    /// Equilibria that were solved for.
    settled: usize,
    /// Time (s).
    seconds: f64,
}

/// A step of it.
#[derive(Serialize)]
struct StepJson {
    command: Vec<f64>,
    /// How far the base is inserted (m); absent of one that stands.
    #[serde(skip_serializing_if = "Option::is_none")]
    insertion: Option<f64>,
    /// Origin of the tip disc (m).
    tip_position: [f64; 3],
    /// Distance of the discs from the nearest obstacle at least (m); absent without obstacles.
    #[serde(skip_serializing_if = "Option::is_none")]
    clearance: Option<f64>,
    tendon_tensions: Vec<f64>,
}

impl StepJson {
    fn new(step: &PlanStep, base_moves: bool) -> Self {
        Self {
            command: step.stance.command.as_slice().to_vec(),
            insertion: base_moves.then_some(step.stance.insertion),
            tip_position: step.tip.into(),
            clearance: step.clearance,
            tendon_tensions: step.tensions.clone(),
        }
    }
}

pub(super) fn run(args: &PlanArgs, console: &Console) -> anyhow::Result<()> {
    let format = |out: &PathBuf| output::format("--out", out, &["csv", "json"]);
    let format = args.out.as_ref().map(format).transpose()?;
    let picture = args.picture.wanted_of_motion()?;
    let robot = Robot::new(args.robot.load()?)?;
    let loads = args.loads.on(&robot)?;
    let scene = args.scene.load()?;
    let settings = PlanSettings {
        clearance: args.clearance,
        tension: [
            args.min_tension.unwrap_or(f64::NEG_INFINITY),
            args.max_tension.unwrap_or(f64::INFINITY),
        ],
        insertion: args.insertion.map(|range| Insertion { range }),
        seed: args.seed,
        nodes: args.nodes,
        seconds: args.seconds,
    };
    let from = Stance::from(robot.command(&args.from)?);
    let to = match (&args.to, args.tip) {
        (_, Some(tip)) => Goal::Tip(tip.into()),
        (to, None) => Goal::Stance(Stance {
            command: robot.command(to.as_deref().unwrap_or_default())?,
            insertion: args.to_insertion,
        }),
    };
    let mut planner = MotionPlanner::new(&robot, &scene, &loads, settings)?;
    console.begin("plan", args.nodes as u64, 0);
    let reached = Cell::new(0);
    let planned = planner.plan_while(&from, &to, |nodes| {
        console.advance(nodes.saturating_sub(reached.replace(nodes)) as u64);
        !console.interrupted()
    });
    console.end();
    let plan = match planned {
        Err(PlanError::Interrupted) => return Err(Interrupted.into()),
        planned => planned?,
    };
    let command_units: Vec<&str> = robot.tendons().iter().map(|t| t.unit().symbol()).collect();
    let steps = plan.steps.iter();
    let planned = Planned {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        robot: robot.spec().name.clone(),
        loads: LoadsJson::new(&loads),
        units: json!({
            "command": command_units,
            "insertion": "m",
            "tip_position": "m",
            "clearance": "m",
            "tendon_tensions": "N",
            "seconds": "s",
        }),
        clearance: args.clearance,
        steps: (steps.map(|step| StepJson::new(step, args.insertion.is_some()))).collect(),
        nodes: plan.effort.nodes,
        settled: plan.effort.settled,
        seconds: plan.effort.seconds,
    };
    if let Some((out, format)) = args.out.as_deref().zip(format) {
        write(out, format, &robot, &planned)?;
    }
    if let Some(to) = picture {
        draw(to, &robot, &loads, &scene, &plan)?;
    }
    console.result(&planned, human_readable)
}

fn draw(
    to: (&Path, super::picture::Format),
    robot: &Robot,
    loads: &Loads,
    scene: &Scene,
    plan: &MotionPlan,
) -> anyhow::Result<()> {
    let length = (plan.steps.len(), STEP_TIME);
    let mut picture = MotionPicture::new(to, robot, loads, scene, length)?;
    for (number, step) in plan.steps.iter().enumerate() {
        let time = number as f64 * STEP_TIME;
        match step.stance.insertion {
            0.0 => picture.add(number, time, &step.configuration)?,
            insertion => {
                let moved = Insertion::moved(robot, insertion)?;
                picture.add_of(&moved, number, time, &step.configuration)?;
            }
        }
    }
    picture.finish()
}

fn write(out: &Path, format: &str, robot: &Robot, planned: &Planned) -> anyhow::Result<()> {
    if format == "json" {
        return output::write(out, serde_json::to_string_pretty(planned)? + "\n");
    }
    let first = &planned.steps[0];
    let mut header = command_columns(robot);
    header.extend(first.insertion.map(|_| "insertion (m)".to_owned()));
    let mut text = header.join(",") + "\n";
    for step in &planned.steps {
        let row = step.command.iter().copied().chain(step.insertion);
        let row: Vec<String> = row.map(|number| format!("{number:?}")).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}", row.join(","));
    }
    output::write(out, &text)
}

fn human_readable(planned: &Planned) -> String {
    let steps = &planned.steps;
    let tips: Vec<nalgebra::Vector3<f64>> =
        steps.iter().map(|step| step.tip_position.into()).collect();
    let way: f64 = tips.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    let mut text = format!(
        "{}, on which the tip moves {way:.3} m, in {:.2} s: {} reached, {} equilibria solved for\n",
        counted(steps.len().saturating_sub(1), "step"),
        planned.seconds,
        counted(planned.nodes, "place"),
        planned.settled,
    );
    let clearances = steps.iter().filter_map(|step| step.clearance);
    if let Some(least) = clearances.reduce(f64::min) {
        let _ = writeln!(
            text,
            "at the steps obstacles are {:.2} mm away at least",
            1e3 * least
        );
    }
    let tensions = steps.iter().flat_map(|step| &step.tendon_tensions);
    let [least, most] = tensions.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], n| {
        [least.min(*n), most.max(*n)]
    });
    if least <= most {
        let _ = writeln!(text, "tensions are {least:.2} to {most:.2} N");
    }
    for (name, step) in [("first", steps.first()), ("last", steps.last())] {
        if let Some(step) = step {
            let command: Vec<String> = step.command.iter().map(|c| format!("{c:.9}")).collect();
            let [x, y, z] = step.tip_position;
            let _ = writeln!(
                text,
                "{name:5} --command {}   tip {x:.6}, {y:.6}, {z:.6} m",
                command.join(",")
            );
        }
    }
    text
}
