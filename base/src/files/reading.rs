//! Reading files that a user or another file names by path.
//!
//! A path may lead to a device that never ends, to a pipe that never begins, or to a file larger than
//! the memory. So only regular files are read, and only up to a size.

use std::fs::{self, File, Metadata};
use std::io::{self, BufRead, ErrorKind, Read};
use std::path::Path;

/// Largest file of text that is read as a whole (bytes). The largest robot that `tdcr export` writes, 495 discs with 64 tendons
/// through each, takes a third of it.
pub const LARGEST_TEXT: u64 = 64 << 20;
/// Largest file of a mesh (bytes): 5 million triangles of binary STL.
pub const LARGEST_MESH: u64 = 256 << 20;
/// Largest file of clouds or weights that is read into memory as a whole (bytes).
pub const LARGEST_CLOUDS: u64 = 4 << 30;

/// The byte order mark of UTF-8, with which editors of Windows and spreadsheets begin a text.
const MARK: char = '\u{feff}';
/// Those of UTF-16, which PowerShell writes unless it is told otherwise.
const UTF_16: [[u8; 2]; 2] = [[0xff, 0xfe], [0xfe, 0xff]];

/// What the operating system says of a regular file.
///
/// Asked before it is opened: opening a pipe waits for its writer.
///
/// # Errors
/// The operating system's, or that a device, a pipe or a folder was found in its place.
pub fn regular(path: &Path) -> io::Result<Metadata> {
    let found = fs::metadata(path)?;
    match found.is_file() {
        true => Ok(found),
        false => {
            let reason = "not a regular file; expected one, no device, pipe or folder";
            Err(io::Error::new(ErrorKind::InvalidInput, reason))
        }
    }
}

/// Opens a regular file, to be read piece by piece.
///
/// # Errors
/// As [`regular`]'s.
pub fn open(path: &Path) -> io::Result<File> {
    regular(path)?;
    File::open(path)
}

/// The contents of a regular file of at most `largest` bytes.
///
/// # Errors
/// As [`regular`]'s, or that the file is larger.
pub fn read(path: &Path, largest: u64) -> io::Result<Vec<u8>> {
    let length = regular(path)?.len();
    // The file may grow meanwhile, and some of /proc say a length of 0.
    let mut bytes = Vec::new();
    if length <= largest {
        // One byte more tells that the file has ended.
        bytes.reserve_exact(length as usize + 1);
        File::open(path)?
            .take(largest + 1)
            .read_to_end(&mut bytes)?;
    }
    let found = length.max(bytes.len() as u64);
    if found > largest {
        let reason = format!("{found} bytes; expected at most {largest}");
        return Err(io::Error::new(ErrorKind::FileTooLarge, reason));
    }
    Ok(bytes)
}

/// The text of a regular file of at most `largest` bytes, without the byte order mark that it may begin with.
///
/// # Errors
/// As [`read`]'s, or that it is not UTF-8.
pub fn read_text(path: &Path, largest: u64) -> io::Result<String> {
    text_of(read(path, largest)?)
}

/// The text in the bytes of a file, without the byte order mark that it may begin with.
///
/// # Errors
/// That it is not UTF-8.
pub fn text_of(bytes: Vec<u8>) -> io::Result<String> {
    let invalid = |reason| io::Error::new(ErrorKind::InvalidData, reason);
    if UTF_16.iter().any(|mark| bytes.starts_with(mark)) {
        return Err(invalid("UTF-16 text; expected UTF-8: save the file so"));
    }
    let mut text = String::from_utf8(bytes).map_err(|_| invalid("not UTF-8 text"))?;
    let mark = text.len() - without_mark(&text).len();
    text.replace_range(..mark, "");
    Ok(text)
}

/// A text without the byte order mark that it may begin with.
pub fn without_mark(text: &str) -> &str {
    text.strip_prefix(MARK).unwrap_or(text)
}

/// The same of bytes, of which only some are text.
pub fn bytes_without_mark(bytes: &[u8]) -> &[u8] {
    let mut mark = [0; MARK.len_utf8()];
    let mark = MARK.encode_utf8(&mut mark).as_bytes();
    bytes.strip_prefix(mark).unwrap_or(bytes)
}

/// Reads the next line, with its end, into `line`, which is emptied first; returns its length (bytes), 0 after the last one.
///
/// # Errors
/// Those of `source`; that a line is longer than [`LARGEST_TEXT`], or not UTF-8.
pub fn read_line(source: &mut impl BufRead, line: &mut String) -> io::Result<usize> {
    line.clear();
    let length = source.by_ref().take(LARGEST_TEXT).read_line(line)?;
    if length as u64 == LARGEST_TEXT && !line.ends_with('\n') {
        let reason = format!("a line of more than {LARGEST_TEXT} bytes");
        return Err(io::Error::new(ErrorKind::FileTooLarge, reason));
    }
    Ok(length)
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
            let opened = open(special).expect_err("refused");
            assert!(opened.to_string().contains("not a regular file"));
        }
    }

    #[test]
    fn a_text_is_read_without_its_mark_and_utf_16_is_refused_by_name() {
        let text = |bytes: &[u8]| text_of(bytes.to_vec());
        assert_eq!(text("\u{feff}[1]".as_bytes()).expect("text"), "[1]");
        assert_eq!(text(b"").expect("text"), "");
        let said = |bytes: &[u8]| text(bytes).expect_err("refused").to_string();
        assert!(said(b"\xff\xfe[\0").contains("UTF-16"));
        assert!(said(b"\xfe\xff\0[").contains("UTF-16"));
        assert_eq!(said(b"a\xff"), "not UTF-8 text");
    }

    #[test]
    fn a_line_without_an_end_is_read_no_further_than_its_limit() {
        let mut source = io::BufReader::new(&b"one\ntwo"[..]);
        let mut line = String::new();
        assert_eq!(read_line(&mut source, &mut line).expect("a line"), 4);
        assert_eq!(read_line(&mut source, &mut line).expect("a line"), 3);
        assert_eq!(line, "two");
        assert_eq!(read_line(&mut source, &mut line).expect("an end"), 0);
        let mut endless = io::BufReader::new(io::repeat(b'0'));
        let refused = read_line(&mut endless, &mut line).expect_err("endless");
        assert_eq!(refused.kind(), ErrorKind::FileTooLarge);
    }
}
