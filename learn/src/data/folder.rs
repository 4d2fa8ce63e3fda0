//! Folders: what is in them, and taking it out again.

use std::fs;
use std::io;
use std::path::Path;

use super::DataError;

/// Folder of the blocks, inside the data set's.
pub(super) const STAGING: &str = ".partial";

/// Name of the first entry of `dir`, in name order, that is not `known`; none where there is no such folder.
pub(super) fn foreign_entry(dir: &Path, known: &[String]) -> Result<Option<String>, DataError> {
    let entries = match fs::read_dir(dir) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        entries => entries.map_err(DataError::io("list", dir))?,
    };
    let mut foreign = vec![];
    for entry in entries {
        let name = entry.map_err(DataError::io("list", dir))?.file_name();
        foreign.push(name.to_string_lossy().into_owned());
    }
    foreign.retain(|name| !known.contains(name));
    Ok(foreign.into_iter().min())
}

/// Removes a file; nothing where there is none.
pub(super) fn remove_file(path: &Path) -> Result<(), DataError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(DataError::io("remove", path)(error))
        }
        _ => Ok(()),
    }
}

/// Removes a folder and all that is in it; nothing where there is none.
pub(super) fn remove_folder(dir: &Path) -> Result<(), DataError> {
    match fs::remove_dir_all(dir) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(DataError::io("remove", dir)(error))
        }
        _ => Ok(()),
    }
}
