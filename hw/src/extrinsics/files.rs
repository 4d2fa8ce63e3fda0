//! Files of a calibration: the board, the cameras, folders of images, and the result.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use tdcr_sim::camera::Distortion;
use tdcr_sim::files::{read, read_text};
use tdcr_sim::robot::{Aim, CameraSpec, Cameras, Lens, PinholeSpec, SpecError};
use thiserror::Error;

use super::board::{Board, BoardError, BoardSpec};
use super::calibrate::{Calibration, KnownCamera, Sighting, World};
use super::detect::Detector;
use super::image::{GreyImage, PngError};

/// Largest text file (bytes), and largest image: 16384 pixels squared are read as PNGs of up to a quarter of their size.
const LARGEST_TEXT: u64 = 16 << 20;
const LARGEST_IMAGE: u64 = 256 << 20;

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
        source: toml::de::Error,
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
        source: SpecError,
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
    let far = |x: &f64| !(x.abs() <= 1e6);
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

/// A [`CameraSpec`] with a serial number. Where it is is what is sought.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraInFile {
    serial: String,
    lens: Lens,
    resolution: [u32; 2],
    distortion: Option<Distortion>,
    #[serde(rename = "position")]
    _position: Option<[f64; 3]>,
    #[serde(rename = "aim")]
    _aim: Option<Aim>,
}

/// Reads cameras: a table `[[cameras]]` for each with `serial` and, as robot files have them, `lens`, `resolution` and
/// `distortion`. A `position` and an `aim` are passed over, and so is everything else in the file.
///
/// # Errors
/// [`FilesError`] says what is wrong where.
pub fn read_cameras(path: &Path) -> Result<Vec<KnownCamera>, FilesError> {
    let file: CamerasInFile = read_toml(path, "a list of cameras")?;
    let spec = |camera: &CameraInFile| CameraSpec {
        position: [0.0; 3],
        aim: Aim::Orientation(unturned()),
        lens: camera.lens,
        resolution: camera.resolution,
        distortion: camera.distortion,
    };
    let specs = Cameras::Free(file.cameras.iter().map(spec).collect());
    specs.validate().map_err(|source| FilesError::Camera {
        path: path.to_owned(),
        source,
    })?;
    let mut serials = BTreeSet::new();
    for (index, camera) in file.cameras.iter().enumerate() {
        let serial = &camera.serial;
        let folder = Path::new(serial)
            .file_name()
            .is_some_and(|name| name == serial.as_str());
        if !folder || !serials.insert(serial) {
            return Err(FilesError::Serial {
                path: path.to_owned(),
                index,
                serial: serial.clone(),
            });
        }
    }
    let known = |camera: CameraInFile| KnownCamera {
        intrinsics: camera.lens.intrinsics(camera.resolution, camera.distortion),
        serial: camera.serial,
    };
    Ok(file.cameras.into_iter().map(known).collect())
}

fn read_toml<T: for<'de> Deserialize<'de>>(
    path: &Path,
    expected: &'static str,
) -> Result<T, FilesError> {
    let text = read_text(path, LARGEST_TEXT).map_err(reading(path))?;
    toml::from_str(&text).map_err(|source| FilesError::Toml {
        path: path.to_owned(),
        expected,
        source,
    })
}

fn reading(path: &Path) -> impl FnOnce(io::Error) -> FilesError {
    let path = path.to_owned();
    |source| FilesError::Read { path, source }
}

/// What the images of a folder show.
#[derive(Clone, Debug)]
pub struct Album {
    /// Names of the views, sorted.
    pub views: Vec<String>,
    /// An entry for each image, of a camera and a view; no corners where the board is not seen.
    pub sightings: Vec<Sighting>,
}

