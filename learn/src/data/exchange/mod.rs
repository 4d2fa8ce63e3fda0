//! Clouds of other programs and of real robots: files in, files out.

mod import;
mod npy;
mod npz;
mod pcd;
mod ply;
mod predictions;
mod split_file;
mod table;

pub use import::{ExportFormat, ImportSettings, Imported, LengthUnit, export, import};
pub use npz::{NpzArray, NpzRows, NpzValues, write_npy, write_npz};
pub use predictions::{PredictedClouds, read_predictions};

use std::path::{Path, PathBuf};

use tdcr_base::files;
use tdcr_sim::cloud::PointCloud;

use tdcr_base::files::LARGEST_CLOUDS;

/// Colour of points whose file gives none.
const GREY: [u8; 3] = [128; 3];

/// Most points of a file: more than any depth camera or laser scanner sees from around a robot.
const MAX_POINTS: usize = 1 << 25;

/// Reads the bytes of a file.
type Parse = fn(&[u8]) -> Result<Parsed, Fault>;

/// Extensions of the files that clouds are read from, in any case, and what reads them.
const FORMATS: [(&str, Parse); 4] = [
    ("ply", ply::parse),
    ("pcd", pcd::parse),
    ("npy", npy::parse_npy),
    ("npz", npy::parse_npz),
];

/// What reads the file `path`, by its extension; `None` where that is of no format that is known.
fn parser_of(path: &Path) -> Option<Parse> {
    let extension = path.extension()?.to_str()?;
    let mut formats = FORMATS.iter();
    let (_, parse) = formats.find(|(known, _)| extension.eq_ignore_ascii_case(known))?;
    Some(*parse)
}

/// The extensions, in words.
pub(super) const EXTENSIONS: &str = ".ply, .pcd, .npy or .npz";

/// A cloud as a file has it.
struct Parsed {
    cloud: PointCloud,
    /// Columns or arrays of a file without colours that might be some, under other names.
    passed_over: Vec<String>,
}

impl Parsed {
    /// A cloud of which nothing was passed over.
    fn of(cloud: PointCloud) -> Self {
        Self {
            cloud,
            passed_over: Vec::new(),
        }
    }
}

/// Whether a point was seen: depth cameras mark with NaN what they did not see.
fn is_finite(point: &[f32; 3]) -> bool {
    point.iter().all(|x| x.is_finite())
}

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

/// Refuses more points than any cloud has.
fn require_points(place: impl ToString, count: usize) -> Result<(), Fault> {
    match count {
        0..=MAX_POINTS => Ok(()),
        _ => Err(Fault::new(
            place,
            format!("{count} points, expected at most {MAX_POINTS}: thin the cloud"),
        )),
    }
}

/// Reads a cloud, in the unit of the file, from a PLY (ASCII or binary little-endian), PCD (ASCII or binary), NPY or NPZ file, by its
/// extension. Points that are not finite, with which depth cameras mark what they did not see, are left out; points
/// without a colour are grey. Colours are from 0 to 1 where they are floats, else from 0 to 255.
///
/// # Errors
/// [`CloudFileError`] with the place in the file; also where no point is left.
pub fn read_cloud(path: &Path) -> Result<PointCloud, CloudFileError> {
    Ok(parse_cloud(path)?.cloud)
}

/// The same, with what was passed over.
fn parse_cloud(path: &Path) -> Result<Parsed, CloudFileError> {
    let parse = parser_of(path).ok_or_else(|| {
        let problem = format!("unknown extension, expected {EXTENSIONS}");
        Fault::new("name", problem).at(path)
    })?;
    let bytes =
        files::read(path, LARGEST_CLOUDS).map_err(|error| Fault::new("file", error).at(path))?;
    let mut parsed = parse(&bytes).map_err(|fault| fault.at(path))?;
    let cloud = &mut parsed.cloud;
    let kept: Vec<bool> = cloud.points.iter().map(is_finite).collect();
    let mut keep = kept.iter();
    cloud.points.retain(|_| *keep.next().unwrap_or(&false));
    let mut keep = kept.iter();
    cloud.colors.retain(|_| *keep.next().unwrap_or(&false));
    if cloud.is_empty() {
        return Err(Fault::new("points", "no finite point, expected at least 1").at(path));
    }
    Ok(parsed)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use std::io::Cursor;

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
            let npy = [npy::header(&[2, 3], "<f4"), vec![0; 24]].concat();
            let mut npz = Cursor::new(Vec::new());
            npy::write_archive(&mut npz, [("points".to_owned(), 152, &npy[..])]).unwrap();
            let mut bytes = [ply_seed(), pcd_seed(), npy, npz.into_inner()][seed].clone();
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
