//! Studies: sweeps over designs, loads and commands, as one file that says what varies and what is wanted.
//!
//! A [`Study`] is read from a TOML file ([`Study::load`]; `docs/studies.md` has every key) and [`run`] into a folder:
//!
//! ```text
//! table.csv        a row for each configuration: what it is, whether it settled, what was wanted; units in the header
//! table.parquet    the same
//! summary.csv      where commands or other variables are sampled, a row for each combination of the others: quantiles, workspace
//! study.json       what was run: version, seed, the study with its robots, times
//! report.html      figures that fit what varied, on one self-contained page
//! figures/*.svg    each of them as a picture
//! ```
//!
//! Row `i` is a function of the study and `i` alone: the table is the same for any number of threads, after any interruption,
//! and put together of parts ([`merge`]). Only a time on the clock (the output `cost`) differs from run to run.
//!
//! ```
//! use tdcr::pipeline::Silent;
//! use tdcr::study::{Study, run};
//!
//! let text = r#"
//!     robot = "2m"
//!     want = ["tip", "deflection"]
//!     vary = [{ what = "payload", range = [0.0, 0.03], steps = 4 }]
//! "#;
//! let here = std::path::Path::new("");
//! let study = Study::parse(text, here, here)?;
//! let folder = tempfile::tempdir()?;
//! let done = run(&study, folder.path(), None, &Silent)?;
//! assert_eq!((done.rows, done.settled), (4, 4));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod browse;
mod error;
mod figures;
mod outputs;
mod run;
mod spec;

pub use browse::{Configuration, RowError, Rows};
pub use error::{Refusal, StudyError};
pub use run::{Finished, merge, run};
pub use spec::{Column, Kind, Output, Starter, Study, Variable};
