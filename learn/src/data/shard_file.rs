//! Reading a shard, in which every byte may be wrong.

use std::ops::Range;
use std::path::{Path, PathBuf};

use hdf5_pure::{DType, Error, File, FormatError};
use tdcr_base::files;
use tdcr_base::limits;

use super::DataError;
use super::hdf5_error::reason;
use super::shard::{Array, Batch, Sizes};

/// Bytes of memory for what the HDF5 reader keeps of a chunk, stored or not, however small it is.
const CHUNK_ENTRY: u64 = 128;

/// An open HDF5 file of samples whose arrays have the types and shapes of the layout.
pub(super) struct ShardFile {
    path: PathBuf,
    file: File,
    sizes: Sizes,
}

impl ShardFile {
    /// Opens `path` and checks that it holds `arrays`, each of the right type and shape, and so the payloads if there
    /// are any.
    pub(super) fn open(path: &Path, arrays: &[Array]) -> Result<Self, DataError> {
        files::regular(path).map_err(DataError::io("open", path))?;
        let file = File::open_streaming(path).map_err(|error| match error {
            Error::Io(error) => DataError::io("open", path)(error),
            error => unreadable(path, "the file", reason(&error)),
        })?;
        let (length, header_length) = (file.file_size(), file.superblock().eof_address);
        if length < header_length {
            let reason = format!("truncated to {length} of {header_length} bytes");
            return Err(unreadable(path, "the file", reason));
        }
        let mut shard = Self {
            path: path.to_owned(),
            file,
            sizes: Sizes {
                samples: 0,
                points: 0,
                values: 0,
                payload: false,
            },
        };
        shard.sizes = shard.find_sizes()?;
        let payload = shard.sizes.payload.then_some(Array::Payload);
        let mut asked = 0_u64;
        for &array in arrays.iter().chain(&payload) {
            shard.check(array)?;
            shard.check_chunks(array)?;
            let shape = array.shape(shard.sizes);
            asked = asked.saturating_add(limits::bytes(&shape, array.element_size()));
            shard.require_warranted(array, &shape, asked)?;
        }
        Ok(shard)
    }

    /// Number of samples, and their sizes, each at least 1.
    pub(super) fn sizes(&self) -> Sizes {
        self.sizes
    }

    /// Reads the samples.
    pub(super) fn read_batch(&self) -> Result<Batch, DataError> {
        let batch = Batch {
            sizes: self.sizes,
            data: self.read_floats(Array::Data)?,
            rgb: self.read_colors()?,
            motors: self.read_floats(Array::Motors)?,
        };
        self.require_payloads(&batch.payloads())?;
        Ok(batch)
    }

    /// Reads some of the samples.
    pub(super) fn read_rows(&self, rows: Range<usize>) -> Result<Batch, DataError> {
        let sizes = Sizes {
            samples: rows.len(),
            ..self.sizes
        };
        let (start, count) = (rows.start as u64, rows.len() as u64);
        let floats = |array| {
            let values = self.read(array, sizes, |stored| stored.read_f32_rows(start, count))?;
            self.require_finite(array, rows.start, sizes, values)
        };
        Ok(Batch {
            sizes,
            data: floats(Array::Data)?,
            rgb: self.read(Array::Rgb, sizes, |stored| {
                stored.read_u8_rows(start, count)
            })?,
            motors: floats(Array::Motors)?,
        })
    }

    /// Reads the colours.
    pub(super) fn read_colors(&self) -> Result<Vec<u8>, DataError> {
        self.read(Array::Rgb, self.sizes, hdf5_pure::Dataset::read_u8)
    }

    /// Reads an array of floats, all of which are finite.
    pub(super) fn read_floats(&self, array: Array) -> Result<Vec<f32>, DataError> {
        let values = self.read(array, self.sizes, hdf5_pure::Dataset::read_f32)?;
        self.require_finite(array, 0, self.sizes, values)
    }

