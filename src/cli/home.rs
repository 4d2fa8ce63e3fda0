//! `tdcr home`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::hw::rig::{Homing, HomingReport, Pace, Rig, RigFile};

use super::console::Console;

/// Tell a rig where its servos stand, which forget their turns without power; nothing moves
///
/// Without --here, home is found from where the servos were left, which works while none was turned by more than a quarter of
/// a turn since. What is known is kept beside the rig's file (FILE with the extension .turns.json).
#[derive(Debug, Args)]
pub(super) struct HomeArgs {
    /// File of the rig
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// The robot is in its home pose now: straight, every tendon at its tension of home
    #[arg(long)]
    here: bool,
}

#[derive(Serialize)]
struct Homed {
    servos: Vec<HomedServo>,
}

#[derive(Serialize)]
struct HomedServo {
    id: u8,
    /// What was known before.
    before: &'static str,
    /// Where it stands, from home (ticks).
    position: i32,
}

pub(super) fn run(args: &HomeArgs, console: &Console) -> anyhow::Result<()> {
    let mut rig = Rig::open_file(RigFile::load(&args.rig)?, Pace::Computed)?;
    let reports = match args.here {
        true => {
            rig.meet()?;
            rig.home_here()?
        }
        false => rig.home_recalled()?,
    };
    let servo = |report: &HomingReport| HomedServo {
        id: report.id.get(),
        before: match report.before {
            Homing::Homed(_) => "homed",
            Homing::Never => "never homed",
            Homing::Lost { .. } => "lost",
        },
        position: report.position.0,
    };
    let homed = Homed {
        servos: reports.iter().map(servo).collect(),
    };
    console.result(&homed, |homed| {
        let lines = homed.servos.iter().map(|servo| {
            let HomedServo {
                id,
                before,
                position,
            } = servo;
            format!("servo {id}: {before} before, now homed, at {position} ticks from home\n")
        });
        lines.collect()
    })
}
