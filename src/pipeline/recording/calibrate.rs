//! Calibrating a robot on a recording of it, and validating it on another.

use std::ops::ControlFlow;
use std::path::Path;

use serde::Serialize;
use tdcr_learn::data::Split;
use tdcr_sim::inverse::recording::{
    Correlation, FittedUnknown, Progress, RecordingError, RecordingFit, RecordingSettings, Replay,
    Transmission, fit_recording,
};
use tdcr_sim::robot::{Robot, RobotSpec};

use super::Columns;
use super::calibrate_error::CalibrateError;
use super::clouds::Source;
use super::column_corrections::{Corrected, MovedFrame};
use super::compared::Compared;
use super::fitted::Fitted;
use super::priors::GivenPriors;
use super::reader::{Reader, own_columns, same};
use super::repeat::repeatability;
use super::rows::{BadRows, RecordingFile};
use super::servos::FoundServos;
use crate::pipeline::Monitor;

/// What is fitted, and how.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibrateSettings {
    /// What is fitted.
    pub fitted: Fitted,
    /// What is known of the unknowns, where it is not what the robot file and the table of unknowns say.
    pub priors: GivenPriors,
    /// Distance (m) from which a residual counts less than by its square; a fortieth of the robot's length where not given.
    pub loss: Option<f64>,
    /// Starts of the fit: the robot's own values, then others at random.
    pub starts: usize,
    /// Seed of the random starts.
    pub seed: u64,
    /// Rows that cannot be used.
    pub bad_rows: BadRows,
}

/// What a recording's rows are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Measured {
    /// Places of markers, in the order of time.
    Markers,
    /// Points of the surface of the robot at rest.
    Clouds,
}

/// All that `tdcr calibrate --json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct Calibrated {
    tdcr_version: &'static str,
    /// Name of the robot.
    pub robot: String,
    /// What was measured.
    pub measured: Measured,
    /// Root mean square distance of the markers from where the robot says, mean offset aligned, or of the clouds' points from its
    /// surface (m).
    pub train_rmse: f64,
    /// The same of the other recording.
    pub validation_rmse: Option<f64>,
    /// The same of the robot as it was given.
    pub uncalibrated_rmse: f64,
    /// And of the other recording.
    pub uncalibrated_validation_rmse: Option<f64>,
    /// Median distance of the clouds' points from the robot's surface (m), which stray points hardly change; none of markers.
    pub train_median: Option<f64>,
    /// The same of the other recording.
    pub validation_median: Option<f64>,
    /// The same of the robot as it was given.
    pub uncalibrated_median: Option<f64>,
    /// And of the other recording.
    pub uncalibrated_validation_median: Option<f64>,
    /// Rows.
    pub rows: usize,
    /// Rows of the other recording.
    pub validation_rows: Option<usize>,
    /// Whether the other recording are the `val` and `test` splits of the data set that the robot was fitted to.
    pub validated_on_splits: bool,
    /// Lines of rows that were left out; of data sets and logs the numbers of samples, here and below.
    pub bad_lines: Vec<usize>,
    /// The same of the other recording.
    pub validation_bad_lines: Vec<usize>,
    /// Lines of rows in which the calibrated robot does not settle, which count in no figure.
    pub unsettled_lines: Vec<usize>,
    /// The same of the other recording.
    pub validation_unsettled_lines: Vec<usize>,
    /// Half the mean square difference, as a root, of the residuals in rows of nearly the same tendon displacements, at other
    /// times (m): what no model without path dependence can explain.
    pub repeatability: Option<f64>,
    /// The same of the other recording.
    pub validation_repeatability: Option<f64>,
    /// The servos, where they were sought, or taken otherwise than the columns say.
    pub servo_map: Option<FoundServos>,
    /// How the recording's frame was moved before the fit, where it was.
    pub frame: Option<MovedFrame>,
    /// Correlation length of the errors (rows).
    #[serde(rename = "alike_rows")]
    pub correlation_length: Option<f64>,
    /// Iterations of the fit.
    pub iterations: usize,
    /// What was found.
    pub parameters: Vec<FittedUnknown>,
    /// What the recording hardly makes identifiable one by one.
    pub correlations: Vec<Correlation>,
}

