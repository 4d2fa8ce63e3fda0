//! MuJoCo's C library, as far as the cross-checks of `tdcr` use it: load a model from MJCF text, set
//! its state, and read what MuJoCo computes.
//!
//! Compiles against MuJoCo 2.2 (Debian's) up to 4.0; `build.rs` says how one is chosen. Names are
//! MuJoCo's own, units SI. `tests/closed_forms.rs` shows the use of everything here, and
//! `tests/robots` holds the simulator against MuJoCo.
//!
//! When MuJoCo meets an error of its own while it computes (it is out of memory, say), it prints the
//! error and ends the process.

mod data;
mod model;

pub use data::{Data, Transition};
pub use model::{LoadsError, Model, UnknownBody};

#[allow(
    dead_code,
    missing_docs,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    unused_imports,
    unused_qualifications,
    clippy::all,
    clippy::undocumented_unsafe_blocks,
    reason = "written by bindgen in C's names"
)]
mod sys {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

/// MuJoCo's version, such as `2.2.2`.
pub fn version() -> String {
    // SAFETY: MuJoCo returns a string constant.
    let version = unsafe { std::ffi::CStr::from_ptr(sys::mj_versionString()) };
    version.to_string_lossy().into_owned()
}
