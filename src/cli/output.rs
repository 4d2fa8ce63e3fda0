//! What `--out` names: a file of a format that is told by its extension, or a folder.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, bail};
use tdcr::base::files::write_atomically;

/// Extensions of files that people ask a program for. A folder of such a name is a mistake.
const FILES: [&str; 21] = [
    "avi",
    "csv",
    "gif",
    "h5",
    "hdf5",
    "html",
    "jpeg",
    "jpg",
    "json",
    "mp4",
    "npy",
    "npz",
    "obj",
    "pcd",
    "pdf",
    "ply",
    "png",
    "safetensors",
    "stl",
    "svg",
    "zip",
];

/// The format that a file's extension asks for, one of `formats`. A device or a pipe has none and takes the first.
///
/// Asked before the work is done, so that none is lost.
pub(super) fn format<'a>(
    option: &str,
    path: &Path,
    formats: &[&'a str],
) -> anyhow::Result<&'a str> {
    let special = std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir());
    let found = formats.iter().copied().find(|format| has(path, format));
    match found {
        Some(format) => Ok(format),
        None if special => Ok(formats[0]),
        None => bail!(
            "{option} {} is no file of a format that can be written; expected the extension .{}",
            path.display(),
            formats.join(" or .")
        ),
    }
}

/// Refuses a folder that is named like a file, unless it is there.
pub(super) fn folder(option: &str, path: &Path, what: &str) -> anyhow::Result<()> {
    if FILES.iter().any(|extension| has(path, extension)) && !path.is_dir() {
        bail!(
            "{option} {} is named like a file; expected {what}",
            path.display()
        );
    }
    Ok(())
}

fn has(path: &Path, extension: &str) -> bool {
    path.extension()
        .is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// Writes a file that is whole, or keeps what it held.
pub(super) fn write(path: &Path, bytes: impl AsRef<[u8]>) -> anyhow::Result<()> {
    write_atomically(path, |file| file.write_all(bytes.as_ref()))
        .with_context(|| format!("cannot write {}", path.display()))
}
