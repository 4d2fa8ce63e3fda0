//! Files: written whole or not at all, read only where they are regular and of bounded size.

mod atomic;
mod reading;

pub use atomic::{AtomicFile, TEMPORARY, write_atomically};
pub(crate) use reading::{LARGEST_MESH, LARGEST_TEXT, read, read_text};
