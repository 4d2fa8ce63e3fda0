//! `tdcr pretension`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::hw::rig::{Pace, PretensionSettings, Pretensioned, Rig, RigFile, WinchState};

use super::console::{Console, say};

/// Wind all tendons up until each pulls with the same current, and call that home
///
/// The robot stands straight, its tendons on their spools, slack or nearly so. Each servo winds in small steps, the one that
/// pulls least first, with its current limited all the while; live currents are shown. The gears are then where the
/// paper's are set by hand. Where a servo reaches its limits first, nothing is homed.
#[derive(Debug, Args)]
pub(super) struct PretensionArgs {
    /// File of the rig
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Current that each servo is to pull with (A)
    #[arg(long, value_name = "A", value_parser = super::positive)]
    current: f64,
    /// Steps that tendons are wound in (ticks)
    #[arg(long, default_value_t = PretensionSettings::default().step, value_name = "TICKS", value_parser = clap::value_parser!(i32).range(1..=200))]
    step: i32,
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
    let settings = PretensionSettings {
        current: args.current,
        step: args.step,
        ..PretensionSettings::default()
    };
    let mut rig = Rig::open_file(RigFile::load(&args.rig)?, Pace::Computed)?;
    let interrupted = || tdcr::pipeline::Monitor::interrupted(console);
    let mut show = |states: &[WinchState]| {
        let pulls: Vec<String> = states
            .iter()
            .map(|state| format!("{:6.3}", state.pull))
            .collect();
        say(&format!("pulling with {} A", pulls.join(" ")));
        match interrupted() {
            true => std::ops::ControlFlow::Break(()),
            false => std::ops::ControlFlow::Continue(()),
        }
    };
    let found = rig.pretension(&settings, &mut show)?;
    let servo = |found: &Pretensioned| Servo {
        id: found.id.get(),
        wound: found.wound,
        pull: found.pull,
    };
    let summary = Summary {
        servos: found.iter().map(servo).collect(),
    };
    console.result(&summary, |summary| {
        let lines = summary.servos.iter().map(|servo| {
            let Servo { id, wound, pull } = servo;
            format!("servo {id}: wound by {wound} ticks, pulls with {pull:.3} A; home\n")
        });
        lines.collect()
    })
}
