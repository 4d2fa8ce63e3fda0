//! Folders of clouds with their motors, to a data set and from one.

use std::collections::BTreeSet;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use tdcr_base::files::{LARGEST_TEXT, read_text, write_atomically};
use tdcr_sim::cloud::{PointCloud, VoxelGrid, write_ply};

use super::split_file::read_split;
use super::{EXTENSIONS, Fault, NpzArray, NpzValues, parse_cloud, parser_of, write_npz};
use crate::data::conditions::rng;
use crate::data::folder::{foreign_entry, remove_folder};
use crate::data::{Collector, Condition, DataError, DataSet, Meta, Origin, Sample, Split};

/// Folder of what an export has written, inside the one that it is to fill.
const STAGING: &str = ".partial-export";

/// Samples per file on disk.
const SAMPLES_PER_SHARD: usize = 250;

/// The unit of clouds in files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum LengthUnit {
    /// Metres.
    #[default]
    Metre,
    /// Centimetres.
    Centimetre,
    /// Millimetres.
    Millimetre,
}

impl LengthUnit {
    /// Its length (m).
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 1e-2,
            Self::Millimetre => 1e-3,
        }
    }

    /// Its name, of several.
    fn plural(self) -> &'static str {
        match self {
            Self::Metre => "metres",
            Self::Centimetre => "centimetres",
            Self::Millimetre => "millimetres",
        }
    }
}

/// How a folder becomes a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportSettings {
    /// Unit of the clouds; the data set is in metres.
    pub unit: LengthUnit,
    /// Points per cloud.
    pub points: usize,
    /// Edge of the voxel grid that thins the clouds (m); `None` leaves them as they are.
    pub voxel_size: Option<f64>,
    /// CSV file of lines `NAME,SPLIT` that says which cloud is in which split, by the names of the clouds' files; `None`
    /// leaves it to chance.
    pub split: Option<PathBuf>,
    /// Seed of the points that are kept, and of the splits.
    pub seed: u64,
}

impl Default for ImportSettings {
    /// Clouds of 10,000 points in metres, not thinned.
    fn default() -> Self {
        Self {
            unit: LengthUnit::default(),
            points: 10_000,
            voxel_size: None,
            split: None,
            seed: 0,
        }
    }
}

/// Format of exported clouds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ExportFormat {
    /// Binary little-endian PLY.
    Ply,
    /// NumPy archives of `points` (N, 3) float32 (m) and `rgb` (N, 3) uint8.
    Npz,
}

/// What a motor file holds: `{"ctrl": [...]}`.
#[derive(Deserialize)]
struct Motors {
    ctrl: Vec<f32>,
}

/// What an import has made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Imported {
    /// Clouds of the data set.
    pub clouds: usize,
    /// What one should know besides: files and colours that were passed over.
    pub notes: Vec<String>,
}