    /// Hands on the values of samples from `first` on, if all are finite.
    fn require_finite(
        &self,
        array: Array,
        first: usize,
        sizes: Sizes,
        values: Vec<f32>,
    ) -> Result<Vec<f32>, DataError> {
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(values),
            Some(position) => Err(DataError::NotFinite {
                path: self.path.clone(),
                dataset: array.name(),
                sample: first + position / (values.len() / sizes.samples),
                found: values[position],
            }),
        }
    }

    /// Refuses the shard unless `array` holds what `expected` says, row-major and as long as the array, up to
    /// `tolerance` in each value.
    pub(super) fn require_values(
        &self,
        array: Array,
        expected: &[f32],
        tolerance: f32,
    ) -> Result<(), DataError> {
        let values = self.read_floats(array)?;
        let differing =
            std::iter::zip(&values, expected).position(|(a, b)| (a - b).abs() > tolerance);
        match differing {
            None => Ok(()),
            Some(position) => Err(DataError::Disagrees {
                path: self.path.clone(),
                dataset: array.name(),
                sample: position / (values.len() / self.sizes.samples),
                expected: expected[position],
                found: values[position],
            }),
        }
    }

    /// Refuses the shard if it holds payloads other than these.
    pub(super) fn require_payloads(&self, expected: &[f32]) -> Result<(), DataError> {
        if self.sizes.payload {
            self.require_values(Array::Payload, expected, 0.0)?;
        }
        Ok(())
    }

    fn find_sizes(&self) -> Result<Sizes, DataError> {
        let data = self.shape(Array::Data)?;
        let [samples, points, 3] = *data else {
            return Err(self.wrong_shape(
                Array::Data,
                Array::Data.symbolic_shape().to_owned(),
                data,
            ));
        };
        let motors_shape = self.shape(Array::Motors)?;
        let [_, values] = *motors_shape else {
            return Err(self.wrong_shape(
                Array::Motors,
                Array::Motors.symbolic_shape().to_owned(),
                motors_shape,
            ));
        };
        for (array, size, shape) in [
            (Array::Data, samples.min(points), data),
            (Array::Motors, values, motors_shape),
        ] {
            if size == 0 {
                return Err(self.wrong_shape(
                    array,
                    format!("{}, none 0", array.symbolic_shape()),
                    shape,
                ));
            }
            self.require_warranted(array, &shape, limits::bytes(&shape, array.element_size()))?;
        }
        let size =
            |size: u64| usize::try_from(size).expect("an array within the limit is addressable");
        Ok(Sizes {
            samples: size(samples),
            points: size(points),
            values: size(values),
            payload: self.file.dataset(Array::Payload.name()).is_ok(),
        })
    }

    /// Refuses an array, or a chunk of one, with which reading asks for `asked` bytes of memory in all, more than the
    /// length of the file warrants: chunks that are compressed or not stored take no place in it.
    fn require_warranted(&self, array: Array, shape: &[u64], asked: u64) -> Result<(), DataError> {
        limits::require(asked, self.file.file_size()).map_err(|source| DataError::TooLarge {
            path: self.path.clone(),
            dataset: array.name(),
            found: shape.to_vec(),
            source,
        })
    }

    /// Checks an array's shape and element type.
    fn check(&self, array: Array) -> Result<(), DataError> {
        let stored = self.find(array)?;
        let unreadable = |error| self.unreadable(array, error);
        let (found, expected) = (stored.shape().map_err(unreadable)?, array.shape(self.sizes));
        if found != expected {
            return Err(self.wrong_shape(array, format!("{expected:?}"), found));
        }
        let found = stored.dtype().map_err(unreadable)?;
        let (expected, fits) = match array {
            Array::Rgb => ("u8", found == DType::U8),
            _ => ("f32 or f64", matches!(found, DType::F32 | DType::F64)),
        };
        if !fits {
            return Err(DataError::WrongType {
                path: self.path.clone(),
                dataset: array.name(),
                expected,
                found: found.to_string(),
            });
        }
        Ok(())
    }

    /// Checks that the chunks of an array, if it is chunked, fit into the file.
    fn check_chunks(&self, array: Array) -> Result<(), DataError> {
        let stored = self.find(array)?;
        let unreadable = |error| self.unreadable(array, error);
        let Some(chunk_shape) = stored.chunk_shape().map_err(unreadable)? else {
            return Ok(());
        };
        let asked = limits::bytes(&chunk_shape, array.element_size());
        self.require_warranted(array, &chunk_shape, asked)?;
        let shape = array.shape(self.sizes);
        let grid = std::iter::zip(&shape, &chunk_shape)
            .map(|(size, chunk)| size.div_ceil((*chunk).max(1)));
        let asked = limits::bytes(&grid.collect::<Vec<_>>(), CHUNK_ENTRY);
        self.require_warranted(array, &shape, asked)?;
        let file_bytes = self.file.file_size();
        let chunks = stored.chunks().map_err(unreadable)?;
        match chunks.iter().find(|chunk| chunk.storage_size > file_bytes) {
            None => Ok(()),
            Some(chunk) => {
                let size = chunk.storage_size;
                let reason = format!("a chunk of {size} bytes in a file of {file_bytes}");
                Err(self.damaged(array, reason))
            }
        }
    }

    fn find(&self, array: Array) -> Result<hdf5_pure::Dataset, DataError> {
        self.file
            .dataset(array.name())
            .map_err(|error| match error {
                Error::Format(FormatError::PathNotFound(_)) => DataError::MissingDataset {
                    path: self.path.clone(),
                    dataset: array.name(),
                    expected: array.symbolic_shape(),
                },
                error => self.unreadable(array, error),
            })
    }

    fn shape(&self, array: Array) -> Result<Vec<u64>, DataError> {
        self.find(array)?
            .shape()
            .map_err(|error| self.unreadable(array, error))
    }

    /// Reads as much of an array whose shape has been checked as there is for `sizes`.
    fn read<T>(
        &self,
        array: Array,
        sizes: Sizes,
        read: impl FnOnce(&hdf5_pure::Dataset) -> Result<Vec<T>, Error>,
    ) -> Result<Vec<T>, DataError> {
        let values = read(&self.find(array)?).map_err(|error| self.unreadable(array, error))?;
        let expected: u64 = array.shape(sizes).iter().product();
        if values.len() as u64 != expected {
            let problem = format!("{} elements stored, {expected} by its shape", values.len());
            return Err(self.damaged(array, problem));
        }
        Ok(values)
    }

    fn wrong_shape(&self, array: Array, expected: String, found: Vec<u64>) -> DataError {
        DataError::WrongShape {
            path: self.path.clone(),
            dataset: array.name(),
            expected,
            found,
        }
    }

    fn unreadable(&self, array: Array, error: Error) -> DataError {
        self.damaged(array, reason(&error))
    }

    fn damaged(&self, array: Array, reason: String) -> DataError {
        unreadable(&self.path, &format!("dataset `{}`", array.name()), reason)
    }
}

fn unreadable(path: &Path, what: &str, reason: String) -> DataError {
    DataError::Unreadable {
        path: path.to_owned(),
        what: what.to_owned(),
        reason,
    }
}
