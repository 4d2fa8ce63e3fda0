//! `tdcr capture`.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use tdcr::hw::capture::Program;
use tdcr::hw::plan::{Place, PlanError};
use tdcr::hw::rig::{Pace, Rig, RigFile};
use tdcr::learn::data::split_indices;
use tdcr::pipeline::{CaptureReport, CaptureSettings, Monitor, capture};
use tdcr::report::counted;

use super::commands::read_commands;
use super::console::{Console, Interrupted};
use super::faults::FaultArgs;

/// Samples from which on the shares of the splits are 80/10/10.
const FEW: usize = 10;

/// Make a data set with a rig: move the robot, see it with the rig's cameras, keep the clouds
///
/// The robot has to be homed (tdcr home). Commands are drawn so that no tendon goes slack and none is overloaded, or are those of
/// --commands-file. Interrupted,
/// the tension is released, and the same command goes on where it stopped; with more --commands it adds to the set.
/// Besides the clouds, DIR/capture.jsonl holds what the servos did.
#[derive(Debug, Args)]
pub(super) struct CaptureArgs {
    /// File of the rig
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    #[command(flatten)]
    settings: CaptureSettings,
    /// Capture the commands of a file in its order, in place of random ones: one per line (CSV; or JSON, a list of lists), one
    /// number per tendon (m), as tdcr settle --commands reads them. All are checked before anything moves
    #[arg(long, value_name = "FILE", conflicts_with = "commands")]
    commands_file: Option<PathBuf>,
    #[command(flatten)]
    faults: FaultArgs,
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

/// A sample of a capture that is only told.
#[derive(Serialize)]
struct Move {
    index: usize,
    /// kg.
    #[serde(skip_serializing_if = "Option::is_none")]
    payload: Option<f64>,
    /// m.
    command: Vec<f64>,
    /// Positions of the servos, from home.
    ticks: Vec<i32>,
    /// Goals on the way.
    steps: usize,
}

/// What a capture would do in all.
#[derive(Serialize)]
struct Rehearsal {
    /// Time in motion, without waiting and seeing (s).
    moving_seconds: f64,
    /// Smallest and largest position of each servo (ticks from home).
    ranges: Vec<[i32; 2]>,
}

pub(super) fn run(args: &CaptureArgs, console: &Console) -> anyhow::Result<()> {
    super::output::folder("--out", &args.out, "a folder for the data set")?;
    let file = super::load_rig(&args.rig)?;
    let mut settings = args.settings.clone();
    settings.check_payloads()?;
    if let Some(commands) = &args.commands_file {
        settings.given = Some(given(commands, &file, &settings, console)?);
    }
    let settings = &settings;
    // Refuses more samples than a data set may have, before they are counted up.
    split_indices(settings.samples(), settings.seed)?;
    if args.dry_run {
        return rehearse(&file, settings, console);
    }
    tell_of_few(settings)?;
    let mut rig = Rig::open_file(file, Pace::Computed)?;
    args.faults.schedule(&rig)?;
    let report = capture(&mut rig, settings, &args.out, console)?;
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
            repeatability,
            rig_seconds,
            ..
        } = summary.report;
        let repeats = repeatability.map_or(String::new(), |spread| {
            format!(
                "\nrepeats of a command: centres of their clouds {:.2} mm (RMS) from their mean",
                1e3 * spread
            )
        });
        format!(
            "{}: {} on rig {}, {captured} of them now, in {rig_seconds:.0} s of the rig; {moving} while something still moved\n\
             drift at home: {:.2} mm at the most, in {}{repeats}",
            summary.dir.display(),
            counted(samples, "cloud"),
            summary.rig,
            1e3 * drift,
            counted(sentinels, "look"),
        )
    })
}

/// The commands of a file, each once it is known that the rig can take it: what is refused is told with its line and column.
fn given(
    commands: &Path,
    file: &RigFile,
    settings: &CaptureSettings,
    console: &Console,
) -> anyhow::Result<Vec<Vec<f64>>> {
    let programs = (0..settings.parts()).map(|part| settings.program(file, part));
    let programs = RefCell::new(programs.collect::<Result<Vec<Program>, _>>()?);
    read_commands(commands, |row| {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        let values = row.unloaded()?;
        for (part, program) in programs.borrow_mut().iter_mut().enumerate() {
            let taken = program.given(&values);
            taken.map_err(|error| refused(error, settings.payload_in(part)))?;
        }
        Ok(values)
    })
}

/// Why a command of a file cannot be taken under a payload (kg).
fn refused(error: PlanError, payload: Option<f64>) -> anyhow::Error {
    let column = match error {
        PlanError::Limit { tendon, .. } | PlanError::Tension { tendon, .. } => Some(tendon),
        _ => None,
    };
    let mut refused = anyhow::Error::new(error);
    if let Some(mass) = payload {
        refused = refused.context(format!("under {mass} kg"));
    }
    match column {
        Some(tendon) => refused.context(format!("column c{tendon}")),
        None => refused,
    }
}

