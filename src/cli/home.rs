//! `tdcr home`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use tdcr::hw::capture::{Session, SessionSettings};
use tdcr::hw::rig::{Homing, HomingReport, Pace, Rig, ServoLink};

use super::console::Console;

/// Bytes that the log leaves on its disk: where servos stand is written there too.
const LOG_LEAVES: u64 = 1 << 20;

/// Define a rig's home, as servos lose count of their turns without power; nothing moves but with --check
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
    /// Then see whether every tendon pulls: with the robot straight, the servos wind to the largest tension that the rig's
    /// commands share, swing by some ticks, and let go. One that takes little current has a tendon that snapped or left its spool
    #[arg(long)]
    check: bool,
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
    /// What it takes where all tendons share one tension (A), if that was looked at.
    pull: Option<f64>,
}

pub(super) fn run(args: &HomeArgs, console: &Console) -> anyhow::Result<()> {
    let mut rig = Rig::open_file(super::load_rig(&args.rig)?, Pace::Computed)?;
    // Servos in memory end with the program, and with them what their homing was about.
    let lasting = matches!(rig.spec().servos.link, ServoLink::Serial(_));
    let log = match (lasting && !args.no_log, args.rig.file_stem()) {
        (true, Some(stem)) => {
            let folder = args.rig.parent().unwrap_or(Path::new(""));
            Some(rig.log_in(folder, &format!("{}.home", stem.display()), LOG_LEAVES)?)
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
    let pulls = match args.check {
        true => check(&mut rig, console).map(Some),
        false => Ok(None),
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
        pull: None,
    };
    let mut homed = Homed {
        log,
        servos: reports.iter().map(servo).collect(),
    };
    for (servo, pull) in homed.servos.iter_mut().zip(pulls?.into_iter().flatten()) {
        servo.pull = Some(pull);
    }
    console.summary(&homed, |homed| {
        let lines = homed.servos.iter().map(|servo| {
            let HomedServo {
                id,
                before,
                position,
                pull,
            } = servo;
            let pulls = pull.map_or(String::new(), |pull| format!(", pulls with {pull:.3} A"));
            format!(
                "servo {id}: {before} before, now homed, at {position} ticks from home{pulls}\n"
            )
        });
        lines.collect()
    })
}

/// Sees whether every tendon pulls, and what its servo takes for it (A).
fn check(rig: &mut Rig, console: &Console) -> anyhow::Result<Vec<f64>> {
    let settings = SessionSettings::default();
    let mut go_on = || console.go_on();
    let mut session = Session::begin(rig, &settings, None, &mut go_on)?;
    let pulls = session.check_tendons()?;
    session.end()?;
    Ok(pulls)
}