/// Makes a data set in the folder `out` of the clouds in `dir`, in the order of their names. Beside each cloud `NAME.ply`,
/// `.pcd`, `.npy` or `.npz`, `NAME.json` holds its motors, `{"ctrl": [...]}`, in any unit. Interrupted, the same call goes
/// on where it stopped.
///
/// `read` is called with the clouds that were read and those that are to be, before the first and after each, and may ask to stop;
/// `write` likewise with the steps of [`Collector::finish`].
///
/// # Errors
/// [`DataError::NoClouds`] where no file of the folder is one of these; [`DataError::CloudFile`] names the file and the place
/// in it; [`DataError::Interrupted`]; else as [`Collector`].
pub fn import(
    dir: &Path,
    out: &Path,
    settings: &ImportSettings,
    mut read: impl FnMut(usize, usize) -> ControlFlow<()>,
    write: impl FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Imported, DataError> {
    if let Some(size) = settings.voxel_size
        && !VoxelGrid::is_size(size)
    {
        return Err(DataError::InvalidMeta {
            field: "voxel_size",
            found: size.to_string(),
            expected: VoxelGrid::EXPECTED_SIZE,
        });
    }
    let Found { clouds, others } = cloud_files(dir, settings.split.as_deref())?;
    if clouds.is_empty() {
        return Err(DataError::NoClouds {
            path: dir.to_owned(),
            found: others.into_iter().collect(),
        });
    }
    let motors = clouds.first().map(|cloud| read_motors(cloud));
    let motors = motors.transpose()?.map_or(1, |motors| motors.len());
    let split = settings.split.as_deref();
    let split = split.map(|file| read_split(file, &clouds)).transpose()?;
    let meta = Meta {
        format: Meta::FORMAT,
        tdcr_version: env!("CARGO_PKG_VERSION").to_owned(),
        seed: settings.seed,
        count: clouds.len(),
        motors,
        points_per_cloud: settings.points,
        samples_per_shard: SAMPLES_PER_SHARD,
        origin: Origin::Imported {
            source: match settings.unit {
                LengthUnit::Metre => format!("{} clouds from {}", clouds.len(), dir.display()),
                unit => format!(
                    "{} clouds in {} from {}",
                    clouds.len(),
                    unit.plural(),
                    dir.display()
                ),
            },
            split,
        },
    };
    let collector = Collector::open(out, &meta)?;
    let read = read_missing(&collector, &clouds, motors, settings, &mut read);
    let grey = match read {
        Ok(grey) => grey,
        Err(error) => {
            // What is wrong with the clouds says more than what cannot be removed.
            let _ = collector.abandon();
            return Err(error);
        }
    };
    collector.finish(write)?;
    Ok(Imported {
        clouds: meta.count,
        notes: grey.note().into_iter().chain(note_of(&others)).collect(),
    })
}

/// Reads and stores the clouds that are missing; those without colours.
fn read_missing(
    collector: &Collector,
    clouds: &[PathBuf],
    motors: usize,
    settings: &ImportSettings,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Grey, DataError> {
    let mut grey = Grey::default();
    let missing = collector.missing_blocks();
    let count = missing.iter().map(ExactSizeIterator::len).sum();
    let mut done = 0;
    go_on(progress, done, count)?;
    for block in missing {
        let sample = |index: usize| {
            let sample = read_sample(&clouds[index], index, motors, settings, &mut grey)?;
            done += 1;
            go_on(progress, done, count)?;
            Ok(sample)
        };
        let samples: Vec<Sample> = block
            .clone()
            .map(sample)
            .collect::<Result<_, DataError>>()?;
        collector.write_block(block.start, &samples)?;
    }
    Ok(grey)
}

/// Tells `progress` how many of how many are done, and whether it lets go on.
fn go_on(
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    done: usize,
    count: usize,
) -> Result<(), DataError> {
    match count > 0 && progress(done, count).is_break() {
        true => Err(DataError::Interrupted),
        false => Ok(()),
    }
}

/// Clouds that became grey though their files have columns or arrays that are not known.
#[derive(Default)]
struct Grey {
    clouds: usize,
    /// The first of them, and its columns or arrays.
    first: Option<(PathBuf, Vec<String>)>,
}

impl Grey {
    fn add(&mut self, path: &Path, passed_over: Vec<String>) {
        if !passed_over.is_empty() {
            self.clouds += 1;
            self.first
                .get_or_insert_with(|| (path.to_owned(), passed_over));
        }
    }

    fn note(&self) -> Option<String> {
        let (path, names) = self.first.as_ref()?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let which = match self.clouds {
            1 => name.into_owned(),
            clouds => format!("{name} and {} more", clouds - 1),
        };
        Some(format!(
            "no colours were found in {which}, whose points are grey; passed over: {}. Colours are read from columns red, green and \
             blue, diffuse_red and so on, r, g and b, or rgb, and from arrays rgb or colors",
            names.join(", ")
        ))
    }
}

/// What to note of files beside the clouds and their motors.
fn note_of(others: &BTreeSet<String>) -> Option<String> {
    let others: Vec<&str> = others.iter().map(String::as_str).collect();
    (!others.is_empty()).then(|| {
        format!(
            "files that end in {} were passed over; clouds end in {EXTENSIONS}",
            others.join(", ")
        )
    })
}

fn read_sample(
    path: &Path,
    index: usize,
    motors: usize,
    settings: &ImportSettings,
    grey: &mut Grey,
) -> Result<Sample, DataError> {
    let condition = Condition {
        motors: read_motors(path)?,
        payload: None,
    };
    if condition.motors.len() != motors {
        let found = condition.motors.len();
        let problem = format!("{found} values, expected {motors} as in the first file");
        return Err(Fault::new("ctrl", problem).at(&motor_file(path)).into());
    }
    let parsed = parse_cloud(path)?;
    grey.add(path, parsed.passed_over);
    let mut cloud = parsed.cloud;
    if settings.unit != LengthUnit::Metre {
        for x in cloud.points.as_flattened_mut() {
            *x = (f64::from(*x) * settings.unit.metres()) as f32;
        }
    }
    if let Some(size) = settings.voxel_size {
        cloud = cloud.voxel_downsample(VoxelGrid::new(size));
    }
    let cloud = cloud.sample_or_pad(settings.points, &mut rng(settings.seed, index as u64));
    Ok(Sample { condition, cloud })
}

/// The file of a cloud's motors.
fn motor_file(cloud: &Path) -> PathBuf {
    let files = ["json", "JSON"].map(|extension| cloud.with_extension(extension));
    let [usual, upper] = files;
    match !usual.exists() && upper.exists() {
        true => upper,
        false => usual,
    }
}

/// The motors beside a cloud.
fn read_motors(cloud: &Path) -> Result<Vec<f32>, DataError> {
    let path = motor_file(cloud);
    let text = read_text(&path, LARGEST_TEXT).map_err(DataError::io("read", &path))?;
    let motors = serde_json::from_str::<Motors>(&text);
    let motors = motors.map_err(|source| DataError::Json {
        path: path.clone(),
        source,
    })?;
    match motors.ctrl.is_empty() {
        false => Ok(motors.ctrl),
        true => Err(Fault::new("ctrl", "no value, expected one per motor")
            .at(&path)
            .into()),
    }
}

/// What a folder holds.
struct Found {
    /// The clouds, by name.
    clouds: Vec<PathBuf>,
    /// How other files end, but for those of motors.
    others: BTreeSet<String>,
}

/// The clouds in a folder, in which the file of splits may lie.
fn cloud_files(dir: &Path, split: Option<&Path>) -> Result<Found, DataError> {
    let (mut clouds, mut others) = (vec![], BTreeSet::new());
    let split = split.and_then(|split| split.canonicalize().ok());
    for entry in std::fs::read_dir(dir).map_err(DataError::io("list", dir))? {
        let path = entry.map_err(DataError::io("list", dir))?.path();
        let extension = path.extension();
        let extension = extension.map(|extension| extension.to_string_lossy().into_owned());
        match extension {
            _ if parser_of(&path).is_some() => clouds.push(path),
            Some(json) if json.eq_ignore_ascii_case("json") => {}
            Some(other) if path.is_file() && path.canonicalize().ok() != split => {
                others.insert(format!(".{other}"));
            }
            _ => {}
        }
    }
    clouds.sort_unstable();
    Ok(Found { clouds, others })
}

/// Writes the clouds of the data set `set` to the folder `out`, which is made if it is not there: one folder for each
/// split, in each `cloud-00000.ply` or `.npz` and so on with `cloud-00000.json` beside it, which holds `{"ctrl": [...]}`:
/// the condition. Returns the number of clouds. The three folders appear when all of them are written. `progress` is called with
/// the clouds that are written and all of them, before the first and after each, and may ask to stop: then nothing is left.
///
/// # Errors
/// As [`DataSet::read_split`]; [`DataError::Interrupted`]; [`DataError::NotEmpty`] where `out` holds anything, older clouds above all;
/// [`DataError::Io`] and [`DataError::CloudFile`] where a file cannot be written.
pub fn export(
    set: &DataSet,
    format: ExportFormat,
    out: &Path,
    mut progress: impl FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<usize, DataError> {
    if let Some(found) = foreign_entry(out, &[STAGING.to_owned()])? {
        let path = out.to_owned();
        return Err(DataError::NotEmpty { path, found });
    }
    // What a killed export left.
    let staging = out.join(STAGING);
    remove_folder(&staging)?;
    let exported = export_to(set, format, &staging, &mut progress).and_then(|count| {
        for folder in Split::ALL.map(Split::folder) {
            let dir = out.join(folder);
            std::fs::rename(staging.join(folder), &dir).map_err(DataError::io("create", &dir))?;
        }
        Ok(count)
    });
    remove_folder(&staging)?;
    exported
}

fn export_to(
    set: &DataSet,
    format: ExportFormat,
    out: &Path,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<usize, DataError> {
    let sizes = Split::ALL.map(|split| Ok(set.samples(split)?.len()));
    let all = sizes.into_iter().sum::<Result<usize, DataError>>()?;
    let mut count = 0;
    go_on(progress, count, all)?;
    for split in Split::ALL {
        let dir = out.join(split.folder());
        std::fs::create_dir_all(&dir).map_err(DataError::io("create", &dir))?;
        for (index, sample) in set.read_split(split)?.iter().enumerate() {
            let path = dir.join(format!("cloud-{index:05}"));
            write_cloud(&path, format, &sample.cloud)?;
            let values: Vec<f32> = sample.condition.values().collect();
            let json = serde_json::json!({ "ctrl": values }).to_string();
            let path = path.with_extension("json");
            write_atomically(&path, |file| file.write_all(json.as_bytes()))
                .map_err(DataError::io("write", &path))?;
            count += 1;
            go_on(progress, count, all)?;
        }
    }
    Ok(count)
}

fn write_cloud(path: &Path, format: ExportFormat, cloud: &PointCloud) -> Result<(), DataError> {
    match format {
        ExportFormat::Ply => {
            let path = path.with_extension("ply");
            let fault = |error: tdcr_sim::cloud::PlyError| Fault::new("file", error.source);
            Ok(write_ply(&path, cloud).map_err(|error| fault(error).at(&path))?)
        }
        ExportFormat::Npz => {
            let path = path.with_extension("npz");
            let shape = &[cloud.len(), 3];
            let array = |name, values| NpzArray {
                name,
                shape,
                values,
            };
            let points = NpzValues::Floats(cloud.points.as_flattened());
            let colors = NpzValues::Bytes(cloud.colors.as_flattened());
            Ok(write_npz(
                &path,
                &[array("points", points), array("rgb", colors)],
            )?)
        }
    }
}
