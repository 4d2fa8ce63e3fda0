//! `tdcr settle --commands`: a table of settled commands.

use std::fmt::Write;
use std::path::Path;

use anyhow::bail;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::contact::{ContactError, ContactSettler};
use tdcr::sim::robot::{Command, Loads, Robot};
use tdcr::sim::scene::Scene;
use tdcr::sim::statics::{Examined, Stability};

use super::commands::{Row, read_commands};
use super::console::{Console, Interrupted};
use super::loads::{LoadArgs, LoadsJson};
use super::output;
use super::settle_contacts::Surroundings;
use super::units::{command_columns, units};

/// Commands settled between two safe points.
const BATCH: usize = 1024;

/// All that was settled.
#[derive(Serialize)]
struct Table {
    tdcr_version: &'static str,
    /// Name of the robot.
    robot: String,
    /// Loads under all commands, but for payloads of their own.
    loads: LoadsJson,
    units: Value,
    settled: Vec<Settled>,
}

#[derive(Serialize)]
struct Settled {
    command: Vec<f64>,
    /// Payload (kg).
    payload: f64,
    /// Origin of the tip disc, world frame (m).
    tip_position: [f64; 3],
    /// Its orientation, world frame, a unit quaternion (w, x, y, z).
    tip_orientation: [f64; 4],
    tendon_tensions: Vec<f64>,
    tendon_lengths: Vec<f64>,
    smallest_stiffness: f64,
    residual: f64,
    iterations: usize,
    converged: bool,
    /// As of `tdcr settle` with one command.
    stability: Option<Stability>,
    examined: Option<Examined>,
    /// What the robot touches, of a scene.
    #[serde(flatten)]
    surroundings: Option<Surroundings>,
}

impl Settled {
    /// Settles a command from the straight pose.
    fn new(
        settler: &mut ContactSettler,
        command: &Command,
        loads: &Loads,
    ) -> Result<Self, ContactError> {
        settler.settle(command, loads)?;
        let smallest_stiffness = settler.smallest_stiffness(command, loads);
        let surroundings = Surroundings::of(settler);
        let (robot, settled) = (settler.robot(), &settler.found().equilibrium);
        let tip = settled.disc_pose(robot.discs().len() - 1);
        let rotation = tip.rotation;
        Ok(Self {
            command: command.as_slice().to_vec(),
            payload: loads.tip_payload().mass,
            tip_position: tip.translation.vector.into(),
            tip_orientation: [rotation.w, rotation.i, rotation.j, rotation.k],
            tendon_tensions: settled.tendon_tensions.clone(),
            tendon_lengths: settled.tendon_lengths.clone(),
            smallest_stiffness,
            surroundings,
            residual: settled.residual,
            iterations: settled.iterations,
            converged: settled.converged,
            stability: settled.stability,
            examined: settled.examined,
        })
    }
}

/// Settles the commands of a file, each from the straight pose, and writes or prints the table.
pub(super) fn run(
    robot: &Robot,
    scene: &Scene,
    file: &Path,
    loads: &LoadArgs,
    out: Option<&Path>,
    console: &Console,
) -> anyhow::Result<()> {
    let format = out.map(|out| output::format("--out", out, &["csv", "json"]));
    let format = format.transpose()?;
    let common = loads.on(robot)?;
    let jobs = read_commands(file, |Row { command, payload }| {
        let loads = match payload {
            Some(payload) => loads.with_payload(payload, robot)?,
            None => common.clone(),
        };
        Ok((robot.command(&command)?, loads))
    })?;
    let table = Table {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        robot: robot.spec().name.clone(),
        loads: LoadsJson::new(&common),
        units: units(robot),
        settled: settle(robot, scene, &jobs, console)?,
    };
    match out.zip(format) {
        None => console.result(&table, human_readable)?,
        Some((out, format)) => {
            let text = match format {
                "json" => serde_json::to_string_pretty(&table)? + "\n",
                _ => csv(robot, &table.settled),
            };
            output::write(out, &text)?;
            let summary = Summary {
                file: out.to_owned(),
                commands: table.settled.len(),
                settled: table.settled.iter().filter(|s| s.converged).count(),
            };
            console.summary(&summary, |s| {
                let file = s.file.display();
                let commands = counted(s.commands, "command");
                format!("{file}: {} of {commands} settled", s.settled)
            })?;
        }
    }
    let failed = table.settled.iter().filter(|s| !s.converged).count();
    if failed > 0 {
        let count = counted(table.settled.len(), "command");
        bail!("{failed} of {count} did not settle");
    }
    Ok(())
}

