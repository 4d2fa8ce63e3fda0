//! Files: written whole or not at all, read only where they are regular and of bounded size.
//!
//! A file is written under another name, flushed and renamed, so a stage may be killed at any time, and a full disk leaves what
//! was there.

mod atomic;
mod reading;

pub use atomic::{AtomicFile, TEMPORARY, write_atomically};
pub(crate) use reading::{LARGEST_MESH, LARGEST_TEXT};
pub use reading::{read, read_text};
