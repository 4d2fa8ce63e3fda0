//! `tdcr pretension`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use serde::Serialize;
use tdcr::hw::rig::{
    ByHand, Gauged, Pace, PretensionSettings, Pretensioned, Rig, RigError, RigFile, Turn,
    WinchState,
};

use super::console::Console;

/// Tension all tendons alike by the currents of their servos, and call that home
///
/// The robot stands straight, its tendons on their spools, slack or nearly so. Each servo winds in small steps, the one that
/// pulls least first, with its current limited all the while; live currents are shown. Where a servo reaches its limits first,
/// nothing is homed. With --by-hand the servos hold, and a person turns the bevel gears that each tendon has, told which and which
/// way, until all pull as they should.
#[derive(Debug, Args)]
pub(super) struct PretensionArgs {
    /// File of the rig
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Current that each servo is to pull with (A); with --by-hand also one for each, separated by commas
    #[arg(long, value_name = "A", value_parser = super::positive, value_delimiter = ',', num_args = 1, required = true)]
    current: Vec<f64>,
    /// Steps that tendons are wound in (ticks)
    #[arg(long, default_value_t = PretensionSettings::default().step, value_name = "TICKS", value_parser = clap::value_parser!(i32).range(1..=200), conflicts_with = "by_hand")]
    step: i32,
    /// Hold the servos while the gears are turned by hand
    #[arg(long)]
    by_hand: bool,
    /// How long to wait for hands (s)
    #[arg(long, default_value_t = ByHand::default().patience.as_secs_f64(), value_name = "S", value_parser = super::positive, requires = "by_hand", conflicts_with = "step")]
    patience: f64,
}

#[derive(Serialize)]
struct Summary {
    servos: Vec<Servo>,
}

#[derive(Serialize)]
struct Servo {
    id: u8,
    /// How far it wound (ticks, as it counts).
    wound: i32,
    /// What it pulls with (A).
    pull: f64,
}

pub(super) fn run(args: &PretensionArgs, console: &Console) -> anyhow::Result<()> {
    let file = super::load_rig(&args.rig)?;
    let tensioned = match (args.by_hand, args.current.as_slice()) {
        (true, currents) => by_hand(file, currents, args.patience, console),
        (false, &[current]) => wind(file, current, args.step, console),
        (false, _) => {
            anyhow::bail!("--current has several values; expected one, or --by-hand");
        }
    };
    let tensioned = tensioned?;
    let servo = |found: &Pretensioned| Servo {
        id: found.id.get(),
        wound: found.wound,
        pull: found.pull,
    };
    let summary = Summary {
        servos: tensioned.iter().map(servo).collect(),
    };
    console.summary(&summary, |summary| {
        let lines = summary.servos.iter().map(|servo| {
            let Servo { id, wound, pull } = servo;
            format!("servo {id}: wound by {wound} ticks, pulls with {pull:.3} A; home\n")
        });
        lines.collect()
    })
}

/// Has the servos wind.
fn wind(
    file: RigFile,
    current: f64,
    step: i32,
    console: &Console,
) -> Result<Vec<Pretensioned>, RigError> {
    let settings = PretensionSettings {
        current,
        step,
        ..PretensionSettings::default()
    };
    let mut show = |states: &[WinchState]| {
        console.tell(&pulls(states.iter().map(|state| state.pull)));
        console.go_on()
    };
    Rig::open_file(file, Pace::Computed)?.pretension(&settings, &mut show)
}

/// Has a person turn gears, and says which.
fn by_hand(
    file: RigFile,
    currents: &[f64],
    patience: f64,
    console: &Console,
) -> Result<Vec<Pretensioned>, RigError> {
    let settings = ByHand {
        currents: currents.to_vec(),
        patience: Duration::try_from_secs_f64(patience).unwrap_or(Duration::MAX),
        ..ByHand::default()
    };
    let mut show = |gauged: &[Gauged]| {
        console.tell(&pulls(gauged.iter().map(|gauged| gauged.pull)));
        for (tendon, gauged) in gauged.iter().enumerate() {
            let Gauged {
                id, pull, target, ..
            } = gauged;
            let told = match gauged.turn {
                Turn::Leave => continue,
                Turn::Tighten => "further",
                Turn::Loosen => "back",
            };
            console.tell(&format!(
                "  turn the bevel gear of tendon {} {told}: servo {id} pulls with {pull:.3} A of {target}",
                tendon + 1
            ));
        }
        console.go_on()
    };
    Rig::open_file(file, Pace::Computed)?.pretension_by_hand(&settings, &mut show)
}

fn pulls(pulls: impl Iterator<Item = f64>) -> String {
    let pulls: Vec<String> = pulls.map(|pull| format!("{pull:6.3}")).collect();
    format!("pulling with {} A", pulls.join(" "))
}
