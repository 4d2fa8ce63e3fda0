//! What every crate of `tdcr` may use and none of them owns.
//!
//! Here is what has nothing to do with robots, clouds or servos: files that are whole or not there, reads that a hostile file
//! cannot make endless, folders that one process at a time writes to, rows of CSV, medians. The crate depends on none of the
//! others and on little else, so whatever needs one of these things takes it from here; it is never shown again by another
//! crate under a second name.
//!
//! ```
//! use std::io::Write;
//!
//! use tdcr_base::files::{LARGEST_TEXT, read_text, write_atomically};
//! use tdcr_base::lock::try_lock;
//! use tdcr_base::rows::Splitter;
//! use tdcr_base::stats::median;
//!
//! let folder = tempfile::tempdir()?;
//! let _lock = try_lock(&folder.path().join(".lock"))?.expect("nobody else writes here");
//!
//! // Whoever looks meanwhile, and whenever the process is killed: there is no file, or all of it.
//! let path = folder.path().join("times.csv");
//! write_atomically(&path, |file| writeln!(file, "name,time (ms)\nfirst,3\n\"second, again\",5"))?;
//!
//! // Only a regular file of at most so many bytes, without the byte order mark that it may begin with.
//! let text = read_text(&path, LARGEST_TEXT)?;
//! let mut splitter = Splitter::new(b',');
//! let rows: Vec<Vec<String>> = text.lines().skip(1).map(|line| splitter.cells(line)).collect();
//! assert_eq!(rows[1][0], "second, again");
//!
//! let mut times = rows.iter().map(|row| row[1].parse()).collect::<Result<Vec<f64>, _>>()?;
//! assert_eq!(median(&mut times), 4.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Modules
//!
//! - [`files`]: written whole or not at all; read where they are regular and of bounded size, as text without its mark; which
//!   table of a file has a field.
//! - [`limits`]: how much memory a file may ask for.
//! - [`lock`]: folders that one process at a time writes to.
//! - [`hash`]: what tells runs, sets and priors apart.
//! - [`Part`]: one of several parts that a large job is cut into.
//! - [`rows`]: the cells of a line of CSV.
//! - [`stats`]: quantiles and medians, of one definition.

pub mod files;
pub mod hash;
pub mod limits;
pub mod lock;
mod part;
pub mod rows;
pub mod stats;

pub use part::{InvalidPart, Part};
