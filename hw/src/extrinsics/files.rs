//! Files of boards and of cameras.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;
use tdcr_base::files::read_text;
use tdcr_sim::camera::Distortion;
use tdcr_sim::robot::{Aim, CameraSpec, Cameras, Lens, SpecError};
use thiserror::Error;
use toml::Value;

use super::board::{Board, BoardError, BoardSpec};
use super::calibrate::{KnownCamera, World};
use super::image::PngError;
use super::outcome::Calibration;

/// Largest text file (bytes).
const LARGEST_TEXT: u64 = 16 << 20;

/// Why files are no calibration.
#[derive(Debug, Error)]
pub enum FilesError {
    /// A file or folder cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// Which one.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A text file is not what it should be.
    #[error("{} is not {expected}: {source}", path.display())]
    Toml {
        /// Which one.
        path: PathBuf,
        /// What it should be.
        expected: &'static str,
        /// Where, and what was wrong.
        source: Box<toml::de::Error>,
    },
    /// The board cannot be.
    #[error("{}: {source}", path.display())]
    Board {
        /// The file.
        path: PathBuf,
        /// Why.
        source: BoardError,
    },
    /// The board's pose in the world cannot be.
    #[error("{}: world.{field} = {found:?}; expected {expected}", path.display())]
    World {
        /// The file.
        path: PathBuf,
        /// Field of `[world]`.
        field: &'static str,
        /// What it is.
        found: Vec<f64>,
        /// What it should be.
        expected: &'static str,
    },
    /// A camera cannot be.
    #[error("{}: {source}", path.display())]
    Camera {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<SpecError>,
    },
    /// A serial number is no name of a folder, or twice there.
    #[error("{}: cameras[{index}].serial is {serial:?}; expected a name for a folder that no other camera has", path.display())]
    Serial {
        /// The file.
        path: PathBuf,
        /// Number of the camera.
        index: usize,
        /// What it is.
        serial: String,
    },
    /// A camera has no images.
    #[error("there are no images {}: expected a folder for each camera, named by its serial number, with a PNG for each view", path.display())]
    NoImages {
        /// Where they should be.
        path: PathBuf,
    },
    /// Images of a camera that is not described.
    #[error("{} has images of no camera of the list; expected folders named {}", path.display(), expected.join(", "))]
    UnknownFolder {
        /// The folder.
        path: PathBuf,
        /// The cameras' serial numbers.
        expected: Vec<String>,
    },
    /// An image is damaged or of another size.
    #[error("{}: {source}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// Why.
        source: PngError,
    },
}

/// `board.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoardInFile {
    squares: [u32; 2],
    square: f64,
    marker: f64,
    dictionary: String,
    world: Option<WorldInFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WorldInFile {
    view: String,
    position: [f64; 3],
    #[serde(default = "unturned")]
    orientation: [f64; 4],
}

fn unturned() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

/// Reads a board, and what says where the world is: the board's pose (`position`, m, and `orientation`, a quaternion w, x, y, z)
/// in a view, or the first camera where the file has no `[world]`.
///
/// ```toml
/// squares = [9, 7]            # columns, rows
/// square = 0.035              # edge (m), measured on the print
/// marker = 0.026
/// dictionary = "DICT_4X4_50"  # OpenCV's name
///
/// [world]
/// view = "base"               # of the images <serial>/base.png
/// position = [-0.16, -0.12, 0.0]
/// orientation = [0.0, 1.0, 0.0, 0.0]
/// ```
///
/// # Errors
/// [`FilesError`] says what is wrong where.
pub fn read_board(path: &Path) -> Result<(Board, World), FilesError> {
    let file: BoardInFile = read_toml(path, "the description of a board")?;
    let board = Board::new(BoardSpec {
        squares: file.squares,
        square: file.square,
        marker: file.marker,
        dictionary: file.dictionary,
    });
    let path = || path.to_owned();
    let board = board.map_err(|source| FilesError::Board {
        path: path(),
        source,
    })?;
    let Some(world) = file.world else {
        return Ok((board, World::FirstCamera));
    };
    let refuse = |field, found: &[f64], expected| FilesError::World {
        path: path(),
        field,
        found: found.to_vec(),
        expected,
    };
    let far = |x: &f64| x.is_nan() || x.abs() > 1e6;
    if world.position.iter().any(far) {
        return Err(refuse("position", &world.position, "a point (m)"));
    }
    let [w, x, y, z] = world.orientation;
    let rotation = Quaternion::new(w, x, y, z);
    if world.orientation.iter().any(far) || rotation.norm() < 1e-6 {
        return Err(refuse(
            "orientation",
            &world.orientation,
            "a quaternion (w, x, y, z)",
        ));
    }
    let pose = Isometry3::from_parts(
        Translation3::from(world.position),
        UnitQuaternion::from_quaternion(rotation),
    );
    Ok((
        board,
        World::Board {
            view: world.view,
            pose,
        },
    ))
}

