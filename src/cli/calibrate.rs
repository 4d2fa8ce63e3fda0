//! `tdcr calibrate`.

use std::fmt::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::Serialize;
use tdcr::pages::{CalibrationPage, Held};
use tdcr::pipeline::Monitor;
use tdcr::pipeline::recording::{Columns, RecordingFile};
use tdcr::report::counted;
use tdcr::sim::inverse::recording::{
    Correlation, FittedUnknown, Group, Misses, RecordingError, RecordingFit, RecordingSettings,
    Replay, Transmission, fit_recording,
};
use tdcr::sim::robot::RobotSpec;

use super::console::{Console, Interrupted};
use super::output;

/// Calibrate a robot on a recording: what its servos and markers did, in the order of time
///
/// Finds the groups of unknowns of --fit that explain the markers best, and says how far the robot is from the recording before
/// and after, and from another recording that it was not fitted to. The calibrated robot is a robot file; the column map with
/// what was found of servos and markers is written beside it, as NAME.columns.toml. With --fit none, nothing is fitted.
#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// The robot as it was designed: 2m, 3m, 5m, or the path of a robot file
    #[arg(long, value_name = "ROBOT")]
    robot: String,
    /// The recording (CSV with a header)
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// Which column holds what (TOML; docs/sim-to-real.md)
    #[arg(long, value_name = "FILE")]
    columns: PathBuf,
    /// Another recording with the same columns, to hold the calibrated robot against
    #[arg(long, value_name = "FILE")]
    validate: Option<PathBuf>,
    /// Groups of unknowns, separated by commas, or none [default: pretension, spool_radius, backlash, lag, hole_angles, twist, stiffness,
    /// torsion, rest_bend, tendon_stiffness, base_pose, marker_offset, gravity, mass, those of them that the robot has; besides these
    /// hole_radius, tendon_stiffening, friction]
    #[arg(long, value_delimiter = ',', value_name = "GROUP,..", value_parser = choice())]
    fit: Option<Vec<Choice>>,
    /// Distance (m) from which a marker's miss counts less than by its square [default: a fortieth of the robot's length]
    #[arg(long, value_name = "M", value_parser = super::positive)]
    loss: Option<f64>,
    /// Starts of the fit: the robot's own values, then others at random
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    starts: u16,
    /// Seed of the random starts
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Leave out rows that cannot be used; without it, they are named and refused
    #[arg(long)]
    skip_bad_rows: bool,
    /// The robot file to write (.toml)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The page to write (.html): paths, errors, residuals
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// What `--fit` names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Choice {
    Group(Group),
    None,
}

fn choice() -> impl TypedValueParser<Value = Choice> {
    let names = Group::ALL.map(Group::name).into_iter().chain(["none"]);
    PossibleValuesParser::new(names)
        .map(|name| Group::named(&name).map_or(Choice::None, Choice::Group))
}

#[derive(Serialize)]
struct Calibrated {
    tdcr_version: &'static str,
    /// Name of the robot.
    robot: String,
    /// Root mean square distance of the markers from where the robot says, mean offset aligned (m).
    train_rmse: f64,
    validation_rmse: Option<f64>,
    /// The same of the robot as it was given.
    uncalibrated_rmse: f64,
    uncalibrated_validation_rmse: Option<f64>,
    rows: usize,
    validation_rows: Option<usize>,
    /// Lines of rows that were left out.
    bad_lines: Vec<usize>,
    validation_bad_lines: Vec<usize>,
    /// Lines of rows in which the calibrated robot does not settle, which count in no figure.
    unsettled_lines: Vec<usize>,
    validation_unsettled_lines: Vec<usize>,
    /// Half the mean square difference, as a root, of what the calibrated robot misses in rows of nearly the same pulls, at other
    /// times (m): what no model can explain in which the way does not count.
    repeatability: Option<f64>,
    validation_repeatability: Option<f64>,
    /// Neighbouring rows whose errors are alike.
    alike_rows: Option<f64>,
    iterations: usize,
    parameters: Vec<FittedUnknown>,
    /// What the recording can hardly tell apart.
    correlations: Vec<Correlation>,
}

/// A recording, and how far the robot was and is from it.
struct Compared {
    file: RecordingFile,
    before: Misses,
    after: Misses,
    replay: Replay,
}

