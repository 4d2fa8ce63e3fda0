//! `tdcr data merge`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;
use tdcr::learn::data::{Split, split_indices};
use tdcr::pipeline::merge;
use tdcr::report::counted;

use super::Console;
use crate::cli::output;

/// Make a data set of the parts that tdcr collect --part I/N made
///
/// Its files are byte for byte those that tdcr collect makes without --part. The parts stay as they are. Interrupted, the same
/// command begins anew.
#[derive(Debug, Args)]
pub(in crate::cli) struct MergeArgs {
    /// Folders of all parts, in any order
    #[arg(required = true, value_name = "PART")]
    parts: Vec<PathBuf>,
    /// Folder of the data set
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Merged {
    dir: PathBuf,
    /// Name of the robot.
    robot: Option<String>,
    /// Number of parts.
    parts: usize,
    train: usize,
    val: usize,
    test: usize,
    points: usize,
    /// Wall clock of this run (s).
    seconds: f64,
}

pub(super) fn run(args: &MergeArgs, console: &Console) -> anyhow::Result<()> {
    output::folder("--out", &args.out, "a folder for the data set")?;
    let began = Instant::now();
    let meta = merge(&args.parts, &args.out, console)?;
    let splits = split_indices(meta.count, meta.seed)?;
    let merged = Merged {
        dir: args.out.clone(),
        robot: meta.subject().map(|subject| subject.robot.name),
        parts: args.parts.len(),
        train: splits.of(Split::Train).len(),
        val: splits.of(Split::Val).len(),
        test: splits.of(Split::Test).len(),
        points: meta.points_per_cloud,
        seconds: began.elapsed().as_secs_f64(),
    };
    console.summary(&merged, |m| {
        format!(
            "{}: {} train, {} val and {} test clouds of {} points, of {}",
            m.dir.display(),
            m.train,
            m.val,
            m.test,
            m.points,
            counted(m.parts, "part")
        )
    })
}
