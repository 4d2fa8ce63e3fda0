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
}

/// Reads clouds as `tdcr predict --commands FILE --out clouds.npz` writes them: an NPZ file of `points` (T, N, 3), floats
/// (m), and maybe `rgb` (T, N, 3), bytes or floats from 0 to 1, and `commands` (T, D), floats. Other arrays are passed over.
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
    Ok(PredictedClouds {
        points,
        colors,
        commands,
    })
}

fn wrong_shape(name: &str, found: &[usize], expected: &str) -> Fault {
    let place = format!("array `{name}`");
    Fault::new(place, format!("shape {found:?}, expected {expected}"))
}
