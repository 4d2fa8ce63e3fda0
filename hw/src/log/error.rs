//! Why logs are not written or read.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

/// Why a log could not be written, or read at all.
#[derive(Debug, Error)]
pub enum LogError {
    /// The file.
    #[error("{}: {source}", path.display())]
    File {
        /// Its path.
        path: PathBuf,
        /// What the operating system says.
        source: io::Error,
    },
    /// Nothing of an MCAP file is in it.
    #[error(
        "{} is not a log: it neither begins as an MCAP file nor has a part of one in it",
        path.display()
    )]
    NotALog {
        /// Its path.
        path: PathBuf,
    },
    /// Its messages are compressed in a way that is not read.
    #[error(
        "{}: a chunk is compressed by `{compression}`, expected zstd, lz4 or none",
        path.display()
    )]
    Compressed {
        /// The log.
        path: PathBuf,
        /// How it is compressed.
        compression: String,
    },
    /// The container. After a failure to write, nothing more is written.
    #[error("the log cannot be written: {source}")]
    Write {
        /// What its writer says.
        source: mcap::McapError,
    },
    /// The disk has little room left, which others need more.
    #[error(
        "{:.1} MB are free on its disk, {:.1} MB of them for what is worth more", *free as f64 / 1e6, *reserve as f64 / 1e6
    )]
    Room {
        /// Bytes that are free.
        free: u64,
        /// Bytes that it leaves.
        reserve: u64,
    },
    /// A record that a log cannot hold.
    #[error("{record} cannot be logged: {problem}")]
    Record {
        /// What record.
        record: &'static str,
        /// Why.
        problem: String,
    },
}

/// Why a message of one of our topics could not be understood.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum DecodeError {
    /// Another kind of message than the topic's.
    #[error("messages of {topic} are of schema `{found}`; expected `{expected}`")]
    Schema {
        /// Name of the topic.
        topic: String,
        /// Its schema in the log.
        found: String,
        /// What we know there.
        expected: &'static str,
    },
    /// Bytes that are not a message of the schema.
    #[error("the message is damaged: {0}")]
    Bytes(String),
    /// A value that makes no sense.
    #[error("the message's field `{field}` has {found}; expected {expected}")]
    Field {
        /// Name of the field.
        field: &'static str,
        /// What it has.
        found: String,
        /// What it should have.
        expected: &'static str,
    },
}
