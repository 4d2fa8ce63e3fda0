//! `tdcr track`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use tdcr::control::tip_path::TipPath;
use tdcr::hw::rig::{LOG_LEAVES, Pace, Rig};
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::robot::{Robot, RobotSpec};
use tdcr::sim::scene::Scene;
use tdcr::track::{
    ControllerName, Model, TrackError, TrackOptions, TrackSummary, Tracked, TruthOptions,
    closed_path, curve_named, headline, page, path_of_rows, table, track_rig, track_simulated,
    write_log,
};

use super::console::{Console, Interrupted};
use super::faults::FaultArgs;
use super::loads::vector;
use super::output;
use super::scene::SceneArgs;
use super::track_path::read_path;

/// Lead the tip along a path by a controller, on a simulated robot that differs from the controller's model
///
/// Beside it the same robot is driven in open loop. The folder gets run.csv (a line for each period: target, tip, commands, tensions,
/// estimates) and open-loop.csv.
#[derive(Debug, Args)]
pub(super) struct TrackArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    /// The simulated robot: 2m, 3m, 5m, or a robot file [default: --robot]
    #[arg(long, value_name = "ROBOT")]
    truth: Option<String>,
    /// File of a rig in place of a simulated robot: the robot is the rig's, and its cameras' clouds are what is measured. Its own [scene]
    /// is what the controller's model has, unless --scene is given
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = [
            "name_or_path", "truth", "friction", "backlash", "gain_error", "delay", "noise", "tension_noise", "timestep",
            "truth_scene",
        ]
    )]
    rig: Option<PathBuf>,
    #[command(flatten)]
    faults: FaultArgs,
    /// circle, eight, square, lissajous, or a CSV file of columns t, x, y, z (s, m)
    #[arg(long, value_name = "PATH")]
    path: String,
    /// Width of a curve that is named (m)
    #[arg(long, default_value_t = 0.06, value_name = "M", value_parser = super::positive)]
    diameter: f64,
    /// Time in which a curve that is named is run through (s)
    #[arg(long, default_value_t = 20.0, value_name = "S", value_parser = super::positive)]
    duration: f64,
    /// Centre of a curve that is named, world frame (m) [default: below the tip of the straight robot]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    centre: Option<[f64; 3]>,
    #[command(flatten)]
    options: TrackOptions,
    #[command(flatten)]
    different: TruthOptions,
    #[command(flatten)]
    scene: SceneArgs,
    /// Obstacles around the simulated robot in place of those of --scene, which the controller's model has
    #[arg(long, value_name = "FILE")]
    truth_scene: Option<PathBuf>,
    /// Folder of the run's tables
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write no log of a rig. Else DIR/log.mcap has all that servos and cameras did, log-2.mcap the next time
    #[arg(long)]
    no_log: bool,
    /// Write an HTML page: error, path, commands, tensions, estimated payload
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

impl TrackArgs {
    fn path(&self, robot: &Robot) -> anyhow::Result<TipPath> {
        if let Some(shape) = curve_named(&self.path) {
            let path = closed_path(robot, shape, self.centre, self.diameter, self.duration);
            return Ok(path?);
        }
        let file = Path::new(&self.path);
        if !file.exists() {
            bail!(
                "--path {} is neither a file nor a curve; expected circle, eight, square, lissajous, or a CSV file of columns t, x, y, z",
                self.path
            );
        }
        path_of_rows(&read_path(file)?).with_context(|| format!("{} is no path", file.display()))
    }
}

pub(super) fn run(args: &TrackArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(out) = &args.out {
        output::folder("--out", out, "a folder for the run's tables")?;
    }
    if let Some(report) = &args.report {
        output::format("--report", report, &["html"])?;
    }
    if args.rig.is_none() {
        args.faults.refuse("--rig")?;
    }
    let (robot, tracked) = match &args.rig {
        Some(rig) => on_rig(args, rig, console)?,
        None => simulated(args, console)?,
    };
    if let Some(out) = &args.out {
        fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
        output::write(&out.join("run.csv"), table(&robot, &tracked.run))?;
        write_log(&out.join("run.mcap"), &tracked.run)?;
        if let Some(open_loop) = &tracked.open_loop {
            output::write(&out.join("open-loop.csv"), table(&robot, open_loop))?;
        }
    }
    if console.interrupted() {
        return Err(Interrupted.into());
    }
    let summary = TrackSummary::new(&robot, &tracked);
    if let Some(report) = &args.report {
        output::write(report, page(&robot, &tracked, settings(args)).to_html())?;
    }
    console.result(&summary, text)
}

