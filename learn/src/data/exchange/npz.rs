//! Writing NPZ files.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

use tdcr_base::files::write_atomically;

use super::npy::{header, write_archive};
use super::{CloudFileError, Fault};

/// An array of an NPZ file, or a row of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NpzArray<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its shape.
    pub shape: &'a [usize],
    /// Its values, row-major.
    pub values: NpzValues<'a>,
}

/// Values of an array.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum NpzValues<'a> {
    /// `float32`.
    Floats(&'a [f32]),
    /// `uint8`.
    Bytes(&'a [u8]),
    /// One text, `str`, of an array without dimensions.
    Text(&'a str),
}

impl NpzArray<'_> {
    /// NumPy's name of the type of its values.
    fn descr(&self) -> String {
        match self.values {
            NpzValues::Floats(_) => "<f4".to_owned(),
            NpzValues::Bytes(_) => "|u1".to_owned(),
            NpzValues::Text(text) => format!("<U{}", text.chars().count()),
        }
    }

    /// A file of it alone.
    fn npy(&self) -> Result<Vec<u8>, Fault> {
        Ok([header(self.shape, &self.descr()), self.data()?].concat())
    }

    /// Its values as a file holds them, of which there must be as many as its shape says.
    fn data(&self) -> Result<Vec<u8>, Fault> {
        let (count, data) = match self.values {
            NpzValues::Floats(values) => {
                let data = values.iter().flat_map(|x| x.to_le_bytes()).collect();
                (values.len(), data)
            }
            NpzValues::Bytes(values) => (values.len(), values.to_vec()),
            NpzValues::Text(text) => {
                let letters = text.chars().flat_map(|c| u32::from(c).to_le_bytes());
                (1, letters.collect())
            }
        };
        let expected: usize = self.shape.iter().product();
        if count != expected {
            let problem = format!(
                "{count} values, expected {expected} as {:?} says",
                self.shape
            );
            return Err(self.fault(problem));
        }
        Ok(data)
    }

    fn fault(&self, problem: impl ToString) -> Fault {
        Fault::new(format!("array `{}`", self.name), problem)
    }
}

/// Writes an array to an NPY file, whole or not at all; such a file has no place for its name.
///
/// # Errors
/// As [`write_npz`].
pub fn write_npy(path: &Path, array: &NpzArray) -> Result<(), CloudFileError> {
    let written = array.npy().and_then(|npy| {
        write_atomically(path, |file| file.write_all(&npy))
            .map_err(|error| Fault::new("file", error))
    });
    written.map_err(|fault| fault.at(path))
}

/// Writes arrays to an NPZ file, whole or not at all.
///
/// # Errors
/// [`CloudFileError`] where the file cannot be written, or an array has not as many values as its shape says.
pub fn write_npz(path: &Path, arrays: &[NpzArray]) -> Result<(), CloudFileError> {
    let files = arrays
        .iter()
        .map(|array| Ok((array.name.to_owned(), array.npy()?)));
    let written = files.collect::<Result<Vec<_>, Fault>>().and_then(|files| {
        let files = (files.iter()).map(|(name, npy)| (name.clone(), npy.len() as u64, &npy[..]));
        write_atomically(path, |file| write_archive(file, files))
            .map_err(|error| Fault::new("file", error))
    });
    written.map_err(|fault| fault.at(path))
}

/// Writes an NPZ file of arrays that come row by row, in constant memory.
///
/// An archive holds one array after another, so rows wait in temporary files in the folder of the archive. They have no
/// names: however the process ends, nothing of them is left.
#[derive(Debug)]
pub struct NpzRows {
    path: PathBuf,
    rows: usize,
    arrays: Vec<Rows>,
}

/// The rows of one array.
#[derive(Debug)]
struct Rows {
    name: String,
    shape: Vec<usize>,
    descr: String,
    count: usize,
    data: File,
}

impl NpzRows {
    /// No rows yet of the file `path`, which is not touched before [`finish`](Self::finish).
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            rows: 0,
            arrays: Vec::new(),
        }
    }

    /// Takes the next row of each array: its shape is that of the array without the first dimension.
    ///
    /// # Errors
    /// [`CloudFileError`] where the row cannot be kept, has not as many values as its shape says, or not the shape and
    /// type of the rows before.
    pub fn push(&mut self, row: &[NpzArray]) -> Result<(), CloudFileError> {
        let pushed = row.iter().try_for_each(|array| self.push_to_array(array));
        self.rows += 1;
        pushed.map_err(|fault| fault.at(&self.path))
    }

    fn push_to_array(&mut self, row: &NpzArray) -> Result<(), Fault> {
        let place = match self.arrays.iter().position(|rows| rows.name == row.name) {
            Some(place) => place,
            None => {
                let folder = self.path.parent().filter(|dir| !dir.as_os_str().is_empty());
                let data = tempfile::tempfile_in(folder.unwrap_or(Path::new(".")));
                self.arrays.push(Rows {
                    name: row.name.to_owned(),
                    shape: row.shape.to_vec(),
                    descr: row.descr(),
                    count: 0,
                    data: data.map_err(|error| Fault::new("temporary file", error))?,
                });
                self.arrays.len() - 1
            }
        };
        let rows = &mut self.arrays[place];
        if (&rows.shape[..], &rows.descr) != (row.shape, &row.descr()) {
            let problem = format!(
                "a row of shape {:?} and type `{}`, expected {:?} and `{}` as before",
                row.shape,
                row.descr(),
                rows.shape,
                rows.descr
            );
            return Err(row.fault(problem));
        }
        let written = rows.data.write_all(&row.data()?);
        written.map_err(|error| Fault::new("temporary file", error))?;
        rows.count += 1;
        Ok(())
    }

    /// Writes the file, whole or not at all, of the arrays that every row has a part of.
    ///
    /// # Errors
    /// [`CloudFileError`] where it cannot be written.
    pub fn finish(self) -> Result<(), CloudFileError> {
        let Self { path, rows, arrays } = self;
        let whole = arrays.into_iter().filter(|array| array.count == rows);
        let files = whole.map(|mut array| {
            let header = header(&[&[rows], &array.shape[..]].concat(), &array.descr);
            let size = header.len() as u64 + array.data.stream_position()?;
            array.data.rewind()?;
            Ok((
                array.name,
                size,
                std::io::Cursor::new(header).chain(array.data),
            ))
        });
        files
            .collect::<std::io::Result<Vec<_>>>()
            .and_then(|files| write_atomically(&path, |file| write_archive(file, files)))
            .map_err(|error| Fault::new("file", error).at(&path))
    }
}