impl Album {
    /// Detects the board in all images `<serial>/<view>.png` below a folder. A camera may lack some views.
    ///
    /// # Errors
    /// [`FilesError`] where a camera has no images, or an image is damaged or not of its camera's size.
    pub fn read(folder: &Path, cameras: &[KnownCamera], board: &Board) -> Result<Self, FilesError> {
        let detector = Detector::new(board).map_err(|source| FilesError::Board {
            path: folder.to_owned(),
            source,
        })?;
        no_others(folder, cameras)?;
        let mut images: Vec<(usize, String, PathBuf)> = Vec::new();
        for (index, camera) in cameras.iter().enumerate() {
            let path = folder.join(&camera.serial);
            let found = pngs(&path)?;
            if found.is_empty() {
                let path = path.join("*.png");
                return Err(FilesError::NoImages { path });
            }
            images.extend(found.into_iter().map(|(view, path)| (index, view, path)));
        }
        let views: BTreeSet<String> = images.iter().map(|(_, view, _)| view.clone()).collect();
        let views: Vec<String> = views.into_iter().collect();
        let detect = |(camera, view, path): &(usize, String, PathBuf)| {
            let bytes = read(path, LARGEST_IMAGE).map_err(reading(path))?;
            let intrinsics = &cameras[*camera].intrinsics;
            let size = [intrinsics.width, intrinsics.height];
            let image = GreyImage::read_png(Cursor::new(bytes), size);
            let image = image.map_err(|source| FilesError::Image {
                path: path.clone(),
                source,
            })?;
            Ok(Sighting {
                camera: *camera,
                view: views.binary_search(view).expect("the views have all names"),
                corners: detector.detect(&image),
            })
        };
        let sightings = images.par_iter().map(detect).collect::<Result<_, _>>()?;
        Ok(Self { views, sightings })
    }
}

/// The PNG files of a folder, by their names without extension, sorted. Other files are passed over.
fn pngs(folder: &Path) -> Result<Vec<(String, PathBuf)>, FilesError> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(reading(folder))?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(reading(folder))?.path();
        let png = path
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        if let Some(name) = path.file_stem().filter(|_| png) {
            found.push((name.to_string_lossy().into_owned(), path));
        }
    }
    found.sort();
    Ok(found)
}

/// Refuses folders with images of cameras that are not known: a serial number may be mistyped.
fn no_others(folder: &Path, cameras: &[KnownCamera]) -> Result<(), FilesError> {
    for entry in fs::read_dir(folder).map_err(reading(folder))? {
        let path = entry.map_err(reading(folder))?.path();
        let known = |camera: &KnownCamera| {
            path.file_name()
                .is_some_and(|n| n == camera.serial.as_str())
        };
        if path.is_dir() && !cameras.iter().any(known) && !pngs(&path)?.is_empty() {
            let expected = cameras.iter().map(|camera| camera.serial.clone()).collect();
            return Err(FilesError::UnknownFolder { path, expected });
        }
    }
    Ok(())
}

#[derive(Serialize)]
struct CamerasOut {
    cameras: Vec<CameraOut>,
}

#[derive(Serialize)]
struct CameraOut {
    serial: String,
    #[serde(flatten)]
    spec: CameraSpec,
}

impl Calibration {
    /// The cameras as robot files describe them, in order.
    pub fn specs(&self) -> Vec<CameraSpec> {
        let spec = |camera: &super::CalibratedCamera| {
            let intrinsics = &camera.camera.intrinsics;
            let pose = &camera.camera.pose;
            let turn = pose.rotation;
            CameraSpec {
                position: pose.translation.vector.into(),
                aim: Aim::Orientation([turn.w, turn.i, turn.j, turn.k]),
                lens: Lens::Pixels(PinholeSpec {
                    focal: [intrinsics.fx, intrinsics.fy],
                    principal: [intrinsics.cx, intrinsics.cy],
                }),
                resolution: [intrinsics.width, intrinsics.height],
                distortion: intrinsics.distortion,
            }
        };
        self.cameras.iter().map(spec).collect()
    }

    /// The cameras with their poses as TOML: `[[cameras]]` as robot files have them, with their serial numbers.
    ///
    /// # Errors
    /// Those of the encoder.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        let serials = self.cameras.iter().map(|camera| camera.serial.clone());
        let cameras = serials
            .zip(self.specs())
            .map(|(serial, spec)| CameraOut { serial, spec });
        toml::to_string(&CamerasOut {
            cameras: cameras.collect(),
        })
    }
}
