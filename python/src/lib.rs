//! The native module `tdcr._tdcr` of the Python package: the libraries on NumPy arrays.
//!
//! It is thin. The Python package beside it (`python/tdcr/`) converts and names what users hand over, and documents what they
//! get; here arrays have their right types, and shapes are checked once more, as nothing may panic.
//!
//! | module | what it gives to Python |
//! |---|---|
//! | [`robot`] | `Robot`, from files or text |
//! | [`loads`] | `Loads`, and loads by rows |
//! | [`statics`] | equilibria, one or by rows |
//! | [`sensitivity`] | their derivatives by rows |
//! | [`stream`] | fresh samples of a simulated robot |
//! | [`learning`] | what training in PyTorch shares with `tdcr train` |
//!
//! What they use: [`run`] (threads, the interpreter's lock, Ctrl-C), [`arrays`] and [`errors`].

mod arrays;
mod errors;
mod learning;
mod loads;
mod robot;
mod run;
mod sensitivity;
mod statics;
mod stream;

/// The native part of the package `tdcr`.
// No interpreter without the lock has tested it yet.
#[pyo3::pymodule(gil_used = true)]
mod _tdcr {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::learning::{
        presets, read_cloud_set, read_commands, start_noise, train_settings, velocities,
    };
    #[pymodule_export]
    use crate::loads::Loads;
    #[pymodule_export]
    use crate::robot::Robot;
    #[pymodule_export]
    use crate::run::{set_threads, threads};
    #[pymodule_export]
    use crate::sensitivity::{jacobian_rows, jvp_rows, vjp_rows};
    #[pymodule_export]
    use crate::statics::{EquilibriumRows, Settler, follow_rows, settle_rows};
    #[pymodule_export]
    use crate::stream::Stream;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
