//! Errors of the libraries as exceptions of the package: `tdcr.errors` has the classes.

use std::fmt::Display;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyModule;
use tdcr::base::InvalidPart;
use tdcr::learn::data::{DataError, SimulateError};
use tdcr::learn::flow::FlowError;
use tdcr::learn::options::OptionsError;
use tdcr::learn::predict::PredictError;
use tdcr::learn::train::{FileError, SettingsError};
use tdcr::pages::PageError;
use tdcr::pipeline::recording::RecordingFileError;
use tdcr::pipeline::{CaptureStop, EvalError, PipelineError, TrainRunError};
use tdcr::sim::contact::ContactError;
use tdcr::sim::dynamics::DynamicsError;
use tdcr::sim::formats::{ExportError, ImportError, RobotFileError, SketchError};
use tdcr::sim::inverse::calibration::CalibrationError;
use tdcr::sim::inverse::shape::ShapeControlError;
use tdcr::sim::objects::ObjectError;
use tdcr::sim::robot::{CommandError, LoadsError, ParameterError, SpecError};
use tdcr::sim::scene::SceneError;
use tdcr::sim::sensitivity::SensitivityError;
use tdcr::sim::simulation::SimulationError;
use tdcr::sim::statics::NotSettled;

use crate::hint;

/// Why a call failed: an exception, or what to make one of.
#[derive(Debug)]
pub enum Failure {
    /// Name of a class of `tdcr.errors`, and the message.
    Of(&'static str, String),
    /// An exception that Python raised.
    Python(PyErr),
}

/// What a native function returns.
pub type Outcome<T> = Result<T, Failure>;

impl Failure {
    /// An input that has the wrong shape or value.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Of("InputError", message.into())
    }

    /// A failure of a library, with what to do about it.
    pub fn with_hint(class: &'static str, error: &dyn Display, hint: Option<String>) -> Self {
        let text = error.to_string();
        Self::Of(
            class,
            match hint {
                // Below a list, not behind its last line.
                Some(hint) if text.contains('\n') => format!("{text}\n{hint}"),
                Some(hint) => format!("{text}; {hint}"),
                None => text,
            },
        )
    }

    /// This failure, of one of several that `name` tells apart.
    pub fn of(self, name: &str) -> Self {
        match self {
            Self::Of(class, message) => Self::Of(class, format!("{name}: {message}")),
            python => python,
        }
    }

    /// This failure, of row `row` of a batch.
    pub fn of_row(self, row: usize) -> Self {
        match self {
            Self::Of(class, message) => Self::Of(class, format!("row {row}: {message}")),
            python => python,
        }
    }
}

/// One of several values, by its name.
pub fn choice<T: Clone>(option: &str, name: &str, values: &[(&str, T)]) -> Outcome<T> {
    let found = values.iter().find(|(known, _)| *known == name);
    let value = found.map(|(_, value)| value.clone());
    value.ok_or_else(|| {
        let names: Vec<_> = values.iter().map(|(name, _)| format!("{name:?}")).collect();
        let names = names.join(", ");
        Failure::input(format!("{option} is {name:?}; expected one of {names}"))
    })
}

/// JSON that was written.
pub fn text(written: serde_json::Result<String>) -> Outcome<String> {
    written.map_err(|error| Failure::Of("TdcrError", error.to_string()))
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Python(error) => error,
            Failure::Of(class, message) => Python::attach(|py| match exception(py, class) {
                Ok(class) => PyErr::from_type(class, message),
                Err(_) => PyRuntimeError::new_err(message),
            }),
        }
    }
}

/// A class of `tdcr.errors`.
fn exception<'py>(py: Python<'py>, class: &str) -> PyResult<Bound<'py, pyo3::types::PyType>> {
    static ERRORS: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let module = ERRORS.get_or_try_init(py, || py.import("tdcr.errors").map(Bound::unbind))?;
    Ok(module.bind(py).getattr(class)?.cast_into()?)
}

/// Says of which class the errors of each type are.
macro_rules! classes {
    ($($error:ty => $class:literal,)*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::Of($class, error.to_string())
            }
        })*
    };
}

classes! {
    SpecError => "RobotError",
    RobotFileError => "RobotError",
    ImportError => "RobotError",
    ExportError => "RobotError",
    ParameterError => "ParameterError",
    CommandError => "CommandError",
    LoadsError => "LoadsError",
    SceneError => "SceneError",
    ContactError => "ContactError",
    NotSettled => "NotSettledError",
    FlowError => "InputError",
    SettingsError => "InputError",
    InvalidPart => "InputError",
    FileError => "TrainError",
    ShapeControlError => "InputError",
    SimulateError => "DataError",
    SketchError => "RobotError",
}

impl From<OptionsError> for Failure {
    fn from(error: OptionsError) -> Self {
        Self::input(match error {
            OptionsError::Robot(error) => return error.into(),
            OptionsError::NoContext { option } => {
                format!("{option} is of the net 'hybrid'; the network is an mlp")
            }
            OptionsError::Stages { option, found } => {
                format!("{option} has {found} values; expected 3, one for each stage")
            }
            OptionsError::Endless { .. } => format!("{error}; give steps"),
            other => other.to_string(),
        })
    }
}

