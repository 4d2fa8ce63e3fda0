//! `tdcr capture`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use tdcr::hw::capture::{CaptureError, Program};
use tdcr::hw::rig::{Pace, Rig, RigFile};
use tdcr::learn::data::split_indices;
use tdcr::pipeline::{CaptureLog, CaptureReport, CaptureSettings, capture};
use tdcr::report::counted;

use super::console::Console;

/// Make a data set with a rig: move the robot, see it with the rig's cameras, keep the clouds
///
/// The robot has to be homed (tdcr home). Commands are drawn so that no tendon goes slack and none is overloaded. Interrupted,
/// the tension is released, and the same command goes on where it stopped; with more --commands it adds to the set.
/// Besides the clouds, DIR/capture.jsonl holds what the servos did.
#[derive(Debug, Args)]
pub(super) struct CaptureArgs {
    /// File of the rig
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Number of commands, split 80/10/10 into train, val and test
    #[arg(long, default_value_t = CaptureSettings::default().count, value_name = "N", value_parser = super::amount)]
    commands: usize,
    /// Points per cloud
    #[arg(long, default_value_t = CaptureSettings::default().points, value_name = "N", value_parser = super::amount)]
    points: usize,
    /// Edge of the voxels that thin the fused clouds (m)
    #[arg(long, default_value_t = CaptureSettings::default().voxel_size, value_name = "M", value_parser = super::positive, allow_hyphen_values = true)]
    voxel: f64,
    /// Seed of commands, samples and splits
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Look at the robot in its home pose after so many samples, and say how far it drifts
    #[arg(long, default_value_t = CaptureSettings::default().sentinel_every, value_name = "N", value_parser = super::amount)]
    sentinel_every: usize,
    /// Folder of masks that another program has written, DIR/camera0/000000.png and so on: they make the clouds, in place of
    /// the masks of the rig's file
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    /// Write no log. Else DIR/log.mcap has all that servos and cameras did, log-2.mcap where the capture is resumed
    #[arg(long)]
    no_log: bool,
    /// Print what would move, and touch nothing
    #[arg(long)]
    dry_run: bool,
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Summary<'a> {
    dir: &'a Path,
    rig: &'a str,
    #[serde(flatten)]
    report: CaptureReport,
}

/// What a capture would do.
#[derive(Serialize)]
struct Rehearsal {
    rig: String,
    /// Time in motion, without waiting and seeing (s).
    moving_seconds: f64,
    /// Smallest and largest position of each servo (ticks from home).
    ranges: Vec<[i32; 2]>,
    moves: Vec<Move>,
}

#[derive(Serialize)]
struct Move {
    index: usize,
    /// m.
    command: Vec<f64>,
    /// Positions of the servos, from home.
    ticks: Vec<i32>,
    /// Goals on the way.
    steps: usize,
}

pub(super) fn run(args: &CaptureArgs, console: &Console) -> anyhow::Result<()> {
    super::output::folder("--out", &args.out, "a folder for the data set")?;
    split_indices(args.commands, args.seed)?;
    let file = RigFile::load(&args.rig)?;
    if args.dry_run {
        let rehearsal = rehearse(&file, args)?;
        return console.result(&rehearsal, Rehearsal::text);
    }
    let settings = CaptureSettings {
        count: args.commands,
        points: args.points,
        voxel_size: args.voxel,
        seed: args.seed,
        sentinel_every: args.sentinel_every,
        masks: args.masks.clone(),
        log: match args.no_log {
            true => CaptureLog::Omitted,
            false => CaptureLog::Written,
        },
    };
    let mut rig = Rig::open_file(file, Pace::Computed)?;
    let report = capture(&mut rig, &settings, &args.out, console)?;
    let summary = Summary {
        dir: &args.out,
        rig: &rig.spec().name,
        report,
    };
    console.summary(&summary, |summary| {
        let CaptureReport {
            samples,
            captured,
            moving,
            drift,
            sentinels,
            rig_seconds,
            ..
        } = summary.report;
        format!(
            "{}: {} on rig {}, {captured} of them now, in {rig_seconds:.0} s of the rig; {moving} while something still moved\n\
             drift at home: {:.2} mm at the most, in {}",
            summary.dir.display(),
            counted(samples, "cloud"),
            summary.rig,
            1e3 * drift,
            counted(sentinels, "look"),
        )
    })
}

fn rehearse(file: &RigFile, args: &CaptureArgs) -> Result<Rehearsal, CaptureError> {
    let mut program = Program::new(file, args.seed)?;
    let mut at = program.rest().clone();
    let mut ranges = vec![[0, 0]; file.spec.servos.ids.len()];
    let mut steps = 0;
    let mut moves = Vec::with_capacity(args.commands);
    for index in 0..args.commands {
        let drawn = program.draw(index as u64)?;
        let path = program.path(&at, &drawn.shape)?;
        let ticks: Vec<i32> = program
            .goals(&drawn.command)?
            .iter()
            .map(|goal| goal.0)
            .collect();
        for ([low, high], &ticks) in ranges.iter_mut().zip(&ticks) {
            (*low, *high) = ((*low).min(ticks), (*high).max(ticks));
        }
        steps += path.len();
        moves.push(Move {
            index,
            command: drawn.command.as_slice().to_vec(),
            ticks,
            steps: path.len(),
        });
        at = drawn.shape;
    }
    Ok(Rehearsal {
        rig: file.spec.name.clone(),
        moving_seconds: steps as f64 * file.spec.motion.period,
        ranges,
        moves,
    })
}

impl Rehearsal {
    fn text(&self) -> String {
        let mut text = String::from("command  steps  positions (ticks from home)\n");
        for Move {
            index,
            ticks,
            steps,
            ..
        } in &self.moves
        {
            let ticks: Vec<String> = ticks.iter().map(|ticks| format!("{ticks:>6}")).collect();
            text += &format!("{index:>7}  {steps:>5}  {}\n", ticks.join(" "));
        }
        let ranges: Vec<String> = self
            .ranges
            .iter()
            .map(|[a, b]| format!("{a} to {b}"))
            .collect();
        text + &format!(
            "{} would move for {:.0} s, its servos from {} ticks; nothing has moved",
            self.rig,
            self.moving_seconds,
            ranges.join(", ")
        )
    }
}