pub(super) fn run(args: &CalibrateArgs, console: &Console) -> anyhow::Result<()> {
    for (option, file, format) in [
        ("--out", &args.out, "toml"),
        ("--report", &args.report, "html"),
    ] {
        if let Some(file) = file {
            output::format(option, file, &[format])?;
        }
    }
    let robot = super::load_robot(&args.robot)?;
    let columns = Columns::load(&args.columns, &robot)?;
    let load = |path: &Path| -> anyhow::Result<RecordingFile> {
        let file = RecordingFile::load(path, &columns)?;
        file.refuse_bad(path, args.skip_bad_rows)?;
        if !file.bad.is_empty() {
            let lines: Vec<String> = file
                .bad
                .iter()
                .map(|bad| format!("line {}: {}", bad.line, bad.reason))
                .collect();
            tracing::warn!(
                "{}: {} left out; {}",
                path.display(),
                counted(lines.len(), "bad row"),
                lines.join("; ")
            );
        }
        Ok(file)
    };
    let train = load(&args.data)?;
    let validation = args.validate.as_deref().map(load).transpose()?;
    let given = columns.transmission(&robot);
    let fit = fit(args, &robot, &given, &train, console)?;
    let (spec, transmission) = match &fit {
        Some(fit) => (&fit.spec, &fit.transmission),
        None => (&robot, &given),
    };
    let compare = |file: RecordingFile| -> anyhow::Result<Compared> {
        let replay = Replay::new(spec, transmission, &file.recording)?;
        Ok(Compared {
            before: Replay::new(&robot, &given, &file.recording)?.misses(&file.recording),
            after: replay.misses(&file.recording),
            replay,
            file,
        })
    };
    let train = compare(train)?;
    let validation = validation.map(compare).transpose()?;
    let calibrated = calibrated(&robot, fit.as_ref(), &train, validation.as_ref());
    if let Some(out) = &args.out {
        output::write(out, toml::to_string(spec)?)?;
        let map = toml::to_string(&columns.with(transmission))?;
        output::write(&out.with_extension("columns.toml"), map)?;
    }
    if let Some(report) = &args.report {
        output::write(
            report,
            page(&calibrated, &train, validation.as_ref()).to_html(),
        )?;
    }
    console.result(&calibrated, |found| table(found, args.out.as_deref()))
}

/// The fit; none where nothing is to be fitted.
fn fit(
    args: &CalibrateArgs,
    robot: &RobotSpec,
    given: &Transmission,
    train: &RecordingFile,
    console: &Console,
) -> anyhow::Result<Option<RecordingFit>> {
    let mut settings = RecordingSettings {
        loss: args.loss,
        starts: args.starts.into(),
        seed: args.seed,
        ..RecordingSettings::of(robot)
    };
    if let Some(choices) = &args.fit {
        settings.groups = (choices.iter())
            .filter_map(|choice| match choice {
                Choice::Group(group) => Some(*group),
                Choice::None => None,
            })
            .collect();
        ensure!(
            settings.groups.is_empty() || !choices.contains(&Choice::None),
            "--fit none stands alone"
        );
    }
    if settings.groups.is_empty() {
        return Ok(None);
    }
    let mut begun = false;
    let mut done = 0;
    let fit = fit_recording(robot, given, &train.recording, &settings, &mut |progress| {
        if !begun {
            console.begin("calibrate", progress.most as u64, 0);
            begun = true;
        }
        console.advance((progress.done - done) as u64);
        done = progress.done;
        console.status(&format!("misses {:.2} mm", 1e3 * progress.rms));
        match console.interrupted() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    });
    if begun {
        console.end();
    }
    match fit {
        Err(RecordingError::Interrupted) => Err(Interrupted.into()),
        fit => Ok(Some(fit.with_context(|| {
            format!("cannot calibrate on {}", args.data.display())
        })?)),
    }
}

fn calibrated(
    robot: &RobotSpec,
    fit: Option<&RecordingFit>,
    train: &Compared,
    validation: Option<&Compared>,
) -> Calibrated {
    let bad = |compared: &Compared| compared.file.bad.iter().map(|bad| bad.line).collect();
    let unsettled = |compared: &Compared| {
        compared
            .after
            .unsettled
            .iter()
            .map(|&row| compared.file.lines[row])
            .collect()
    };
    Calibrated {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        robot: robot.name.clone(),
        train_rmse: train.after.rmse,
        validation_rmse: validation.map(|compared| compared.after.rmse),
        uncalibrated_rmse: train.before.rmse,
        uncalibrated_validation_rmse: validation.map(|compared| compared.before.rmse),
        rows: train.file.recording.len(),
        validation_rows: validation.map(|compared| compared.file.recording.len()),
        bad_lines: bad(train),
        validation_bad_lines: validation.map(bad).unwrap_or_default(),
        unsettled_lines: unsettled(train),
        validation_unsettled_lines: validation.map(unsettled).unwrap_or_default(),
        repeatability: repeatability(train),
        validation_repeatability: validation.and_then(repeatability),
        alike_rows: fit.map(|fit| fit.alike_rows),
        iterations: fit.map_or(0, |fit| fit.steps),
        parameters: fit.map(|fit| fit.unknowns.clone()).unwrap_or_default(),
        correlations: fit.map(|fit| fit.correlations.clone()).unwrap_or_default(),
    }
}

