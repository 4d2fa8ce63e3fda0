//! Reading a shard, in which every byte may be wrong.

use std::path::{Path, PathBuf};

use hdf5_pure::{DType, Error, File, FormatError};

use super::DataError;
use super::shard::{Batch, Dataset, Sizes};

/// Deflate, the densest filter that is read, shrinks nothing further than this.
const MAX_COMPRESSION: u64 = 1032;

/// An open HDF5 file of samples whose arrays have the types and shapes of the layout.
pub(super) struct ShardFile {
    path: PathBuf,
    file: File,
    sizes: Sizes,
}

impl ShardFile {
    /// Opens `path` and checks that it holds `datasets`, each of the right type and shape.
    pub(super) fn open(path: &Path, datasets: &[Dataset]) -> Result<Self, DataError> {
        let file = File::open_streaming(path).map_err(|error| match error {
            Error::Io(error) => DataError::io("open", path)(error),
            error => unreadable(path, "the file", error),
        })?;
        let mut shard = Self {
            path: path.to_owned(),
            file,
            sizes: Sizes {
                samples: 0,
                points: 0,
                motors: 0,
            },
        };
        shard.sizes = shard.find_sizes()?;
        for &dataset in datasets {
            shard.check(dataset)?;
        }
        Ok(shard)
    }

    /// Number of samples, and their sizes, each at least 1.
    pub(super) fn sizes(&self) -> Sizes {
        self.sizes
    }

    /// Whether the file is as long as its header says.
    pub(super) fn is_whole(&self) -> bool {
        self.file.superblock().eof_address == self.file.file_size()
    }

    /// Reads the samples.
    pub(super) fn read_batch(&self) -> Result<Batch, DataError> {
        Ok(Batch {
            sizes: self.sizes,
            data: self.read_floats(Dataset::Data)?,
            rgb: self.read(Dataset::Rgb, hdf5_pure::Dataset::read_u8)?,
            motors: self.read_floats(Dataset::Motors)?,
        })
    }

    /// Reads an array of floats, all of which are finite.
    pub(super) fn read_floats(&self, dataset: Dataset) -> Result<Vec<f32>, DataError> {
        let values = self.read(dataset, hdf5_pure::Dataset::read_f32)?;
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(values),
            Some(position) => Err(DataError::NotFinite {
                path: self.path.clone(),
                dataset: dataset.name(),
                sample: position / (values.len() / self.sizes.samples),
                found: values[position],
            }),
        }
    }

    /// Refuses the shard unless `dataset` holds what `expected` says, row-major and as long as the array, up to
    /// `tolerance` in each value.
    pub(super) fn require_values(
        &self,
        dataset: Dataset,
        expected: &[f32],
        tolerance: f32,
    ) -> Result<(), DataError> {
        let values = self.read_floats(dataset)?;
        let differing =
            std::iter::zip(&values, expected).position(|(a, b)| (a - b).abs() > tolerance);
        match differing {
            None => Ok(()),
            Some(position) => Err(DataError::Disagrees {
                path: self.path.clone(),
                dataset: dataset.name(),
                sample: position / (values.len() / self.sizes.samples),
                expected: expected[position],
                found: values[position],
            }),
        }
    }

    fn find_sizes(&self) -> Result<Sizes, DataError> {
        let data = self.shape(Dataset::Data)?;
        let [samples, points, 3] = *data else {
            return Err(self.wrong_shape(
                Dataset::Data,
                Dataset::Data.symbolic_shape().to_owned(),
                data,
            ));
        };
        let motors_shape = self.shape(Dataset::Motors)?;
        let [_, motors] = *motors_shape else {
            return Err(self.wrong_shape(
                Dataset::Motors,
                Dataset::Motors.symbolic_shape().to_owned(),
                motors_shape,
            ));
        };
        for (dataset, size, shape) in [
            (Dataset::Data, samples.min(points), data),
            (Dataset::Motors, motors, motors_shape),
        ] {
            if size == 0 {
                return Err(self.wrong_shape(
                    dataset,
                    format!("{}, none 0", dataset.symbolic_shape()),
                    shape,
                ));
            }
            let file_bytes = self.file.file_size();
            let elements = shape
                .iter()
                .try_fold(1_u64, |product, &size| product.checked_mul(size));
            if elements.is_none_or(|elements| elements > file_bytes.saturating_mul(MAX_COMPRESSION))
            {
                return Err(DataError::TooLarge {
                    path: self.path.clone(),
                    dataset: dataset.name(),
                    found: shape,
                    file_bytes,
                });
            }
        }
        let size =
            |size: u64| usize::try_from(size).expect("it was found to be smaller than the file");
        Ok(Sizes {
            samples: size(samples),
            points: size(points),
            motors: size(motors),
        })
    }

    fn check(&self, dataset: Dataset) -> Result<(), DataError> {
        let (found, expected) = (self.shape(dataset)?, dataset.shape(self.sizes));
        if found != expected {
            return Err(self.wrong_shape(dataset, format!("{expected:?}"), found));
        }
        let found = self
            .find(dataset)?
            .dtype()
            .map_err(|error| self.unreadable(dataset, error))?;
        let (expected, fits) = match dataset {
            Dataset::Rgb => ("u8", found == DType::U8),
            _ => ("f32 or f64", matches!(found, DType::F32 | DType::F64)),
        };
        if !fits {
            return Err(DataError::WrongType {
                path: self.path.clone(),
                dataset: dataset.name(),
                expected,
                found: found.to_string(),
            });
        }
        Ok(())
    }

    fn find(&self, dataset: Dataset) -> Result<hdf5_pure::Dataset, DataError> {
        self.file
            .dataset(dataset.name())
            .map_err(|error| match error {
                Error::Format(FormatError::PathNotFound(_)) => DataError::MissingDataset {
                    path: self.path.clone(),
                    dataset: dataset.name(),
                    expected: dataset.symbolic_shape(),
                },
                error => self.unreadable(dataset, error),
            })
    }

    fn shape(&self, dataset: Dataset) -> Result<Vec<u64>, DataError> {
        self.find(dataset)?
            .shape()
            .map_err(|error| self.unreadable(dataset, error))
    }

    /// Reads an array whose shape has been checked.
    fn read<T>(
        &self,
        dataset: Dataset,
        read: impl FnOnce(&hdf5_pure::Dataset) -> Result<Vec<T>, Error>,
    ) -> Result<Vec<T>, DataError> {
        let values = read(&self.find(dataset)?).map_err(|error| self.unreadable(dataset, error))?;
        let expected: u64 = dataset.shape(self.sizes).iter().product();
        if values.len() as u64 != expected {
            let problem = format!("{} elements stored, {expected} by its shape", values.len());
            return Err(self.unreadable(dataset, problem));
        }
        Ok(values)
    }

    fn wrong_shape(&self, dataset: Dataset, expected: String, found: Vec<u64>) -> DataError {
        DataError::WrongShape {
            path: self.path.clone(),
            dataset: dataset.name(),
            expected,
            found,
        }
    }

    fn unreadable(&self, dataset: Dataset, reason: impl ToString) -> DataError {
        unreadable(
            &self.path,
            &format!("data set `{}`", dataset.name()),
            reason,
        )
    }
}

fn unreadable(path: &Path, what: &str, reason: impl ToString) -> DataError {
    DataError::Unreadable {
        path: path.to_owned(),
        what: what.to_owned(),
        reason: reason.to_string(),
    }
}
