//! `tdcr background`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use tdcr::hw::rig::RigError;
use tdcr::pipeline::Monitor;
use tdcr::report::counted;

use super::console::{Console, Interrupted};

/// Record the empty scene, against which masks tell a robot
///
/// The robot has to be out of sight; cameras in memory do not see it. Nothing moves. The log is what masks.background of the rig's
/// file then names: background = { log = "FILE" }. Record it anew whenever a camera or what it sees has moved.
#[derive(Debug, Args)]
pub(super) struct BackgroundArgs {
    /// File of the rig
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Pictures by each camera: five at least, to tell noise from things
    #[arg(long, default_value_t = 30, value_name = "N", value_parser = clap::value_parser!(u32).range(5..=1000))]
    pictures: u32,
    /// The log to write, an MCAP file; one that is there is left as it is
    #[arg(long, default_value = "background.mcap", value_name = "FILE")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Recorded<'a> {
    file: &'a Path,
    pictures: u32,
    cameras: usize,
}

pub(super) fn run(args: &BackgroundArgs, console: &Console) -> anyhow::Result<()> {
    let rig = super::load_rig(&args.rig)?;
    console.begin("background", args.pictures.into(), 0);
    let mut begun = 0;
    let mut go_on = || {
        console.advance(u64::from(begun > 0));
        begun += 1;
        console.go_on()
    };
    match rig.record_background(&args.out, args.pictures as usize, &mut go_on) {
        // There was none to release.
        Err(RigError::Interrupted) => return Err(Interrupted.into()),
        recorded => recorded?,
    }
    console.end();
    let recorded = Recorded {
        file: &args.out,
        pictures: args.pictures,
        cameras: rig.spec.cameras.len(),
    };
    console.summary(&recorded, |recorded| {
        format!(
            "{}: {} by each of {}",
            recorded.file.display(),
            counted(recorded.pictures as usize, "picture"),
            counted(recorded.cameras, "camera"),
        )
    })
}
