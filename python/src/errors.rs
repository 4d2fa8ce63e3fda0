//! Errors of the libraries as exceptions of the package: `tdcr.errors` has the classes.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyModule;
use tdcr::base::InvalidPart;
use tdcr::learn::data::{DataError, SimulateError};
use tdcr::learn::flow::FlowError;
use tdcr::learn::predict::PredictError;
use tdcr::learn::train::{FileError, SettingsError};
use tdcr::pages::PageError;
use tdcr::pipeline::PipelineError;
use tdcr::pipeline::recording::RecordingFileError;
use tdcr::sim::dynamics::DynamicsError;
use tdcr::sim::formats::{ExportError, ImportError, RobotFileError};
use tdcr::sim::inverse::calibration::CalibrationError;
use tdcr::sim::inverse::shape::ShapeControlError;
use tdcr::sim::robot::{CommandError, LoadsError, ParameterError, SpecError};
use tdcr::sim::sensitivity::SensitivityError;
use tdcr::sim::simulation::SimulationError;
use tdcr::sim::statics::NotSettled;

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
    NotSettled => "NotSettledError",
    FlowError => "InputError",
    SettingsError => "InputError",
    InvalidPart => "InputError",
    FileError => "TrainError",
    ShapeControlError => "InputError",
    SimulateError => "DataError",
}

impl From<DynamicsError> for Failure {
    fn from(error: DynamicsError) -> Self {
        match error {
            DynamicsError::Load(error) => error.into(),
            DynamicsError::Parameter(error) => error.into(),
            other => Self::Of("DynamicsError", other.to_string()),
        }
    }
}

impl From<DataError> for Failure {
    fn from(error: DataError) -> Self {
        let class = match &error {
            DataError::InvalidMeta { .. }
            | DataError::ConditionLength { .. }
            | DataError::Design { .. }
            | DataError::TooFewSamples { .. }
            | DataError::TooManySamples { .. }
            | DataError::NoSample { .. } => "InputError",
            _ => "DataError",
        };
        Self::Of(class, error.to_string())
    }
}

impl From<RecordingFileError> for Failure {
    fn from(error: RecordingFileError) -> Self {
        let class = match error {
            RecordingFileError::Columns { .. } => "InputError",
            _ => "DataError",
        };
        Self::Of(class, error.to_string())
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
        let message = error.to_string();
        match error {
            // Of the class of what ended it.
            PipelineError::CaptureEnded { ended, .. } => match *ended {
                PipelineError::Write { .. } => Self::Of("DataError", message),
                ended => match ended.into() {
                    Self::Of(class, _) => Self::Of(class, message),
                    other => other,
                },
            },
            PipelineError::Robot(error) => error.into(),
            PipelineError::Data(error) => error.into(),
            PipelineError::Simulate(error) => error.into(),
            PipelineError::Predict(error) => error.into(),
            PipelineError::File(error) => error.into(),
            PipelineError::Sampler(error) => error.into(),
            PipelineError::Capture(error) => Self::Of("RigError", error.to_string()),
            PipelineError::Metric(_)
            | PipelineError::OwnSampler { .. }
            | PipelineError::Endless { .. }
            | PipelineError::ComparedPoints { .. }
            | PipelineError::ScoredTests { .. }
            | PipelineError::OtherClouds { .. }
            | PipelineError::OtherCommand { .. }
            | PipelineError::SameKey { .. }
            | PipelineError::FewPredicted { .. }
            | PipelineError::OtherMotors { .. }
            | PipelineError::NothingInCommon { .. }
            | PipelineError::NoCommonIndex
            | PipelineError::NoRobot { .. } => Self::input(error.to_string()),
            other => Self::Of("TrainError", other.to_string()),
        }
    }
}

impl From<PageError> for Failure {
    fn from(error: PageError) -> Self {
        match error {
            PageError::Stage(error) => error.into(),
            PageError::OtherCount { .. } => Self::Of("DataError", error.to_string()),
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
            SimulationError::Dynamics(error) => error.into(),
            other => Self::Of("TdcrError", other.to_string()),
        }
    }
}
