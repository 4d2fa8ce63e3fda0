//! Tables of settled commands, as `tdcr settle --commands` and `--path` print and write them.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;
use tdcr::report::counted;
use tdcr::sim::robot::{Command, Loads, Robot};
use tdcr::sim::statics::{Equilibrium, Examined, Stability};

use super::console::Console;
use super::loads::LoadsJson;
use super::output;
use super::settle_contacts::Surroundings;
use super::units::{command_columns, units};

/// Formats of the file.
const FORMATS: [&str; 2] = ["csv", "json"];

/// A table, from its first row on.
#[derive(Serialize)]
pub(super) struct Table {
    tdcr_version: &'static str,
    /// Name of the robot.
    robot: String,
    /// Loads under all commands, but for payloads of their own.
    loads: LoadsJson,
    units: Value,
    settled: Vec<Settled>,
}

/// One command.
#[derive(Serialize)]
pub(super) struct Settled {
    command: Vec<f64>,
    /// Payload (kg).
    payload: f64,
    /// Origin of the tip disc, world frame (m).
    tip_position: [f64; 3],
    /// Its orientation, world frame, a unit quaternion (w, x, y, z).
    tip_orientation: [f64; 4],
    tendon_tensions: Vec<f64>,
    tendon_lengths: Vec<f64>,
    /// Not a number with friction, where there is no potential.
    smallest_stiffness: f64,
    residual: f64,
    iterations: usize,
    pub converged: bool,
    /// As of `tdcr settle` with one command.
    stability: Option<Stability>,
    examined: Option<Examined>,
    /// How the robot came here, on a path.
    #[serde(flatten)]
    way: Option<Way>,
    /// What the robot touches, of a scene.
    #[serde(flatten)]
    surroundings: Option<Surroundings>,
}

/// How a path led to a command.
#[derive(Clone, Copy, Serialize)]
pub(super) struct Way {
    /// Snaps since the command before: motions too fast for quasi-statics, where no equilibrium was near.
    pub snaps: usize,
    /// Energy turned into heat at the tendons' holes since the first command (J).
    pub dissipated: f64,
}

impl Settled {
    pub fn new(
        robot: &Robot,
        (command, loads): (&Command, &Loads),
        settled: &Equilibrium,
        smallest_stiffness: f64,
        surroundings: Option<Surroundings>,
    ) -> Self {
        let tip = settled.disc_pose(robot.discs().len() - 1);
        let rotation = tip.rotation;
        Self {
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
            way: None,
        }
    }

    /// The same on a path.
    pub fn on_path(self, way: Way) -> Self {
        Self {
            way: Some(way),
            ..self
        }
    }
}

/// Where a table goes: asked before the work is done.
pub(super) struct Out<'a>(Option<(&'a Path, &'static str)>);

impl<'a> Out<'a> {
    pub fn new(out: Option<&'a Path>) -> anyhow::Result<Self> {
        let format = out.map(|out| output::format("--out", out, &FORMATS));
        Ok(Self(out.zip(format.transpose()?)))
    }

    /// Writes or prints the table of `settled`, whose loads but for payloads are `common`.
    pub fn publish(
        &self,
        robot: &Robot,
        common: &Loads,
        settled: Vec<Settled>,
        console: &Console,
    ) -> anyhow::Result<()> {
        let table = Table {
            tdcr_version: env!("CARGO_PKG_VERSION"),
            robot: robot.spec().name.clone(),
            loads: LoadsJson::new(common),
            units: units(robot),
            settled,
        };
        let Some((out, format)) = self.0 else {
            return console.result(&table, human_readable);
        };
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
        })
    }
}

/// What was written.
#[derive(Serialize)]
struct Summary {
    file: PathBuf,
    commands: usize,
    settled: usize,
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
    if settled.iter().any(|row| row.way.is_some()) {
        header.extend(["snaps", "dissipated (J)"].map(str::to_owned));
    }
    if settled.iter().any(|row| row.surroundings.is_some()) {
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
        if let Some(Way { snaps, dissipated }) = row.way {
            let _ = write!(text, ",{snaps},{dissipated:?}");
        }
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
        "command  tip x (m)      y (m)      z (m)   residual (N m)   smallest stiffness (N m/rad)   tension (N)",
    );
    let has_scene = table.settled.iter().any(|row| row.surroundings.is_some());
    text.push_str(match has_scene {
        true => "   contacts   force (N)\n",
        false => "\n",
    });
    for (number, row) in table.settled.iter().enumerate() {
        let [x, y, z] = row.tip_position;
        let tension = row.tendon_tensions.iter().copied().fold(0.0, f64::max);
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{number:7} {x:10.6} {y:10.6} {z:10.6}   {:14.1e}   {:28.3e}   {tension:11.4}",
            row.residual, row.smallest_stiffness,
        );
        if let Some(surroundings) = &row.surroundings {
            let (count, force) = (surroundings.count(), surroundings.largest_force());
            let _ = write!(text, "   {count:8}   {force:9.5}");
        }
        match row.way {
            Some(Way { snaps, .. }) if snaps > 0 => {
                let _ = write!(text, "   {}", counted(snaps, "snap"));
            }
            _ => {}
        }
        text.push_str(match row.stability {
            Some(Stability::Flutter) if row.converged => "   flutter (no damping)\n",
            _ if row.converged => "\n",
            Some(Stability::Flutter) => "   NOT settled (flutter)\n",
            _ => "   NOT settled\n",
        });
    }
    text
}