impl From<DynamicsError> for Failure {
    fn from(error: DynamicsError) -> Self {
        match error {
            DynamicsError::Load(error) => error.into(),
            DynamicsError::Parameter(error) => error.into(),
            DynamicsError::Objects(
                error @ (ObjectError::State { .. } | ObjectError::Count { .. }),
            ) => Self::Of("InputError", error.to_string()),
            other => Self::Of("DynamicsError", other.to_string()),
        }
    }
}

impl From<DataError> for Failure {
    fn from(error: DataError) -> Self {
        let hint = hint::of_data(&error);
        Self::with_hint(class_of_data(&error), &error, hint)
    }
}

fn class_of_data(error: &DataError) -> &'static str {
    match error {
        DataError::InvalidMeta { .. }
        | DataError::ConditionLength { .. }
        | DataError::Design { .. }
        | DataError::TooFewSamples { .. }
        | DataError::TooManySamples { .. }
        | DataError::NoSample { .. } => "InputError",
        _ => "DataError",
    }
}

impl From<RecordingFileError> for Failure {
    fn from(error: RecordingFileError) -> Self {
        let hint = hint::of_recording(&error);
        let class = match error {
            RecordingFileError::Columns { .. } | RecordingFileError::Priors { .. } => "InputError",
            _ => "DataError",
        };
        Self::with_hint(class, &error, hint)
    }
}

impl From<PredictError> for Failure {
    fn from(error: PredictError) -> Self {
        match error {
            PredictError::Length(error) => error.into(),
            PredictError::Simulate(error) => error.into(),
            PredictError::NotFinite { .. } => Self::input(error.to_string()),
            other => Self::Of("TrainError", other.to_string()),
        }
    }
}

impl From<PipelineError> for Failure {
    fn from(error: PipelineError) -> Self {
        let hint = hint::of_stage(&error);
        match error {
            PipelineError::Robot(error) => error.into(),
            PipelineError::Data(error) => error.into(),
            PipelineError::Simulate(error) => error.into(),
            PipelineError::Predict(error) => error.into(),
            PipelineError::File(error) => error.into(),
            PipelineError::Eval(EvalError::OfMethod { name, source }) => {
                Self::from(*source).of(&name)
            }
            PipelineError::Train(TrainRunError::Sampler(error)) => error.into(),
            PipelineError::Train(TrainRunError::Options(error)) => error.into(),
            error => Self::with_hint(class_of(&error), &error, hint),
        }
    }
}

/// The class of a stage's error that is none of another library's.
fn class_of(error: &PipelineError) -> &'static str {
    match error {
        PipelineError::Capture(CaptureStop::Ended { ended, .. }) => class_of_end(ended),
        PipelineError::Metric(_)
        | PipelineError::Capture(
            CaptureStop::Given { .. } | CaptureStop::Payloads { .. } | CaptureStop::Loads(_),
        )
        | PipelineError::ComparedPoints { .. }
        | PipelineError::Compare(_)
        | PipelineError::Train(TrainRunError::OwnSampler { .. })
        | PipelineError::Eval(
            EvalError::ScoredTests { .. }
            | EvalError::OtherClouds { .. }
            | EvalError::OtherCommand { .. }
            | EvalError::SameKey { .. }
            | EvalError::NoMethod
            | EvalError::FewPredicted { .. },
        ) => "InputError",
        PipelineError::Capture(_) => "RigError",
        _ => "TrainError",
    }
}

/// The class of what ended a capture.
fn class_of_end(ended: &PipelineError) -> &'static str {
    match ended {
        PipelineError::Write { .. } | PipelineError::Simulate(_) => "DataError",
        PipelineError::Data(error) => class_of_data(error),
        PipelineError::Robot(_) => "RobotError",
        ended => class_of(ended),
    }
}

impl From<PageError> for Failure {
    fn from(error: PageError) -> Self {
        match error {
            PageError::Stage(error) => error.into(),
            PageError::OtherCount { .. } => {
                let hint = hint::of_page(&error);
                Self::with_hint("DataError", &error, hint)
            }
            other => Self::input(other.to_string()),
        }
    }
}

impl From<SensitivityError> for Failure {
    fn from(error: SensitivityError) -> Self {
        match error {
            SensitivityError::Parameter(error) => error.into(),
            other => Self::Of("SensitivityError", other.to_string()),
        }
    }
}

impl From<CalibrationError> for Failure {
    fn from(error: CalibrationError) -> Self {
        match error {
            CalibrationError::Parameter(error) => error.into(),
            CalibrationError::Spec(error) => error.into(),
            other => Self::Of("InputError", other.to_string()),
        }
    }
}

impl From<SimulationError> for Failure {
    fn from(error: SimulationError) -> Self {
        match error {
            SimulationError::Command(error) => error.into(),
            SimulationError::Loads(error) => error.into(),
            SimulationError::NotSettled(error) => error.into(),
            SimulationError::Contact(error) => error.into(),
            SimulationError::Dynamics(error) => error.into(),
            other => Self::Of("TdcrError", other.to_string()),
        }
    }
}
