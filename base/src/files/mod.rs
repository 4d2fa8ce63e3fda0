//! Files: written whole or not at all, read only where they are regular and of bounded size.
//!
//! A file is written under another name, flushed and renamed, so a stage may be killed at any time, and a full disk leaves what
//! was there.

mod atomic;
mod reading;
mod tables;

pub use atomic::{AtomicFile, TEMPORARY, write_atomically};
pub use reading::{
    LARGEST_CLOUDS, LARGEST_MESH, LARGEST_TEXT, bytes_without_mark, open, read, read_line,
    read_text, regular, text_of, without_mark,
};
pub use tables::{Table, with_place};
