//! Clouds of other programs and of real robots: files in, files out.

mod import;
mod npy;
mod pcd;
mod ply;
mod table;

pub use import::{ExportFormat, ImportSettings, export, import};

use std::path::{Path, PathBuf};

use tdcr_sim::cloud::PointCloud;

/// Colour of points whose file gives none.
const GREY: [u8; 3] = [128; 3];

/// Extensions of the files that clouds are read from.
pub(super) const EXTENSIONS: [&str; 4] = ["ply", "pcd", "npy", "npz"];

/// Why a file of another program could not be read or written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {place}: {problem}", .path.display())]
pub struct CloudFileError {
    /// The file.
    pub path: PathBuf,
    /// Where in the file: a line, a byte, a part.
    pub place: String,
    /// What was found, and what would be right.
    pub problem: String,
}

/// An array of an NPZ file.
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
pub enum NpzValues<'a> {
    /// `float32`.
    Floats(&'a [f32]),
    /// `uint8`.
    Bytes(&'a [u8]),
}

/// What is wrong with the contents of a file, and where.
#[derive(Debug, PartialEq)]
pub(super) struct Fault {
    place: String,
    problem: String,
}

impl Fault {
    fn new(place: impl ToString, problem: impl ToString) -> Self {
        Self {
            place: place.to_string(),
            problem: problem.to_string(),
        }
    }

    fn at(self, path: &Path) -> CloudFileError {
        CloudFileError {
            path: path.to_owned(),
            place: self.place,
            problem: self.problem,
        }
    }
}

/// Reads a cloud (m) from a PLY (ASCII or binary little-endian), PCD (ASCII or binary), NPY or NPZ file, by its
/// extension. Points that are not finite, with which depth cameras mark what they did not see, are left out; points
/// without a colour are grey.
///
/// # Errors
/// [`CloudFileError`] with the place in the file; also where no point is left.
pub fn read_cloud(path: &Path) -> Result<PointCloud, CloudFileError> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    let parse: fn(&[u8]) -> Result<PointCloud, Fault> = match extension {
        Some("ply") => ply::parse,
        Some("pcd") => pcd::parse,
        Some("npy") => npy::parse_npy,
        Some("npz") => npy::parse_npz,
        _ => {
            let problem = "unknown extension, expected .ply, .pcd, .npy or .npz";
            return Err(Fault::new("name", problem).at(path));
        }
    };
    let bytes = std::fs::read(path).map_err(|error| Fault::new("file", error).at(path))?;
    let mut cloud = parse(&bytes).map_err(|fault| fault.at(path))?;
    let seen = |point: &[f32; 3]| point.iter().all(|x| x.is_finite());
    let kept: Vec<bool> = cloud.points.iter().map(seen).collect();
    let mut keep = kept.iter();
    cloud.points.retain(|_| *keep.next().unwrap_or(&false));
    let mut keep = kept.iter();
    cloud.colors.retain(|_| *keep.next().unwrap_or(&false));
    if cloud.is_empty() {
        return Err(Fault::new("points", "no finite point, expected at least 1").at(path));
    }
    Ok(cloud)
}

/// Writes arrays to an NPZ file.
///
/// # Errors
/// [`CloudFileError`] where the file cannot be written, or an array has not as many values as its shape says.
pub fn write_npz(path: &Path, arrays: &[NpzArray]) -> Result<(), CloudFileError> {
    let files: Result<Vec<_>, Fault> = arrays
        .iter()
        .map(|array| Ok((array.name, array.to_npy()?)))
        .collect();
    files
        .and_then(|files| {
            std::fs::write(path, npy::to_npz(&files)).map_err(|error| Fault::new("file", error))
        })
        .map_err(|fault| fault.at(path))
}

impl NpzArray<'_> {
    fn to_npy(self) -> Result<Vec<u8>, Fault> {
        let (count, descr, data) = match self.values {
            NpzValues::Floats(values) => {
                let data = values.iter().flat_map(|x| x.to_le_bytes()).collect();
                (values.len(), "<f4", data)
            }
            NpzValues::Bytes(values) => (values.len(), "|u1", values.to_vec()),
        };
        let expected: usize = self.shape.iter().product();
        if count != expected {
            let place = format!("array `{}`", self.name);
            let problem = format!(
                "{count} values, expected {expected} as {:?} says",
                self.shape
            );
            return Err(Fault::new(place, problem));
        }
        Ok(npy::to_npy(self.shape, descr, &data))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ply_seed() -> Vec<u8> {
        let mut bytes =
            b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\n\
            property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
            property uchar blue\nend_header\n"
                .to_vec();
        bytes.extend([0; 30]);
        bytes
    }

    fn pcd_seed() -> Vec<u8> {
        let mut bytes =
            b"VERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n\
            WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary\n"
                .to_vec();
        bytes.extend([0; 32]);
        bytes
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        #[test]
        fn no_bytes_make_a_parser_panic(
            seed in 0..4_usize,
            damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
            length in any::<prop::sample::Index>(),
        ) {
            let npy = npy::to_npy(&[2, 3], "<f4", &[0; 24]);
            let npz = npy::to_npz(&[("points", npy.clone())]);
            let mut bytes = [ply_seed(), pcd_seed(), npy, npz][seed].clone();
            for (position, value) in damage {
                let position = position.index(bytes.len());
                bytes[position] = value;
            }
            let cut = &bytes[..=length.index(bytes.len())];
            for bytes in [&bytes[..], cut] {
                let _ = (ply::parse(bytes), pcd::parse(bytes), npy::parse_npy(bytes), npy::parse_npz(bytes));
            }
        }
    }
}
