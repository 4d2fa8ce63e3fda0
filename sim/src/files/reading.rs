//! Reading files that a user or another file names by path.
//!
//! A path may lead to a device that never ends, to a pipe that never begins, or to a file larger than
//! the memory. So only regular files are read, and only up to a size.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// Largest text of a robot (bytes). The largest that `tdcr export` writes, 495 discs with 64 tendons
/// through each, takes a third of it.
pub(crate) const LARGEST_TEXT: u64 = 64 << 20;
/// Largest file of a mesh (bytes): 5 million triangles of binary STL.
pub(crate) const LARGEST_MESH: u64 = 256 << 20;

/// The contents of a regular file of at most `largest` bytes.
///
/// # Errors
/// The operating system's, or what was found in its place.
pub fn read(path: &Path, largest: u64) -> io::Result<Vec<u8>> {
    // Asked before opening: opening a pipe waits for its writer.
    let found = fs::metadata(path)?;
    if !found.is_file() {
        let reason = "not a regular file; expected one, no device, pipe or folder";
        return Err(io::Error::new(ErrorKind::InvalidInput, reason));
    }
    // The file may grow meanwhile, and some of /proc say a length of 0.
    let mut bytes = Vec::new();
    if found.len() <= largest {
        File::open(path)?
            .take(largest + 1)
            .read_to_end(&mut bytes)?;
    }
    if found.len() > largest || bytes.len() as u64 > largest {
        let found = found.len().max(bytes.len() as u64);
        let reason = format!("{found} bytes; expected at most {largest}");
        return Err(io::Error::new(ErrorKind::FileTooLarge, reason));
    }
    Ok(bytes)
}

/// The text of a regular file of at most `largest` bytes.
///
/// # Errors
/// As [`read`]'s, or that it is not UTF-8.
pub fn read_text(path: &Path, largest: u64) -> io::Result<String> {
    String::from_utf8(read(path, largest)?).map_err(|_| {
        let reason = "not UTF-8 text";
        io::Error::new(ErrorKind::InvalidData, reason)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_a_bounded_size_are_read() {
        let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
        let length = fs::metadata(&own).expect("there").len();
        assert_eq!(read(&own, length).expect("small").len() as u64, length);
        let said = |path: &Path, largest| read(path, largest).expect_err("refused").to_string();
        let expected = format!("{length} bytes; expected at most {}", length - 1);
        assert_eq!(said(&own, length - 1), expected);
        for special in [Path::new("/dev/zero"), Path::new("/")] {
            assert!(said(special, 10).contains("not a regular file"));
        }
    }
}
