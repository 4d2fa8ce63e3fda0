//! `tdcr collect`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::Serialize;
use tdcr::base::Part;
use tdcr::learn::data::{Design, PayloadRange, Split, split_indices};
use tdcr::pipeline::{CollectSettings, CollectTimes, collect};
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
    /// Number of commands, split 80/10/10 into train, val and test
    #[arg(long, default_value_t = CollectSettings::default().count, value_name = "N", value_parser = super::amount)]
    samples: usize,
    /// Points per cloud
    #[arg(long, default_value_t = CollectSettings::default().points, value_name = "N", value_parser = super::amount)]
    points: usize,
    /// Edge of the voxels that thin the fused clouds (m)
    #[arg(long, default_value_t = CollectSettings::default().voxel_size, value_name = "M", value_parser = super::positive, allow_hyphen_values = true)]
    voxel: f64,
    /// Show the robot's base to the cameras
    #[arg(long)]
    base: bool,
    /// Hang payloads from the tip (kg): a tenth exactly 0, the others uniform from MIN to MAX
    #[arg(long, value_name = "MIN:MAX", value_parser = payload_range, allow_hyphen_values = true)]
    payload: Option<PayloadRange>,
    /// Simulate the noise of a real depth camera
    #[arg(long, value_enum)]
    noise: Option<super::Noise>,
    /// How commands and payloads are chosen
    #[arg(long, default_value = CollectSettings::default().design.name(), value_parser = design())]
    design: Design,
    /// Seed of commands, samples, faults and splits
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Collect part I of N of the samples, in a folder of its own; tdcr data merge makes a data set of all parts
    #[arg(long, value_name = "I/N")]
    part: Option<Part>,
    /// Folder of the data set, or of the part
    #[arg(long, default_value = "data", value_name = "DIR")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Collected {
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
}

pub(super) fn run(args: &CollectArgs, console: &Console) -> anyhow::Result<()> {
    super::output::folder("--out", &args.out, "a folder for the data set")?;
    let splits = split_indices(args.samples, args.seed)?;
    let settings = CollectSettings {
        robot: args.robot.load()?,
        base: super::visibility(args.base),
        payload: args.payload,
        design: args.design,
        count: args.samples,
        points: args.points,
        voxel_size: args.voxel,
        sensor: args.noise.map(super::Noise::sensor),
        seed: args.seed,
        part: args.part,
    };
    let began = Instant::now();
    let times = collect(&settings, &args.out, console)?;
    let CollectTimes {
        settle,
        see,
        sample,
        write,
        shards,
    } = times;
    let rest = match args.part {
        None => format!("; then shards in {shards:.1} s"),
        Some(_) => String::new(),
    };
    tracing::info!(
        "over all threads: settle {settle:.1} s, see {see:.1} s, sample {sample:.1} s, write {write:.1} s{rest}"
    );
    if let Some(part) = args.part {
        let collected = CollectedPart {
            dir: args.out.clone(),
            robot: settings.robot.name,
            part,
            samples: part.range(args.samples).len(),
            points: args.points,
            seconds: began.elapsed().as_secs_f64(),
            times,
        };
        return console.summary(&collected, |c| {
            format!(
                "{}: {}, {} of {} points of robot {}",
                c.dir.display(),
                c.part,
                counted(c.samples, "cloud"),
                c.points,
                c.robot
            )
        });
    }
    let collected = Collected {
        dir: args.out.clone(),
        robot: settings.robot.name,
        train: splits.of(Split::Train).len(),
        val: splits.of(Split::Val).len(),
        test: splits.of(Split::Test).len(),
        points: args.points,
        seconds: began.elapsed().as_secs_f64(),
        times,
    };
    console.summary(&collected, |c| {
        format!(
            "{}: {} train, {} val and {} test clouds of {} points of robot {}",
            c.dir.display(),
            c.train,
            c.val,
            c.test,
            c.points,
            c.robot
        )
    })
}

/// Parses the ends of a payload range (kg). The data set checks that they make a range.
pub(super) fn payload_range(text: &str) -> Result<PayloadRange, String> {
    let ends = text.split_once(':');
    let ends = ends.and_then(|(min, max)| Some((min.parse().ok()?, max.parse().ok()?)));
    let (min, max) = ends.ok_or("expected MIN:MAX, two masses in kg")?;
    Ok(PayloadRange { min, max })
}

/// Parses the name of a design.
fn design() -> impl TypedValueParser<Value = Design> {
    PossibleValuesParser::new(Design::ALL.map(Design::name)).map(|name| {
        let design = Design::ALL.into_iter().find(|design| design.name() == name);
        design.expect("one of the possible values")
    })
}