fn simulated(args: &TrackArgs, console: &Console) -> anyhow::Result<(Robot, Tracked)> {
    let robot = Robot::new(args.robot.load()?)?;
    let truth: RobotSpec = match &args.truth {
        Some(name) => super::load_robot(name)?,
        None => robot.spec().clone(),
    };
    if truth.tendon_count() != robot.tendons().len() {
        bail!(
            "--truth has {} tendons, and --robot {}; expected as many",
            truth.tendon_count(),
            robot.tendons().len()
        );
    }
    let scene = args.scene.load()?;
    warn_of_moving(args, &scene);
    let around = match &args.truth_scene {
        Some(file) => super::scene::load(file)?,
        None => scene.clone(),
    };
    let truth = args.different.truth(&truth, around, &args.options)?;
    let path = args.path(&robot)?;
    let mut goes_on = |_: &_| !console.interrupted();
    let model = Model {
        robot: &robot,
        scene: &scene,
    };
    let tracked = track_simulated(model, &truth, &path, &args.options, &mut goes_on)?;
    Ok((robot, tracked))
}

/// Warns where the controller's model cannot have the obstacles of `scene`.
fn warn_of_moving(args: &TrackArgs, scene: &Scene) {
    if args.options.controller == ControllerName::MovingMpc && !scene.is_empty() {
        tracing::warn!(
            "the model of moving-mpc has no obstacles: those of the scene are around the robot alone"
        );
    }
}

fn on_rig(args: &TrackArgs, rig: &Path, console: &Console) -> anyhow::Result<(Robot, Tracked)> {
    let file = super::load_rig(rig)?;
    let robot = file.compile()?;
    let (path, scene) = (args.path(&robot)?, args.scene.given()?);
    if let Some(scene) = scene.as_ref().or(file.scene.as_ref()) {
        warn_of_moving(args, scene);
    }
    let mut rig = Rig::open_file(file, Pace::Computed)?;
    args.faults.schedule(&rig)?;
    if let (Some(out), false) = (&args.out, args.no_log) {
        fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
        rig.log_in(out, "log", LOG_LEAVES)?;
    }
    let payload = args.different.payload;
    let goes_on = || !console.interrupted();
    let tracked = track_rig(
        &mut rig,
        scene.as_ref(),
        &path,
        payload,
        &args.options,
        &goes_on,
        &mut |_| {},
    );
    if let Err(error) = rig.finish_log() {
        tracing::warn!("the log is not whole: {error}");
    }
    match tracked {
        Ok(tracked) => Ok((robot, tracked)),
        // As every command that moves a rig says it.
        Err(TrackError::Rig(stopped)) => Err((*stopped).into()),
        Err(error) => Err(error.into()),
    }
}

/// The result in words.
fn text(summary: &TrackSummary) -> String {
    let mut text = headline(summary);
    text.push('\n');
    for incident in &summary.incidents {
        text += &format!("at {:.2} s: {}\n", incident.time, incident.reason);
    }
    let mut estimated = summary.estimated.iter();
    if let Some(payload) = estimated.find(|found| found.name == "payload") {
        let [value, band] = [payload.value, payload.deviation].map(|mass| 1e3 * mass);
        text += &format!("estimated payload {value:.1} g, standard deviation {band:.1} g\n");
    }
    if !summary.unidentified.is_empty() {
        text += &format!(
            "not identified by the measurements: {}\n",
            summary.unidentified.join(", ")
        );
    }
    if summary.late_periods > 0 {
        text += &format!(
            "{} took longer than {} s: the path was followed more slowly there; give a longer --period\n",
            counted(summary.late_periods, "period"),
            summary.period
        );
    }
    text
}

/// What was run, for the page.
fn settings(args: &TrackArgs) -> Vec<(String, String)> {
    let options = &args.options;
    let mut all = vec![("Path", args.path.clone())];
    if let Some(period) = options.period {
        all.push(("Time between commands", format!("{period} s")));
    }
    if options.trials > 1 {
        all.push(("Trials", options.trials.to_string()));
    }
    all.push(("Unknown payload", format!("{} kg", args.different.payload)));
    match &args.rig {
        Some(rig) => all.push(("Rig", rig.display().to_string())),
        None => all.extend(differences(&args.different)),
    }
    all.push(("Seed", options.seed.to_string()));
    all.into_iter()
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}

/// What the simulated robot has otherwise than the model, but for a payload.
fn differences(different: &TruthOptions) -> Vec<(&'static str, String)> {
    let motion = match different.timestep {
        Some(step) => format!("in motion, time steps of at most {step} s"),
        None => "at rest".to_owned(),
    };
    let mut all = vec![
        ("Friction", different.friction.to_string()),
        ("Backlash", different.backlash.to_string()),
        ("Error of spools", different.gain_error.to_string()),
        ("Delay", format!("{} s", different.delay)),
        ("Seen", different.noise.to_string()),
    ];
    if let Some(noise) = different.tension_noise {
        all.push(("Noise of tensions", format!("{noise} N")));
    }
    all.push(("Simulated", motion));
    all
}
