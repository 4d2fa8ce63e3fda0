//! `tdcr home`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use tdcr::hw::rig::{Homing, HomingReport, Pace, Rig, RigFile, ServoLink};

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
    /// Write no log. Else what servos on a port said lies beside the rig's file, with the extension .home.mcap or .home-2.mcap
    /// and so on
    #[arg(long)]
    no_log: bool,
}

#[derive(Serialize)]
struct Homed {
    log: Option<PathBuf>,
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
    // Servos in memory end with the program, and with them what their homing was about.
    let lasting = matches!(rig.spec().servos.link, ServoLink::Serial(_));
    let log = match (lasting && !args.no_log, args.rig.file_stem()) {
        (true, Some(stem)) => {
            let folder = args.rig.parent().unwrap_or(Path::new(""));
            Some(rig.log_in(folder, &format!("{}.home", stem.display()))?)
        }
        _ => None,
    };
    let reports = match args.here {
        true => {
            rig.meet()?;
            rig.home_here()?
        }
        false => rig.home_recalled()?,
    };
    rig.finish_log()?;
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
        log,
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
