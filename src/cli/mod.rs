//! Commands, and how they report: results on stdout, everything else on stderr.

mod background;
mod base;
mod calibrate;
mod calibrate_cameras;
mod camera_overlaps;
mod capture;
mod collect;
mod commands;
mod compare;
mod completions;
mod console;
mod data;
mod demo;
mod deploy;
mod distill;
mod eval;
mod export;
mod faults;
mod film;
mod help;
mod hint;
mod home;
mod images;
mod jog;
mod jog_tip;
mod jogged;
#[cfg(any(test, feature = "joystick"))]
mod joystick;
mod keys;
mod loads;
mod loads_file;
mod log;
mod manual;
mod new;
mod output;
mod person;
mod picture;
mod plan;
mod predict;
mod pretension;
mod printable;
mod reach;
mod reach_cloud;
mod reach_contact;
mod reach_found;
mod render;
mod scan;
mod scene;
mod servo_sim;
mod settle;
mod settle_contacts;
mod settle_many;
mod settle_path;
mod settle_table;
mod signals;
mod simulate;
mod study;
mod terminal;
mod track;
mod track_path;
mod train;
mod units;
mod view;

use std::ffi::OsString;
use std::num::NonZero;
use std::path::Path;

use anyhow::{Context, bail, ensure};
use clap::builder::TypedValueParser;
use clap::{Args, Parser, Subcommand};
use tdcr::hw::capture::CaptureError;
use tdcr::hw::rig::{RigError, RigFile};
use tdcr::learn::data::Subject;
use tdcr::learn::net::Precision;
use tdcr::learn::options;
use tdcr::learn::options::cli::{amount, named, positive};
use tdcr::learn::symmetry::SymmetryUse;
use tdcr::learn::train::Model;
use tdcr::pages::PageError;
use tdcr::pipeline::PipelineError;
use tdcr::report::counted;
use tdcr::sim::formats::Note;
use tdcr::sim::robot::{self, Robot, RobotSpec};
use tdcr::study::StudyError;
use tracing_subscriber::filter::LevelFilter;

use console::{Console, Interrupted, Terminal, say};
use printable::printable;

/// Tendon-driven continuum robots: simulate, see, learn, predict, evaluate.
#[derive(Debug, Parser)]
#[command(name = "tdcr", version, long_version = env!("TDCR_VERSION_LINE"), propagate_version = true)]
struct Cli {
    #[command(flatten)]
    global: Global,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Args)]
struct Global {
    /// Print the result as JSON on stdout
    #[arg(long, global = true)]
    json: bool,
    /// Threads to use [default: all processors]
    #[arg(long, global = true, value_name = "N", value_parser = threads)]
    threads: Option<usize>,
    /// Say nothing but errors, and a result that goes nowhere else: a command that writes files says nothing
    #[arg(long, short, global = true)]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    Settle(settle::SettleArgs),
    Reach(reach::ReachArgs),
    Plan(plan::PlanArgs),
    Deploy(deploy::DeployArgs),
    Simulate(simulate::SimulateArgs),
    Track(Box<track::TrackArgs>),
    Study(study::StudyArgs),
    Collect(collect::CollectArgs),
    Data(data::DataArgs),
    Train(Box<train::TrainArgs>),
    Distill(distill::DistillArgs),
    Predict(predict::PredictArgs),
    Eval(eval::EvalArgs),
    Compare(compare::CompareArgs),
    Demo(demo::DemoArgs),
    New(new::NewArgs),
    Export(export::ExportArgs),
    Render(render::RenderArgs),
    View(view::ViewArgs),
    Calibrate(Box<calibrate::CalibrateArgs>),
    CalibrateCameras(calibrate_cameras::CalibrateCamerasArgs),
    ServoSim(servo_sim::ServoSimArgs),
    Scan(scan::ScanArgs),
    Home(home::HomeArgs),
    Pretension(pretension::PretensionArgs),
    Background(background::BackgroundArgs),
    Jog(jog::JogArgs),
    Capture(capture::CaptureArgs),
    Log(log::LogArgs),
    Completions(completions::CompletionsArgs),
    Manual(manual::ManualArgs),
}

/// Which robot.
#[derive(Debug, Args)]
struct RobotArg {
    /// 2m, 3m, 5m, or the path of a robot file (.toml, .json, .xml for MuJoCo's MJCF, or .urdf)
    #[arg(long = "robot", default_value = Subject::ROBOT, value_name = "ROBOT")]
    name_or_path: String,
}

