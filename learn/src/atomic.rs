//! Files that are either whole or not there.

use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Extension added to a file's name while it is being written.
pub(crate) const TEMPORARY: &str = "tmp";

/// Writes `path` through a temporary file beside it, which is flushed to the disk and then renamed: whenever the
/// process or the machine stops, `path` holds the old contents or the new, never a part. A failed write leaves no
/// temporary file behind, a killed one leaves it to be overwritten by the next.
///
/// Concurrent writers of one path must be kept apart by the caller.
pub(crate) fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut File) -> io::Result<()>,
) -> io::Result<()> {
    let temporary = path.with_added_extension(TEMPORARY);
    let written = File::create(&temporary).and_then(|mut file| {
        write(&mut file)?;
        file.sync_all()
    });
    written
        .and_then(|()| fs::rename(&temporary, path))
        .inspect_err(|_| drop(fs::remove_file(&temporary)))
}