/// What was written.
#[derive(Serialize)]
struct Summary {
    file: std::path::PathBuf,
    commands: usize,
    settled: usize,
}

fn settle(
    robot: &Robot,
    scene: &Scene,
    jobs: &[(Command, Loads)],
    console: &Console,
) -> anyhow::Result<Vec<Settled>> {
    let mut all = Vec::with_capacity(jobs.len());
    console.begin("settle", jobs.len() as u64, 0);
    for batch in jobs.chunks(BATCH) {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        let settle = |settler: &mut ContactSettler, (command, loads): &(Command, Loads)| {
            Settled::new(settler, command, loads)
        };
        let settled = (batch.par_iter()).map_init(|| ContactSettler::new(robot, scene), settle);
        let settled: Result<Vec<_>, _> = settled.collect();
        all.extend(settled?);
        console.advance(batch.len() as u64);
    }
    console.end();
    Ok(all)
}

/// The table with a line for each command, and units in the first.
fn csv(robot: &Robot, settled: &[Settled]) -> String {
    let tendons = robot.tendons();
    let mut header = command_columns(robot);
    header.extend(
        [
            "payload (kg)",
            "x (m)",
            "y (m)",
            "z (m)",
            "qw",
            "qx",
            "qy",
            "qz",
        ]
        .map(str::to_owned),
    );
    header.extend((0..tendons.len()).map(|t| format!("tension{t} (N)")));
    header.extend((0..tendons.len()).map(|t| format!("length{t} (m)")));
    header.extend(
        [
            "smallest_stiffness (N m/rad)",
            "residual (N m)",
            "iterations",
            "converged",
            "stability",
            "examined",
        ]
        .map(str::to_owned),
    );
    let among_obstacles = settled.iter().any(|row| row.surroundings.is_some());
    if among_obstacles {
        header.extend(["contacts", "largest_contact_force (N)"].map(str::to_owned));
    }
    let mut text = header.join(",") + "\n";
    for row in settled {
        let numbers = (row.command.iter())
            .chain([&row.payload])
            .chain(&row.tip_position)
            .chain(&row.tip_orientation)
            .chain(&row.tendon_tensions)
            .chain(&row.tendon_lengths)
            .chain([&row.smallest_stiffness, &row.residual]);
        for number in numbers {
            // Writing to a string cannot fail.
            let _ = write!(text, "{number:?},");
        }
        let stability = row.stability.map_or("", Stability::name);
        let examined = row.examined.map_or("", Examined::name);
        let _ = write!(
            text,
            "{},{},{stability},{examined}",
            row.iterations, row.converged
        );
        if let Some(surroundings) = &row.surroundings {
            let (count, force) = (surroundings.count(), surroundings.largest_force());
            let _ = write!(text, ",{count},{force:?}");
        }
        text.push('\n');
    }
    text
}

fn human_readable(table: &Table) -> String {
    let mut text = String::from(
        "command  tip x (m)      y (m)      z (m)   residual (N m)   smallest stiffness (N m/rad)\n",
    );
    for (number, row) in table.settled.iter().enumerate() {
        let [x, y, z] = row.tip_position;
        let _ = writeln!(
            text,
            "{number:7} {x:10.6} {y:10.6} {z:10.6}   {:14.1e}   {:28.3e}{}",
            row.residual,
            row.smallest_stiffness,
            match row.stability {
                Some(Stability::Flutter) if row.converged => "   flutter (no damping)",
                _ if row.converged => "",
                Some(Stability::Flutter) => "   NOT settled (flutter)",
                _ => "   NOT settled",
            }
        );
    }
    text
}
