//! The readers that the targets run: those of `tests/readers`.

#[path = "../../tests/readers/readers.rs"]
pub mod readers;