/// A calibrated robot.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The robot.
    pub spec: RobotSpec,
    /// The column map with what was found of servos and markers.
    pub columns: Columns,
    /// What is printed of it.
    pub found: Calibrated,
    /// The recording that it was fitted to.
    pub train: Compared,
    /// The recording that it was validated on.
    pub validation: Option<Compared>,
    /// What one should know besides.
    pub notes: Vec<String>,
}

/// Calibrates `robot` on the recording `data`, and validates it, before and after, on the recording `validate`.
///
/// A recording is a table, read by the column map `columns`, the folder of a data set, or the log of a rig (MCAP). Data sets and
/// logs have clouds and commands, and need no map; of one that is given the gains, the offsets and the frame are used. The robot is
/// fitted to a data set's `train` split, and validated on its `val` and `test` splits where `validate` is the same folder or none.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate(
    robot: &RobotSpec,
    columns: Option<&Columns>,
    data: &Path,
    validate: Option<&Path>,
    settings: &CalibrateSettings,
    monitor: &dyn Monitor,
) -> Result<Calibration, CalibrateError> {
    let mut notes = Vec::new();
    let failed = |source: RecordingError| match source {
        RecordingError::Interrupted => CalibrateError::Interrupted,
        RecordingError::Prior(error) => CalibrateError::File(settings.priors.refused(&error)),
        source => CalibrateError::Recording {
            path: data.to_owned(),
            source,
        },
    };
    let built = Robot::new(robot.clone()).map_err(|error| failed(error.into()))?;
    let source = Source::of(data);
    let columns = match columns {
        Some(columns) => columns.clone(),
        None => own_columns(robot, data)?,
    };
    let reader = Reader {
        robot: &built,
        bad_rows: settings.bad_rows,
    };
    let corrected = Corrected::read(robot, columns, data, &reader, &settings.fitted, &mut notes)?;
    let (train, columns) = (corrected.file, corrected.columns);
    let own_splits = source == Source::DataSet && validate.is_none_or(|other| same(data, other));
    let validation = match validate {
        _ if own_splits => {
            Some(reader.load(data, &columns, &[Split::Val, Split::Test], &mut notes)?)
        }
        Some(path) if Source::of(path).has_clouds() != source.has_clouds() => {
            return Err(CalibrateError::OtherKind {
                data: data.to_owned(),
                validate: path.to_owned(),
            });
        }
        Some(path) => Some(reader.load(path, &columns, &Split::ALL, &mut notes)?),
        None => None,
    };
    let mut given = columns.transmission(robot);
    if source.has_clouds() {
        given.markers.clear();
    }
    let fit = fit(robot, &given, &train, settings, monitor).map_err(failed)?;
    let (spec, transmission) = match &fit {
        Some(fit) => (&fit.spec, &fit.transmission),
        None => (robot, &given),
    };
    let compare = |file: RecordingFile| -> Result<Compared, RecordingError> {
        let replay = Replay::new(spec, transmission, &file.recording)?;
        Ok(Compared {
            before: Replay::new(robot, &given, &file.recording)?.residuals(&file.recording),
            after: replay.residuals(&file.recording),
            replay,
            file,
        })
    };
    let train = compare(train).map_err(failed)?;
    let validation = validation.map(compare).transpose().map_err(failed)?;
    let mut found = summary(robot, fit.as_ref(), &train, validation.as_ref());
    (found.servo_map, found.frame) = (corrected.servo_map, corrected.frame);
    notes.extend(far(&found, &built));
    found.validated_on_splits = own_splits;
    if source.has_clouds() {
        found.measured = Measured::Clouds;
    }
    Ok(Calibration {
        spec: spec.clone(),
        columns: columns.with(transmission),
        found,
        train,
        validation,
        notes,
    })
}

