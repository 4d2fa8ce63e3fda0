//! Folders that one process at a time writes to.

use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;

/// Takes the lock that the file `path` stands for, which is made if it is not there; held for as long as the returned file
/// is open. `None` while another process holds it, or another part of this one.
///
/// The file may stay when all is done: removed while another process waits to lock it, it would not keep a third out.
/// A file system without locks loses this protection and nothing else.
///
/// # Errors
/// Where the file cannot be made.
pub fn try_lock(path: &Path) -> io::Result<Option<File>> {
    let file = File::create(path)?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Ok(None),
        Ok(()) | Err(TryLockError::Error(_)) => Ok(Some(file)),
    }
}