impl RobotArg {
    fn load(&self) -> anyhow::Result<RobotSpec> {
        load_robot(&self.name_or_path)
    }
}

/// Command of the tendons.
#[derive(Debug, Args)]
struct CommandArg {
    /// Command of every tendon (m, or N for a tension drive), separated by commas; none for a robot without tendons
    #[arg(
        long = "command",
        value_parser = numbers,
        allow_hyphen_values = true,
        value_name = "C,C,..."
    )]
    lengths: Option<Box<[f64]>>,
}

/// The command of a robot by `--command`, which a robot without tendons does without; `others` are the options that may stand in its
/// place.
fn command_of(
    given: Option<&[f64]>,
    robot: &Robot,
    others: &str,
) -> anyhow::Result<robot::Command> {
    let tendons = robot.tendons().len();
    if given.is_none() && tendons > 0 {
        let name = &robot.spec().name;
        let tendons = counted(tendons, "tendon");
        bail!(
            "robot `{name}` has {tendons}; expected --command C,C,... with a value for each{others}"
        );
    }
    Ok(robot.command(given.unwrap_or_default())?)
}

/// Operand type of a network's matrix products.
#[derive(Debug, Args)]
struct PrecisionArgs {
    #[arg(long, value_parser = precision(), help = options::cli::help("precision"))]
    precision: Option<Precision>,
}

impl PrecisionArgs {
    /// For a network whose layers on points have `width` features.
    fn of_width(&self, width: usize) -> Precision {
        self.precision.unwrap_or(Precision::fastest(width))
    }
}

/// Parses the name of a precision.
fn precision() -> impl TypedValueParser<Value = Precision> {
    named(Precision::ALL, Precision::name)
}

/// Exit status after an interruption, as shells report SIGINT.
const INTERRUPTED: u8 = 130;

/// Runs the command line with arguments, of which the first is the program; the exit status is 0, 1 after an error, 130 when
/// interrupted. Wrong usage ends the process with 2, a second interruption with 130.
pub fn run(arguments: Vec<OsString>) -> u8 {
    let cli = help::parse(&arguments);
    match execute(&cli, &arguments) {
        Ok(()) => 0,
        Err(error) if console::is_broken_pipe(&error) => 0,
        Err(error) => {
            say(&format!("error: {}", with_hint(&error)));
            match is_interruption(&error) {
                true => INTERRUPTED,
                false => 1,
            }
        }
    }
}

/// Whether the work was stopped by a signal.
fn is_interruption(error: &anyhow::Error) -> bool {
    let stage = match error.downcast_ref() {
        Some(PageError::Stage(stage)) => Some(stage),
        _ => error.downcast_ref(),
    };
    let stopped = stage.is_some_and(PipelineError::is_interruption);
    let study = matches!(error.downcast_ref(), Some(StudyError::Interrupted));
    let rig = match error.downcast_ref() {
        Some(CaptureError::Rig(rig)) => Some(rig),
        _ => error.downcast_ref(),
    };
    let released = matches!(rig, Some(RigError::Interrupted));
    stopped || study || released || error.is::<Interrupted>()
}

/// An error as it is said, with what to do about it.
fn with_hint(error: &anyhow::Error) -> String {
    let text = describe(error);
    match hint::hint(error) {
        // Below a list, not behind its last line.
        Some(hint) if text.contains('\n') => format!("{text}\n{hint}"),
        Some(hint) => format!("{text}; {hint}"),
        None => text,
    }
}

/// An error and its causes, each said once: a message may quote its cause already.
fn describe(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    text
}

