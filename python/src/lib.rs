//! The native module `tdcr._tdcr` of the Python package: the libraries on NumPy arrays.
//!
//! It is thin. The Python package beside it (`python/tdcr/`) converts and names what users hand over, and documents what they
//! get; here arrays have their right types, and shapes are checked once more, as nothing may panic.
//!
//! | module | what it gives to Python |
//! |---|---|
//! | `robot` | `Robot`, from files or text |
//! | `loads` | `Loads`, and loads by rows |
//! | `statics` | equilibria, one or by rows |
//! | `sensitivity` | their derivatives by rows |
//! | `data` | data sets: read, made, put together |
//! | `training` | training runs |
//! | `predictor` | `Predictor`: clouds by a trained model |
//! | `scoring` | scores of predicted clouds |
//! | `metrics` | distances between clouds by rows |
//!
//! What they use: `run` (threads, the interpreter's lock, Ctrl-C), `stage` (the libraries' long stages),
//! `arrays` and `errors`.

mod arrays;
mod data;
mod errors;
mod loads;
mod metrics;
mod predictor;
mod robot;
mod run;
mod scoring;
mod sensitivity;
mod stage;
mod statics;
mod training;

/// The native part of the package `tdcr`.
// No interpreter without the lock has tested it yet.
#[pyo3::pymodule(gil_used = true)]
mod _tdcr {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::data::{Dataset, check_data, collect, merge};
    #[pymodule_export]
    use crate::loads::Loads;
    #[pymodule_export]
    use crate::metrics::{chamfer_rows, emd_rows};
    #[pymodule_export]
    use crate::predictor::Predictor;
    #[pymodule_export]
    use crate::robot::Robot;
    #[pymodule_export]
    use crate::run::{set_threads, threads};
    #[pymodule_export]
    use crate::scoring::evaluate;
    #[pymodule_export]
    use crate::sensitivity::{jacobian_rows, jvp_rows, vjp_rows};
    #[pymodule_export]
    use crate::statics::{EquilibriumRows, Settler, follow_rows, settle_rows};
    #[pymodule_export]
    use crate::training::{distill, train};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
