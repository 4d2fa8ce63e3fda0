//! `tdcr calibrate`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, ensure};
use clap::Args;
use clap::builder::PossibleValuesParser;
use tdcr::pages::CalibrationPage;
use tdcr::pipeline::recording::{
    BadRows, CalibrateError, CalibrateSettings, Calibrated, Columns, Fitted, FoundServos,
    GivenPriors, Measured, calibrate,
};
use tdcr::report::counted;

use super::console::{Console, Interrupted};
use super::output;

/// Calibrate a robot on a recording: what its servos and markers did in the order of time, or clouds of it at rest
///
/// Finds the groups of unknowns of --fit that explain the markers or clouds best, and says how far the robot is from the recording before
/// and after, and from another recording that it was not fitted to. The calibrated robot is a robot file; the column map with
/// what was found of servos and markers is written beside it, as NAME.columns.toml. With --fit none, nothing is fitted.
#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// The robot as it was designed: 2m, 3m, 5m, or the path of a robot file
    #[arg(long, value_name = "ROBOT")]
    robot: String,
    /// The recording: a table of markers (CSV with a header), the folder of a data set, whose train split is fitted to, or the log
    /// of a capture (.mcap)
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// Which column holds what (TOML; docs/sim-to-real.md). Data sets and logs need none: of one that is given, servos' gains and
    /// offsets and the frame are used
    #[arg(long, value_name = "FILE")]
    columns: Option<PathBuf>,
    /// Another recording with the same columns, or of clouds where --data has clouds, to validate the calibrated robot on [default:
    /// of a data set its val and test splits; else none]
    #[arg(long, value_name = "FILE")]
    validate: Option<PathBuf>,
    /// Groups of unknowns, separated by commas, or none [default: pretension, spool_radius, backlash, lag, hole_angles, twist, stiffness,
    /// torsion, rest_bend, tendon_stiffness, base_pose, marker_offset, gravity, mass, those of them that the robot has, without backlash and
    /// lag where the recording has clouds; besides these
    /// hole_radius, tendon_stiffening, friction]. `default` stands for the default ones: default,friction fits friction besides. With
    /// servo_map, which servo pulls which tendon, and which way, is found first, from rows in which one moves alone; with the default ones
    /// only where the columns are clearly wrong, and so is the recording's frame
    #[arg(long, value_delimiter = ',', value_name = "GROUP,..", value_parser = names())]
    fit: Option<Vec<String>>,
    /// What is known of unknowns before the fit, by the name of a group or of an unknown: `spread`, `bounds`, `value` (TOML;
    /// docs/sim-to-real.md) [default: the robot file and the priors of the groups]
    #[arg(long, value_name = "FILE")]
    priors: Option<PathBuf>,
    /// Distance (m) beyond which a marker's or a point's residual counts less than by its square [default: a fortieth of the robot's length]
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

/// The name of an empty list of what is fitted.
const NONE: &str = "none";

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(Fitted::names().chain([NONE]))
}

impl CalibrateArgs {
    fn settings(&self) -> anyhow::Result<CalibrateSettings> {
        let names = self.fit.as_deref();
        let none = names.is_some_and(|names| names.iter().any(|name| name == NONE));
        ensure!(
            !none || names.is_some_and(|names| names.len() == 1),
            "--fit none stands alone"
        );
        Ok(CalibrateSettings {
            fitted: match names {
                None => Fitted::default(),
                Some(_) if none => Fitted::nothing(),
                Some(names) => Fitted::named(names.iter().map(String::as_str))
                    .map_err(|name| anyhow!("--fit has {name}, which is no group"))?,
            },
            priors: match &self.priors {
                Some(file) => GivenPriors::load(file)?,
                None => GivenPriors::default(),
            },
            loss: self.loss,
            starts: self.starts.into(),
            seed: self.seed,
            bad_rows: match self.skip_bad_rows {
                true => BadRows::LeftOut,
                false => BadRows::Refused,
            },
        })
    }
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
    let settings = args.settings()?;
    let robot = super::load_robot(&args.robot)?;
    let columns = match &args.columns {
        Some(columns) => Some(Columns::load(columns, &robot)?),
        None => None,
    };
    let (columns, data) = (columns.as_ref(), &args.data);
    let validate = args.validate.as_deref();
    let calibration = match calibrate(&robot, columns, data, validate, &settings, console) {
        Err(CalibrateError::Interrupted) => return Err(Interrupted.into()),
        calibration => calibration?,
    };
    for note in &calibration.notes {
        tracing::warn!("{note}");
    }
    if let Some(out) = &args.out {
        output::write(out, calibration.spec.to_toml()?)?;
        let map = toml::to_string(&calibration.columns)?;
        output::write(&out.with_extension("columns.toml"), map)?;
    }
    if let Some(report) = &args.report {
        output::write(report, CalibrationPage::new(&calibration).to_html())?;
    }
    console.result(&calibration.found, |found| {
        table(found, args.out.as_deref())
    })
}

fn table(found: &Calibrated, out: Option<&Path>) -> String {
    let mut text = String::from("recording           before (mm)   after (mm)   rows\n");
    let clouds = found.measured == Measured::Clouds;
    let mut rows = [
        (
            if clouds { "training RMS" } else { "training" },
            Some(found.uncalibrated_rmse),
            Some(found.train_rmse),
            Some(found.rows),
        ),
        (
            if clouds {
                "validation RMS"
            } else {
                "validation"
            },
            found.uncalibrated_validation_rmse,
            found.validation_rmse,
            found.validation_rows,
        ),
        (
            "training median",
            found.uncalibrated_median,
            found.train_median,
            Some(found.rows),
        ),
        (
            "validation median",
            found.uncalibrated_validation_median,
            found.validation_median,
            found.validation_rows,
        ),
    ];
    // Of clouds the medians come first: stray points make most of the root mean squares.
    rows.rotate_left(2);
    for (name, before, after, rows) in rows {
        if let (Some(before), Some(after), Some(rows)) = (before, after, rows) {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{name:18} {:12.2} {:12.2} {rows:6}",
                1e3 * before,
                1e3 * after
            );
        }
    }
    if clouds {
        text.push_str(
            "distances of the clouds' points from the robot's surface: the median, and the root mean square, which stray points raise\n",
        );
    }
    if found.validated_on_splits {
        text.push_str("validation: the val and test splits of the same data set\n");
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
    if let Some(found) = &found.servo_map {
        text += &servos(found);
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

/// Which servo pulls which tendon.
fn servos(found: &FoundServos) -> String {
    let mut text =
        String::from("\ntendon   servo                      sign   missed of its pulls\n");
    for servo in &found.servos {
        let percent = 100.0 * servo.misfit.sqrt();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:6}   {:24} {:6}   {percent:.0} %",
            servo.tendon + 1,
            servo.column,
            servo.sign
        );
    }
    let degrees = found.rotation.to_degrees();
    text + &format!("the recording's frame is turned by {degrees:.1} degrees about the base\n")
}