fn execute(cli: &Cli, arguments: &[OsString]) -> anyhow::Result<()> {
    let level = if cli.global.quiet {
        LevelFilter::ERROR
    } else {
        LevelFilter::INFO
    };
    tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_ansi(Terminal::stderr().colors)
        // Else a log that cannot be written is reported where it cannot be written, which panics.
        .log_internal_errors(false)
        .with_target(false)
        .without_time()
        .init();
    if let Some(threads) = cli.global.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("cannot start the threads")?;
    }
    if cli.global.json {
        refuse_unwritable_names(arguments)?;
    }
    let console = Console::new(&cli.global)?;
    match &cli.command {
        Command::Settle(args) => settle::run(args, &console),
        Command::Reach(args) => reach::run(args, &console),
        Command::Plan(args) => plan::run(args, &console),
        Command::Deploy(args) => deploy::run(args, &console),
        Command::Simulate(args) => simulate::run(args, &console),
        Command::Track(args) => track::run(args, &console),
        Command::Study(args) => study::run(args, &console),
        Command::Collect(args) => collect::run(args, &console),
        Command::Data(args) => data::run(args, &console),
        Command::Train(args) => train::run(args, &console),
        Command::Distill(args) => distill::run(args, &console),
        Command::Predict(args) => predict::run(args, &console),
        Command::Eval(args) => eval::run(args, &console),
        Command::Compare(args) => compare::run(args, &console),
        Command::Demo(args) => demo::run(args, &console),
        Command::New(args) => new::run(args, &console),
        Command::Export(args) => export::run(args, &console),
        Command::Render(args) => render::run(args, &console),
        Command::View(args) => view::run(args, &console),
        Command::Calibrate(args) => calibrate::run(args, &console),
        Command::CalibrateCameras(args) => calibrate_cameras::run(args, &console),
        Command::ServoSim(args) => servo_sim::run(args, &console),
        Command::Scan(args) => scan::run(args, &console),
        Command::Home(args) => home::run(args, &console),
        Command::Pretension(args) => pretension::run(args, &console),
        Command::Background(args) => background::run(args, &console),
        Command::Jog(args) => jog::run(args, &console),
        Command::Capture(args) => capture::run(args, &console),
        Command::Log(args) => log::run(args, &console),
        Command::Completions(args) => completions::run(args, &console),
        Command::Manual(args) => manual::run(args, &console),
    }
}

/// Refuses names that are not Unicode, which JSON cannot hold; called before the work, so that no result is lost.
fn refuse_unwritable_names(arguments: &[OsString]) -> anyhow::Result<()> {
    for argument in arguments {
        ensure!(
            argument.to_str().is_some(),
            "--json cannot say the name {}, which is not UTF-8; rename it, or leave out --json",
            argument.display()
        );
    }
    Ok(())
}

/// Loads a robot by name or file; warns of what was ignored in a file of another tool.
fn load_robot(name_or_path: &str) -> anyhow::Result<RobotSpec> {
    let (spec, notes) = RobotSpec::load_with_notes(name_or_path)?;
    warn_of(&notes);
    Ok(spec)
}

/// Loads a rig's file; warns of what was ignored in that of its robot.
fn load_rig(path: &Path) -> anyhow::Result<RigFile> {
    let file = RigFile::load(path)?;
    warn_of(&file.notes);
    Ok(file)
}

/// Warns of what a robot here has otherwise than in the file of another tool.
fn warn_of(notes: &[Note]) {
    for note in notes {
        tracing::warn!("{}", printable(&note.to_string()));
    }
}

/// A trained model from its file.
fn load_model(file: &Path) -> anyhow::Result<Model> {
    ensure!(
        file.exists(),
        "there is no model {}; `tdcr train --out DIR` makes DIR/model.safetensors",
        file.display()
    );
    Ok(Model::load(file)?)
}

/// Largest number of threads per processor: more would only wait, and each needs its own memory.
const THREADS_PER_PROCESSOR: usize = 4;

/// Number of threads that every machine accepts, so that a command line works on another machine.
const FEW_THREADS: usize = 32;

/// Parses a number of threads.
fn threads(text: &str) -> Result<usize, String> {
    let processors = std::thread::available_parallelism().map_or(1, NonZero::get);
    let most = (THREADS_PER_PROCESSOR * processors).max(FEW_THREADS);
    match text.parse() {
        Ok(number) if (1..=most).contains(&number) => Ok(number),
        _ => Err(format!(
            "expected a whole number, 1 to {most}; this machine runs {processors} threads at once"
        )),
    }
}

/// Parses numbers separated by commas. An empty text has none, as the command of a robot without tendons.
fn numbers(text: &str) -> Result<Box<[f64]>, String> {
    if text.is_empty() {
        return Ok(Box::default());
    }
    let number = |text: &str| {
        let text = text.trim();
        (text.parse()).map_err(|_| format!("`{text}` is not a number"))
    };
    text.split(',').map(number).collect()
}

/// Parses whether symmetries are used.
fn symmetry_use() -> impl TypedValueParser<Value = SymmetryUse> {
    named(SymmetryUse::ALL, SymmetryUse::name)
}
