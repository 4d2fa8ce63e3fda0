//! `tdcr collect`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;
use tdcr::base::Part;
use tdcr::learn::data::{Split, split_indices};
use tdcr::pipeline::{CollectSettings, CollectTimes, Collected, PoseCounts, collect};
use tdcr::report::counted;

use super::console::Console;

/// Make a data set: settle random commands, see each with the camera ring, keep the clouds
///
/// Interrupted, the same command goes on where it stopped; with more --samples it adds to the set, whose splits are then
/// drawn anew. To collect on several machines, give each a --part, and put the parts together with tdcr data merge.
#[derive(Debug, Args)]
pub(super) struct CollectArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    #[command(flatten)]
    scene: super::scene::SceneArgs,
    #[command(flatten)]
    settings: CollectSettings,
    /// Folder of the data set, or of the part
    #[arg(long, default_value = "data", value_name = "DIR")]
    out: PathBuf,
}

#[derive(Serialize)]
struct CollectedSet {
    dir: PathBuf,
    robot: String,
    train: usize,
    val: usize,
    test: usize,
    points: usize,
    /// Wall clock of this run (s).
    seconds: f64,
    /// Where the time of this run went (s).
    times: CollectTimes,
    /// How many poses are in contact or where a real robot may not be.
    poses: PoseCounts,
}

#[derive(Serialize)]
struct CollectedPart {
    dir: PathBuf,
    robot: String,
    part: Part,
    /// Samples of the part.
    samples: usize,
    points: usize,
    /// Wall clock of this run (s).
    seconds: f64,
    /// Where the time of this run went (s).
    times: CollectTimes,
    /// How many poses are in contact or where a real robot may not be.
    poses: PoseCounts,
}

pub(super) fn run(args: &CollectArgs, console: &Console) -> anyhow::Result<()> {
    super::output::folder("--out", &args.out, "a folder for the data set")?;
    let settings = &args.settings;
    let splits = split_indices(settings.samples, settings.seed)?;
    let robot = args.robot.load()?;
    let began = Instant::now();
    let scene = args.scene.load()?;
    let Collected { times, poses } = collect(&robot, &scene, settings, &args.out, console)?;
    let CollectTimes {
        settle,
        see,
        sample,
        write,
        shards,
    } = times;
    let rest = match settings.part {
        None => format!("; then shards in {shards:.1} s"),
        Some(_) => String::new(),
    };
    tracing::info!(
        "over all threads: settle {settle:.1} s, see {see:.1} s, sample {sample:.1} s, write {write:.1} s{rest}"
    );
    if let Some(part) = settings.part {
        let collected = CollectedPart {
            dir: args.out.clone(),
            robot: robot.name,
            part,
            samples: part.range(settings.samples).len(),
            points: settings.points,
            seconds: began.elapsed().as_secs_f64(),
            times,
            poses,
        };
        return console.summary(&collected, |c| {
            format!(
                "{}: {}, {} of {} points of robot {}{}",
                c.dir.display(),
                c.part,
                counted(c.samples, "cloud"),
                c.points,
                c.robot,
                and_poses(&c.poses, c.samples)
            )
        });
    }
    let collected = CollectedSet {
        dir: args.out.clone(),
        robot: robot.name,
        train: splits.of(Split::Train).len(),
        val: splits.of(Split::Val).len(),
        test: splits.of(Split::Test).len(),
        points: settings.points,
        seconds: began.elapsed().as_secs_f64(),
        times,
        poses,
    };
    console.summary(&collected, |c| {
        format!(
            "{}: {} train, {} val and {} test clouds of {} points of robot {}{}",
            c.dir.display(),
            c.train,
            c.val,
            c.test,
            c.points,
            c.robot,
            and_poses(&c.poses, c.train + c.val + c.test)
        )
    })
}

/// What is to be said of the poses of so many samples, as the end of a sentence.
fn and_poses(poses: &PoseCounts, samples: usize) -> String {
    (poses.phrase(samples)).map_or_else(String::new, |phrase| format!("; {phrase}"))
}
