//! Files that are either whole or not there.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Extension added to a file's name while it is being written.
pub const TEMPORARY: &str = "tmp";

/// A file that is written aside and takes its place, and its name, when it is whole.
///
/// Until [`commit`](Self::commit), the path keeps what it holds. Dropped before, the new contents are removed. A killed
/// process leaves them in a file with the extension [`TEMPORARY`] added, which the next writer of the path overwrites.
/// A link is followed. A device or a pipe has no contents to keep, and is written directly.
///
/// Concurrent writers of one path must be kept apart by the caller.
#[derive(Debug)]
pub struct AtomicFile {
    file: File,
    aside: Option<Aside>,
}

/// Where the contents are, and where they belong.
#[derive(Debug)]
struct Aside {
    temporary: PathBuf,
    path: PathBuf,
}

impl AtomicFile {
    /// Opens a file beside `path`.
    ///
    /// # Errors
    /// What the operating system says; [`PermissionDenied`](io::ErrorKind::PermissionDenied) for a path that holds a
    /// write-protected file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let existing = fs::metadata(path).ok();
        if existing.as_ref().is_some_and(|found| !found.is_file()) {
            let file = File::options().write(true).open(path)?;
            return Ok(Self { file, aside: None });
        }
        let permissions = existing.map(|found| found.permissions());
        if permissions.as_ref().is_some_and(fs::Permissions::readonly) {
            return Err(io::ErrorKind::PermissionDenied.into());
        }
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let temporary = path.with_added_extension(TEMPORARY);
        let opened = Self {
            file: File::create(&temporary)?,
            aside: Some(Aside { temporary, path }),
        };
        if let Some(permissions) = permissions {
            opened.file.set_permissions(permissions)?;
        }
        Ok(opened)
    }

    /// Brings the contents to the disk and puts them in their place.
    ///
    /// # Errors
    /// What the operating system says; the path then holds what it held before.
    pub fn commit(mut self) -> io::Result<()> {
        let Some(Aside { temporary, path }) = &self.aside else {
            return Ok(());
        };
        self.file.sync_all()?;
        fs::rename(temporary, path)?;
        self.aside = None;
        Ok(())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if let Some(aside) = &self.aside {
            // Nobody is left to tell; the file's name says that it is not whole.
            drop(fs::remove_file(&aside.temporary));
        }
    }
}

/// Writes `path` as an [`AtomicFile`]: whenever the process or the machine stops, it holds the old contents or the new,
/// never a part.
///
/// # Errors
/// Those of `write`, and of [`AtomicFile`].
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut File) -> io::Result<()>,
) -> io::Result<()> {
    let mut new = AtomicFile::create(path)?;
    write(&mut new.file)?;
    new.commit()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort_unstable();
        names
    }

    #[test]
    fn a_file_that_is_not_finished_leaves_the_old_one_and_nothing_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("result.csv");
        fs::write(&path, "old").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"half of the n").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"old");
        drop(file);
        let full = |file: &mut File| {
            file.write_all(b"new")
                .and(Err(io::ErrorKind::StorageFull.into()))
        };
        assert!(write_atomically(&path, full).is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["result.csv"]);
        write_atomically(&path, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["result.csv"]);
    }

    #[cfg(unix)]
    #[test]
    fn links_devices_and_permissions_stay_what_they_are() {
        use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let [real, link] = ["real", "link"].map(|name| folder.path().join(name));
        fs::write(&real, "old").unwrap();
        fs::set_permissions(&real, fs::Permissions::from_mode(0o640)).unwrap();
        symlink(&real, &link).unwrap();
        write_atomically(&link, |file| file.write_all(b"new")).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&real).unwrap(), b"new");
        assert_eq!(
            fs::metadata(&real).unwrap().permissions().mode() & 0o777,
            0o640
        );
        fs::set_permissions(&real, fs::Permissions::from_mode(0o440)).unwrap();
        let refused = write_atomically(&real, |file| file.write_all(b"newer"));
        assert_eq!(refused.unwrap_err().kind(), io::ErrorKind::PermissionDenied);
        assert_eq!(fs::read(&real).unwrap(), b"new");
        let null = Path::new("/dev/null");
        write_atomically(null, |file| file.write_all(b"nothing")).unwrap();
        assert!(fs::metadata(null).unwrap().file_type().is_char_device());
        assert!(write_atomically(folder.path(), |_| Ok(())).is_err());
    }
}
