//! Clouds that any program predicted for several commands.

use std::io::Cursor;
use std::path::Path;

use tdcr_base::files;
use tdcr_base::files::LARGEST_CLOUDS;
use zip::ZipArchive;

use super::npy::Member;
use super::{CloudFileError, Fault};

/// Clouds of several commands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PredictedClouds {
    /// Points of each cloud (m, world frame).
    pub points: Vec<Vec<[f32; 3]>>,
    /// Colours of the points, where the file has them.
    pub colors: Option<Vec<Vec<[u8; 3]>>>,
    /// The commands that they were predicted for, where the file says so: the motors, then the payload if there is one.
    pub commands: Option<Vec<Vec<f32>>>,
    /// Name of the method that predicted them, where the file says it.
    pub method: Option<String>,
    /// Time of all processors that its training took (s), where the file says it.
    pub training_seconds: Option<f64>,
    /// Time that the prediction of one cloud took (s), where the file says it.
    pub prediction_seconds: Option<f64>,
}

/// Letters of a method's name at most: what fits a table.
const LONGEST_NAME: usize = 60;

/// Reads clouds as `tdcr predict --commands FILE --out clouds.npz` writes them: an NPZ file of `points` (T, N, 3), floats
/// (m), and maybe `rgb` (T, N, 3), bytes or floats from 0 to 1, and `commands` (T, D), floats. Of the method that predicted them
/// it may also say, in arrays without dimensions, its name (`method`, text), the time of all processors that its training took
/// (`training_seconds`) and the time of the prediction of a cloud (`prediction_seconds`), floats. Other arrays are passed over.
///
/// # Errors
/// [`CloudFileError`] for what cannot be read, an array of another shape, and a number that is not finite.
pub fn read_predictions(path: &Path) -> Result<PredictedClouds, CloudFileError> {
    let read = || {
        let bytes = files::read(path, LARGEST_CLOUDS).map_err(|error| Fault::new("file", error))?;
        parse(&bytes)
    };
    read().map_err(|fault| fault.at(path))
}

fn parse(bytes: &[u8]) -> Result<PredictedClouds, Fault> {
    let archive = ZipArchive::new(Cursor::new(bytes));
    let mut archive = archive.map_err(|error| Fault::new("archive", error))?;
    let mut find = |name: &'static str| match archive.by_name(&format!("{name}.npy")) {
        Ok(file) => Member::unpack(name, file, bytes.len() as u64).map(Some),
        Err(_) => Ok(None),
    };
    let points = find("points")?;
    let points = points.ok_or_else(|| {
        Fault::new(
            "archive",
            "no array `points`, expected one of shape (T, N, 3)",
        )
    })?;
    let (shape, table) = points.shaped_table()?;
    let [clouds, count, 3] = shape[..] else {
        return Err(wrong_shape("points", &shape, "(T, N, 3)"));
    };
    let rows = table.rows().map(|at| [0, 1, 2].map(|axis| at(axis) as f32));
    let all: Vec<[f32; 3]> = rows.collect();
    let points: Vec<Vec<[f32; 3]>> = all.chunks_exact(count).map(<[_]>::to_vec).collect();
    for (cloud, points) in points.iter().enumerate() {
        if let Some(point) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            let problem = format!("point {point} of cloud {cloud} is not finite");
            return Err(Fault::new("array `points`", problem));
        }
    }
    let colors = match find("rgb")? {
        None => None,
        Some(member) => {
            let (found, table) = member.shaped_table()?;
            if found != shape {
                return Err(wrong_shape(
                    "rgb",
                    &found,
                    &format!("{shape:?} as the points"),
                ));
            }
            let colors = table.colors(0, &all);
            let colors = colors.map_err(|fault| member.inside(fault))?;
            Some(colors.chunks_exact(count).map(<[_]>::to_vec).collect())
        }
    };
    let commands = match find("commands")? {
        None => None,
        Some(member) => {
            let (found, table) = member.shaped_table()?;
            let [rows, values] = found[..] else {
                return Err(wrong_shape("commands", &found, "(T, D)"));
            };
            if rows != clouds {
                let expected = format!("{clouds} rows, one for each cloud");
                return Err(wrong_shape("commands", &found, &expected));
            }
            let mut commands = Vec::with_capacity(rows);
            for at in table.rows() {
                commands.push((0..values).map(|k| at(k) as f32).collect());
            }
            Some(commands)
        }
    };
    let method = find("method")?.map(|member| name_in(&member)).transpose()?;
    let mut seconds = |name| find(name)?.map(|member| seconds_in(&member)).transpose();
    Ok(PredictedClouds {
        points,
        colors,
        commands,
        method,
        training_seconds: seconds("training_seconds")?,
        prediction_seconds: seconds("prediction_seconds")?,
    })
}

fn name_in(member: &Member) -> Result<String, Fault> {
    let name = member.text()?;
    let letters = name.chars().count();
    if name.trim().is_empty() || letters > LONGEST_NAME || name.chars().any(char::is_control) {
        let problem = format!("{name:?}, expected a name of 1 to {LONGEST_NAME} printable letters");
        return Err(member.inside(Fault::new("data", problem)));
    }
    Ok(name)
}

fn seconds_in(member: &Member) -> Result<f64, Fault> {
    let seconds = member.number()?;
    if seconds >= 0.0 && seconds.is_finite() {
        return Ok(seconds);
    }
    let problem = format!("{seconds}, expected a finite number of seconds, 0 or more");
    Err(member.inside(Fault::new("data", problem)))
}

fn wrong_shape(name: &str, found: &[usize], expected: &str) -> Fault {
    let place = format!("array `{name}`");
    Fault::new(place, format!("shape {found:?}, expected {expected}"))
}
