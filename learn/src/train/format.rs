//! The file format: safetensors, with a JSON header under the metadata key `tdcr`.

use std::borrow::Cow;
use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, View};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use tdcr_base::files::LARGEST_CLOUDS;
use tdcr_base::files::{self, write_atomically};

use super::error::{FileError, FileProblem};

/// Version of the format that this crate reads and writes.
const VERSION: u32 = 2;

/// Metadata key of the header.
const KEY: &str = "tdcr";

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Model,
    TrainingState,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Model => "model",
            Self::TrainingState => "training state",
        }
    }
}

/// A number that a tensor can hold.
pub(super) trait Element: Copy {
    const DTYPE: Dtype;
    fn append_le_bytes(self, bytes: &mut Vec<u8>);
    fn from_le_bytes(bytes: &[u8]) -> Self;
    fn as_f64(self) -> f64;
}

macro_rules! element {
    ($number:ty, $dtype:expr) => {
        impl Element for $number {
            const DTYPE: Dtype = $dtype;

            fn append_le_bytes(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }

            fn from_le_bytes(bytes: &[u8]) -> Self {
                Self::from_le_bytes(bytes.try_into().expect("the caller cuts whole numbers"))
            }

            fn as_f64(self) -> f64 {
                self as f64
            }
        }
    };
}

element!(f32, Dtype::F32);
element!(f64, Dtype::F64);
element!(u64, Dtype::U64);

/// A tensor to be written.
struct Tensor {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl View for Tensor {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

/// Collects tensors and writes them to a file.
pub(super) struct Writer {
    kind: Kind,
    tensors: Vec<(String, Tensor)>,
}

impl Writer {
    pub fn new(kind: Kind) -> Self {
        Self {
            kind,
            tensors: Vec::new(),
        }
    }

    /// Adds the tensor `name`, row-major.
    pub fn put<T: Element>(&mut self, name: impl Into<String>, shape: &[usize], values: &[T]) {
        let mut bytes = Vec::with_capacity(size_of_val(values));
        values
            .iter()
            .for_each(|value| value.append_le_bytes(&mut bytes));
        let tensor = Tensor {
            dtype: T::DTYPE,
            shape: shape.to_vec(),
            bytes,
        };
        self.tensors.push((name.into(), tensor));
    }

    /// Writes header and tensors to `path`. A crash leaves the old file or the new one, never a part.
    pub fn write(self, path: &Path, header: &impl Serialize) -> Result<(), FileError> {
        let header =
            json!({"format": VERSION, "kind": self.kind.name(), "content": header}).to_string();
        let metadata = HashMap::from([(KEY.to_owned(), header)]);
        safetensors::serialize(self.tensors, Some(metadata))
            .map_err(FileProblem::header)
            .and_then(|bytes| {
                write_atomically(path, |file| file.write_all(&bytes))
                    .map_err(FileProblem::io("write"))
            })
            .map_err(|problem| problem.at(path))
    }
}

/// A file's tensors, read one by one.
pub(super) struct Reader<'a> {
    tensors: SafeTensors<'a>,
    taken: Vec<String>,
}

/// Reads the file `path` of the given kind; `parse` makes a value of its header and its tensors.
pub(super) fn read<H: DeserializeOwned, R>(
    path: &Path,
    kind: Kind,
    parse: impl FnOnce(H, &mut Reader) -> Result<R, FileProblem>,
) -> Result<R, FileError> {
    let parsed = files::read(path, LARGEST_CLOUDS)
        .map_err(FileProblem::io("read"))
        .and_then(|bytes| {
            let header = parse_header(&bytes, kind)?;
            let tensors = SafeTensors::deserialize(&bytes).map_err(not_safetensors)?;
            let mut reader = Reader {
                tensors,
                taken: Vec::new(),
            };
            let value = parse(header, &mut reader)?;
            reader.finish()?;
            Ok(value)
        });
    parsed.map_err(|problem| problem.at(path))
}

fn not_safetensors(error: safetensors::SafeTensorError) -> FileProblem {
    FileProblem::NotSafetensors(error.to_string())
}

/// The content of the header of a file of the given kind.
fn parse_header<H: DeserializeOwned>(bytes: &[u8], kind: Kind) -> Result<H, FileProblem> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(not_safetensors)?;
    let header = metadata
        .metadata()
        .as_ref()
        .and_then(|entries| entries.get(KEY));
    let header =
        header.ok_or_else(|| FileProblem::header("missing; not a file of this program"))?;
    let mut header: Value = serde_json::from_str(header).map_err(FileProblem::header)?;
    if header["format"] != VERSION {
        let found = header["format"].to_string();
        return Err(FileProblem::Version {
            found,
            expected: VERSION,
        });
    }
    if header["kind"] != kind.name() {
        let found = header["kind"]
            .as_str()
            .unwrap_or("thing without a kind")
            .to_owned();
        return Err(FileProblem::Kind {
            found,
            expected: kind.name(),
        });
    }
    serde_json::from_value(header["content"].take()).map_err(FileProblem::header)
}

fn describe(dtype: Dtype, shape: &[usize]) -> String {
    format!("{dtype:?} {shape:?}")
}

impl Reader<'_> {
    /// Appends the values of the tensor `name`, which must have the given shape and be finite, to `values`.
    pub fn take<T: Element>(
        &mut self,
        name: &str,
        shape: &[usize],
        values: &mut Vec<T>,
    ) -> Result<(), FileProblem> {
        let expected = || describe(T::DTYPE, shape);
        let tensor = self
            .tensors
            .tensor(name)
            .map_err(|_| FileProblem::MissingTensor {
                name: name.to_owned(),
                expected: expected(),
            })?;
        if tensor.dtype() != T::DTYPE || tensor.shape() != shape {
            return Err(FileProblem::WrongTensor {
                name: name.to_owned(),
                found: describe(tensor.dtype(), tensor.shape()),
                expected: expected(),
            });
        }
        let numbers = tensor.data().chunks_exact(size_of::<T>());
        for (index, value) in numbers.map(T::from_le_bytes).enumerate() {
            if !value.as_f64().is_finite() {
                let (name, value) = (name.to_owned(), value.as_f64());
                return Err(FileProblem::NotFinite {
                    name,
                    index,
                    found: value,
                });
            }
            values.push(value);
        }
        self.taken.push(name.to_owned());
        Ok(())
    }

    /// Returns an error for tensors that were not read.
    fn finish(self) -> Result<(), FileProblem> {
        let mut names = self.tensors.names().into_iter();
        match names.find(|name| !self.taken.iter().any(|taken| taken == name)) {
            None => Ok(()),
            Some(name) => Err(FileProblem::ExtraTensor(name.to_owned())),
        }
    }
}