#[derive(Deserialize)]
struct CamerasInFile {
    cameras: Vec<CameraInFile>,
}

#[derive(Deserialize)]
struct CameraInFile {
    serial: String,
    camera: LensInFile,
}

/// A [`CameraSpec`] that need not say where the camera is, which is what is sought.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LensInFile {
    lens: Lens,
    resolution: [u32; 2],
    distortion: Option<Distortion>,
    #[serde(rename = "position")]
    _position: Option<[f64; 3]>,
    #[serde(rename = "aim")]
    _aim: Option<Aim>,
}

/// Cameras in a file: a rig's, or any TOML with a table `[[cameras]]` for each, which has its `serial` number and a table
/// `camera` as robot files describe cameras; there `position` and `aim` may be missing.
///
/// ```toml
/// [[cameras]]
/// serial = "834412071234"
/// [cameras.camera]
/// lens = { pixels = { focal = [912.3, 910.8], principal = [641.7, 363.2] } }
/// resolution = [1280, 720]
/// ```
#[derive(Clone, Debug)]
pub struct CameraFile {
    file: toml::Table,
    cameras: Vec<KnownCamera>,
}

impl CameraFile {
    /// Reads cameras.
    ///
    /// # Errors
    /// [`FilesError`] says what is wrong where.
    pub fn read(path: &Path) -> Result<Self, FilesError> {
        let file: toml::Table = read_toml(path, "TOML")?;
        let CamerasInFile { cameras } = read_toml(path, "a list of cameras")?;
        let spec = |CameraInFile { camera, .. }: &CameraInFile| CameraSpec {
            position: [0.0; 3],
            aim: Aim::Orientation(unturned()),
            lens: camera.lens,
            resolution: camera.resolution,
            distortion: camera.distortion,
        };
        let specs = Cameras::Free(cameras.iter().map(spec).collect());
        specs.validate().map_err(|source| FilesError::Camera {
            path: path.to_owned(),
            source: source.into(),
        })?;
        let mut serials = BTreeSet::new();
        for (index, CameraInFile { serial, .. }) in cameras.iter().enumerate() {
            let name = Path::new(serial).file_name();
            if name.is_none_or(|name| name != serial.as_str()) || !serials.insert(serial) {
                return Err(FilesError::Serial {
                    path: path.to_owned(),
                    index,
                    serial: serial.clone(),
                });
            }
        }
        let known = |CameraInFile { serial, camera }: &CameraInFile| KnownCamera {
            serial: serial.clone(),
            intrinsics: camera.lens.intrinsics(camera.resolution, camera.distortion),
        };
        Ok(Self {
            cameras: cameras.iter().map(known).collect(),
            file,
        })
    }

    /// The cameras, in order.
    pub fn cameras(&self) -> &[KnownCamera] {
        &self.cameras
    }

    /// The file with the poses found in place of those that it had, the rest as it was but for comments and the order of
    /// tables: a rig's file gives a rig's file.
    ///
    /// # Errors
    /// Those of the encoder.
    pub fn with_poses(&self, found: &Calibration) -> Result<String, toml::ser::Error> {
        let mut file = self.file.clone();
        let cameras = file.get_mut("cameras").and_then(Value::as_array_mut);
        for (camera, found) in cameras.into_iter().flatten().zip(&found.cameras) {
            let Some(camera) = camera.get_mut("camera").and_then(Value::as_table_mut) else {
                continue;
            };
            let pose = &found.camera.pose;
            let turn = pose.rotation;
            let orientation = Aim::Orientation([turn.w, turn.i, turn.j, turn.k]);
            let position: [f64; 3] = pose.translation.vector.into();
            camera.insert("position".into(), Value::try_from(position)?);
            camera.insert("aim".into(), Value::try_from(orientation)?);
        }
        toml::to_string(&file)
    }
}

fn read_toml<T: for<'de> Deserialize<'de>>(
    path: &Path,
    expected: &'static str,
) -> Result<T, FilesError> {
    let text = read_text(path, LARGEST_TEXT).map_err(reading(path))?;
    toml::from_str(&text).map_err(|source| FilesError::Toml {
        path: path.to_owned(),
        expected,
        source: source.into(),
    })
}

/// An error of the system at a path.
pub(super) fn reading(path: &Path) -> impl FnOnce(io::Error) -> FilesError {
    let path = path.to_owned();
    |source| FilesError::Read { path, source }
}
