//! Robots calibrated on recordings of them.

use std::path::PathBuf;

use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use tdcr::pages::CalibrationPage;
use tdcr::pipeline::recording::{
    BadRows, CalibrateError, CalibrateSettings, Calibration, Columns, Compared, Fitted, calibrate,
};

use crate::arrays::array;
use crate::errors::{Failure, Outcome};
use crate::options::{TableArgument, priors};
use crate::robot::Robot;
use crate::run;
use crate::stage::Stage;

/// What `tdcr.calibrate_recording` is told besides the robot and the files.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Options {
    fit: Option<Vec<String>>,
    loss: Option<f64>,
    starts: usize,
    seed: u64,
    skip_bad_rows: bool,
    priors: Option<TableArgument>,
}

impl Options {
    fn settings(&self) -> Outcome<CalibrateSettings> {
        if self
            .loss
            .is_some_and(|loss| !(loss > 0.0 && loss.is_finite()))
        {
            return Err(Failure::input("loss is no length above 0 (m)".to_owned()));
        }
        let fitted = match &self.fit {
            None => Fitted::default(),
            Some(names) => Fitted::named(names.iter().map(String::as_str)).map_err(|name| {
                let names: Vec<&str> = Fitted::names().collect();
                Failure::input(format!(
                    "fit has {name:?}; expected some of {}",
                    names.join(", ")
                ))
            })?,
        };
        Ok(CalibrateSettings {
            fitted,
            priors: priors(self.priors.as_ref())?,
            loss: self.loss,
            starts: self.starts,
            seed: self.seed,
            bad_rows: match self.skip_bad_rows {
                true => BadRows::LeftOut,
                false => BadRows::Refused,
            },
        })
    }
}

/// A recording beside what the calibrated robot says of it; points that were not measured, or have no answer, are not numbers.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct ReplayedRecording {
    times: Py<PyArray1<f64>>,
    patterns: Vec<String>,
    lines: Vec<usize>,
    pulls: Py<PyArray2<f64>>,
    measured: Py<PyArray3<f64>>,
    predicted: Py<PyArray3<f64>>,
}

impl ReplayedRecording {
    fn new(py: Python<'_>, compared: &Compared) -> Outcome<Self> {
        let file = &compared.file;
        let recording = &file.recording;
        let rows = recording.len();
        let servos = recording.pulls.first().map_or(0, Vec::len);
        let points = recording.points.first().map_or(0, Vec::len);
        let nan = nalgebra::Vector3::repeat(f64::NAN);
        let measured = recording.points.iter().flatten();
        let measured = measured.flat_map(|point| point.unwrap_or(nan).data.0[0]);
        let predicted = compared.replay.points.iter().flat_map(|row| match row {
            Some(row) => row.clone(),
            None => vec![nan; points],
        });
        let predicted = predicted.flat_map(|point| point.data.0[0]);
        Ok(Self {
            times: array(py, recording.times.clone(), [rows])?.unbind(),
            patterns: file.patterns.clone(),
            lines: file.lines.clone(),
            pulls: array(py, recording.pulls.concat(), [rows, servos])?.unbind(),
            measured: array(py, measured.collect(), [rows, points, 3])?.unbind(),
            predicted: array(py, predicted.collect(), [rows, points, 3])?.unbind(),
        })
    }
}

/// A robot calibrated on a recording.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct RecordingCalibration {
    robot: Py<Robot>,
    /// The column map as TOML text.
    columns: String,
    /// What `tdcr calibrate --json` prints.
    found: String,
    train: Py<ReplayedRecording>,
    validation: Option<Py<ReplayedRecording>>,
    notes: Vec<String>,
}

/// Calibrates a robot on the recording `data`; `columns` is the file of a column map, the JSON text of one, or none. Writes the page `report`.
#[pyfunction]
#[pyo3(signature = (robot, data, columns, validate, report, options, progress = None))]
#[allow(clippy::too_many_arguments, reason = "the arguments of a command")]
pub fn calibrate_recording(
    py: Python<'_>,
    robot: &Robot,
    data: PathBuf,
    columns: Option<TableArgument>,
    validate: Option<PathBuf>,
    report: Option<PathBuf>,
    options: Options,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<RecordingCalibration> {
    let spec = robot.0.spec().clone();
    let settings = options.settings()?;
    let columns = match columns {
        Some(TableArgument::File(path)) => Some(Columns::load(&path, &spec)?),
        Some(TableArgument::Json((text,))) => Some(Columns::from_json(&text, &spec)?),
        None => None,
    };
    let calibration = run::long(py, progress, |watch| {
        let stage = Stage::new(&["calibrate"], watch);
        let calibration = calibrate(
            &spec,
            columns.as_ref(),
            &data,
            validate.as_deref(),
            &settings,
            &stage,
        )?;
        if let Some(report) = &report {
            let page = CalibrationPage::new(&calibration).to_html();
            tdcr::base::files::write_atomically(report, |file| {
                std::io::Write::write_all(file, page.as_bytes())
            })
            .map_err(|error| {
                Failure::Of(
                    "DataError",
                    format!("cannot write {}: {error}", report.display()),
                )
            })?;
        }
        Ok::<Calibration, Failure>(calibration)
    })??;
    let text = |error: &dyn std::fmt::Display| Failure::Of("TdcrError", error.to_string());
    let replayed = |compared: &Compared| -> Outcome<Py<ReplayedRecording>> {
        Ok(Py::new(py, ReplayedRecording::new(py, compared)?)?)
    };
    Ok(RecordingCalibration {
        columns: toml::to_string(&calibration.columns).map_err(|error| text(&error))?,
        found: serde_json::to_string(&calibration.found).map_err(|error| text(&error))?,
        train: replayed(&calibration.train)?,
        validation: calibration.validation.as_ref().map(replayed).transpose()?,
        notes: calibration.notes,
        robot: Py::new(py, Robot::new(calibration.spec)?)?,
    })
}

impl From<CalibrateError> for Failure {
    fn from(error: CalibrateError) -> Self {
        match error {
            CalibrateError::File(error) => error.into(),
            other => Self::input(other.to_string()),
        }
    }
}