/// Warns where samples are too few for the shares of the splits.
fn tell_of_few(settings: &CaptureSettings) -> anyhow::Result<()> {
    let (samples, commands) = (settings.samples(), settings.distinct());
    let splits = split_indices(commands, settings.seed)?.repeated(samples, commands);
    if splits.val.is_empty() || splits.test.is_empty() || commands < FEW {
        let more = match settings.cycle() {
            None => ", and the same command with more adds to the set",
            Some(_) => "",
        };
        tracing::warn!(
            "{}: {} train, {} val, {} test; {FEW} or more commands are split 80/10/10{more}",
            counted(samples, "sample"),
            splits.train.len(),
            splits.val.len(),
            splits.test.len()
        );
    }
    Ok(())
}

/// Tells what would move, command by command, in memory that does not grow with their number.
fn rehearse(file: &RigFile, settings: &CaptureSettings, console: &Console) -> anyhow::Result<()> {
    let mut part = 0;
    let mut program = settings.program(file, part)?;
    let samples = settings.samples();
    settings.mask_folder(file.spec.cameras.len(), 0..samples)?;
    let mut at = Place::from(program.rest());
    let mut ranges = vec![[0, 0]; file.spec.servos.ids.len()];
    let mut steps = 0;
    console.begin("dry run", samples as u64, 0);
    console.part(&head(&file.spec.name, console)?)?;
    for index in 0..samples {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        if settings.part_of(index) != part {
            // In a session of its own, which begins at home.
            part = settings.part_of(index);
            program = settings.program(file, part)?;
            at = Place::from(program.rest());
        }
        let place = settings.place(index, &mut program)?;
        let command = program.command_at(&place)?;
        let path = program.path(at, place.clone())?;
        let ticks: Vec<i32> = program.goals(&command)?.iter().map(|goal| goal.0).collect();
        for ([low, high], &ticks) in ranges.iter_mut().zip(&ticks) {
            (*low, *high) = ((*low).min(ticks), (*high).max(ticks));
        }
        steps += path.len();
        let told = Move {
            index,
            payload: settings.payload_in(part),
            command: command.as_slice().to_vec(),
            ticks,
            steps: path.len(),
        };
        console.part(&told.text(console)?)?;
        at = place;
        console.advance(1);
        if (index + 1) % (samples / 10).max(100) == 0 {
            console.note(&format!(
                "{} s of motion",
                (steps as f64 * file.spec.motion.period).round()
            ));
        }
    }
    console.end();
    let rehearsal = Rehearsal {
        moving_seconds: steps as f64 * file.spec.motion.period,
        ranges,
    };
    console.part(&rehearsal.text(&file.spec.name, console)?)
}

/// What stands before the first command.
fn head(rig: &str, console: &Console) -> anyhow::Result<String> {
    Ok(match console.is_json() {
        true => format!(
            "{{\n  \"rig\": {},\n  \"moves\": [",
            serde_json::to_string(rig)?
        ),
        false => "command  steps  positions (ticks from home)\n".to_owned(),
    })
}

impl Move {
    fn text(&self, console: &Console) -> anyhow::Result<String> {
        let Self {
            index,
            ticks,
            steps,
            payload,
            ..
        } = self;
        if console.is_json() {
            let comma = if *index > 0 { "," } else { "" };
            return Ok(format!("{comma}\n    {}", serde_json::to_string(self)?));
        }
        let ticks: Vec<String> = ticks.iter().map(|ticks| format!("{ticks:>6}")).collect();
        let payload = payload.map_or(String::new(), |mass| format!("  {mass} kg"));
        Ok(format!(
            "{index:>7}  {steps:>5}  {}{payload}\n",
            ticks.join(" ")
        ))
    }
}

impl Rehearsal {
    fn text(&self, rig: &str, console: &Console) -> anyhow::Result<String> {
        let Self {
            moving_seconds,
            ranges,
        } = self;
        if console.is_json() {
            let ranges = serde_json::to_string(ranges)?;
            return Ok(format!(
                "\n  ],\n  \"moving_seconds\": {},\n  \"ranges\": {ranges}\n}}\n",
                serde_json::to_string(moving_seconds)?
            ));
        }
        let ranges: Vec<String> = ranges.iter().map(|[a, b]| format!("{a} to {b}")).collect();
        Ok(format!(
            "{rig} would move for {moving_seconds:.0} s, its servos from {} ticks; nothing has moved\n",
            ranges.join(", ")
        ))
    }
}