/// Pulls are nearly the same where none differs by more than this share of the widest range of a servo.
const NEARLY: f64 = 0.01;
/// Rows between two that count as at other times.
const APART: usize = 8;
/// Rows that are compared with each other at most.
const MOST_ROWS: usize = 5000;

/// The share of the first marker's misses that does not repeat (m); none where no pulls come again.
fn repeatability(compared: &Compared) -> Option<f64> {
    let pulls = &compared.file.recording.pulls;
    let range = |servo: usize| {
        let all = pulls.iter().map(|row| row[servo]);
        all.clone().fold(f64::MIN, f64::max) - all.fold(f64::MAX, f64::min)
    };
    let nearly = NEARLY * (0..pulls.first()?.len()).map(range).fold(0.0, f64::max);
    let (mut sum, mut count) = (0.0, 0);
    for a in 0..pulls.len().min(MOST_ROWS) {
        for b in a + APART..pulls.len().min(MOST_ROWS) {
            let mut pairs = pulls[a].iter().zip(&pulls[b]);
            let misses = [a, b].map(|row| compared.after.misses[row].iter().flatten().next());
            if let [Some(one), Some(other)] = misses
                && pairs.all(|(p, q)| (p - q).abs() < nearly)
            {
                sum += (one - other).norm_squared();
                count += 1;
            }
        }
    }
    (count > 0).then(|| (0.5 * sum / f64::from(count)).sqrt())
}

fn page<'a>(
    found: &Calibrated,
    train: &'a Compared,
    validation: Option<&'a Compared>,
) -> CalibrationPage<'a> {
    let held = |name, compared: &'a Compared| Held {
        name,
        file: &compared.file,
        before: &compared.before,
        after: &compared.after,
        replay: &compared.replay,
    };
    let train = held("Training", train);
    CalibrationPage {
        robot: found.robot.clone(),
        held: std::iter::once(train)
            .chain(validation.map(|v| held("Validation", v)))
            .collect(),
        unknowns: found.parameters.clone(),
        correlations: found.correlations.clone(),
    }
}

fn table(found: &Calibrated, out: Option<&Path>) -> String {
    let mut text = String::from("recording    before (mm)   after (mm)   rows\n");
    let rows = [
        (
            "training",
            Some(found.uncalibrated_rmse),
            Some(found.train_rmse),
            Some(found.rows),
        ),
        (
            "validation",
            found.uncalibrated_validation_rmse,
            found.validation_rmse,
            found.validation_rows,
        ),
    ];
    for (name, before, after, rows) in rows {
        if let (Some(before), Some(after), Some(rows)) = (before, after, rows) {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{name:11} {:12.2} {:12.2} {rows:6}",
                1e3 * before,
                1e3 * after
            );
        }
    }
    for (name, repeated) in [
        ("training", found.repeatability),
        ("validation", found.validation_repeatability),
    ] {
        if let Some(repeated) = repeated {
            let _ = writeln!(
                text,
                "{name}: {:.2} mm of it differ from one time to another under nearly the same pulls",
                1e3 * repeated
            );
        }
    }
    for (name, lines) in [
        ("training", &found.unsettled_lines),
        ("validation", &found.validation_unsettled_lines),
    ] {
        if !lines.is_empty() {
            let _ = writeln!(
                text,
                "{} of {name} did not settle and are left out",
                counted(lines.len(), "row")
            );
        }
    }
    if !found.parameters.is_empty() {
        text.push_str("\nunknown                                        value   95 % interval\n");
    }
    for unknown in &found.parameters {
        let [low, high] = unknown.interval;
        let note = if unknown.prior_only {
            "  the recording says little"
        } else {
            ""
        };
        let _ = writeln!(
            text,
            "{:38} {:13.6} [{low:.6}, {high:.6}] {}{note}",
            unknown.name, unknown.value, unknown.unit
        );
    }
    if let Some(out) = out {
        let _ = writeln!(
            text,
            "\nrobot: {}; columns: {}",
            out.display(),
            out.with_extension("columns.toml").display()
        );
    }
    text
}