/// The fit; none where nothing is to be fitted.
fn fit(
    robot: &RobotSpec,
    given: &Transmission,
    train: &RecordingFile,
    settings: &CalibrateSettings,
    monitor: &dyn Monitor,
) -> Result<Option<RecordingFit>, RecordingError> {
    let of_fit = RecordingSettings {
        groups: settings.fitted.groups_of(robot, train.recording.order),
        priors: settings.priors.priors.clone(),
        loss: settings.loss,
        starts: settings.starts.max(1),
        seed: settings.seed,
    };
    if of_fit.groups.is_empty() && of_fit.priors.is_empty() {
        return Ok(None);
    }
    let mut begun = false;
    let mut done = 0;
    let stop = || monitor.interrupted();
    let mut watch = |progress: Progress| {
        if !begun {
            monitor.begin("calibrate", progress.most as u64, 0);
            begun = true;
        }
        monitor.advance((progress.done - done) as u64);
        done = progress.done;
        monitor.status(&format!("misses {:.2} mm", 1e3 * progress.rms));
        match monitor.interrupted() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    };
    let fit = fit_recording(robot, given, &train.recording, &of_fit, &mut watch, &stop);
    if begun {
        monitor.end();
    }
    fit.map(Some)
}

/// A calibrated robot with an error of more than this share of its length does not follow the recording.
const FAR: f64 = 0.1;

/// What to note of a robot that is calibrated and still far from the recording.
fn far(found: &Calibrated, robot: &Robot) -> Option<String> {
    let length = *robot.arc_lengths().last()?;
    // Of clouds stray points make most of the root mean square.
    let error = found.train_median.unwrap_or(found.train_rmse);
    let share = error / length;
    (!found.parameters.is_empty() && share > FAR).then(|| {
        format!(
            "the calibrated robot still misses {:.1} mm, {:.0} % of its length: do the columns say which servo pulls which tendon, \
             which way and in which unit, and is the robot file right of lengths and holes?",
            1e3 * error,
            100.0 * share
        )
    })
}

fn summary(
    robot: &RobotSpec,
    fit: Option<&RecordingFit>,
    train: &Compared,
    validation: Option<&Compared>,
) -> Calibrated {
    let bad = |compared: &Compared| compared.file.bad.iter().map(|bad| bad.line).collect();
    let unsettled = |compared: &Compared| {
        let rows = compared.after.unsettled.iter();
        rows.map(|&row| compared.file.lines[row]).collect()
    };
    Calibrated {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        robot: robot.name.clone(),
        measured: Measured::Markers,
        train_rmse: train.after.rmse,
        validation_rmse: validation.map(|compared| compared.after.rmse),
        uncalibrated_rmse: train.before.rmse,
        uncalibrated_validation_rmse: validation.map(|compared| compared.before.rmse),
        train_median: train.after.median,
        validation_median: validation.and_then(|compared| compared.after.median),
        uncalibrated_median: train.before.median,
        uncalibrated_validation_median: validation.and_then(|compared| compared.before.median),
        rows: train.file.recording.len(),
        validation_rows: validation.map(|compared| compared.file.recording.len()),
        validated_on_splits: false,
        bad_lines: bad(train),
        validation_bad_lines: validation.map(bad).unwrap_or_default(),
        unsettled_lines: unsettled(train),
        validation_unsettled_lines: validation.map(unsettled).unwrap_or_default(),
        repeatability: repeatability(train),
        validation_repeatability: validation.and_then(repeatability),
        servo_map: None,
        frame: None,
        correlation_length: fit.map(|fit| fit.correlation_length),
        iterations: fit.map_or(0, |fit| fit.steps),
        parameters: fit.map(|fit| fit.unknowns.clone()).unwrap_or_default(),
        correlations: fit.map(|fit| fit.correlations.clone()).unwrap_or_default(),
    }
}
