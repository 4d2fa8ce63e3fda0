//! PLY files.

use std::io::Write;
use std::path::{Path, PathBuf};

use tdcr_base::files::write_atomically;
use thiserror::Error;

use super::PointCloud;

/// Why a PLY file could not be written.
#[derive(Debug, Error)]
#[error("cannot write point cloud {}: {source}", path.display())]
pub struct PlyError {
    /// The file.
    pub path: PathBuf,
    /// What the operating system said.
    pub source: std::io::Error,
}

/// What is known of each point of a cloud beside its place and colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointProperty<'a> {
    /// Its name, one word.
    pub name: &'a str,
    /// Its value at each point.
    pub values: &'a [f32],
}

/// Writes a cloud as binary little-endian PLY: `x y z` (float, m) and `red green blue` (uchar). The file is whole or not there.
///
/// # Errors
/// [`PlyError`] when the file cannot be written.
pub fn write_ply(path: &Path, cloud: &PointCloud) -> Result<(), PlyError> {
    write_ply_with(path, cloud, &[])
}

/// [`write_ply`] with more `properties` (float) after the colours.
///
/// # Errors
/// [`PlyError`] when the file cannot be written.
///
/// # Panics
/// Where a property has more or fewer values than the cloud has points.
pub fn write_ply_with(
    path: &Path,
    cloud: &PointCloud,
    properties: &[PointProperty],
) -> Result<(), PlyError> {
    for property in properties {
        assert_eq!(property.values.len(), cloud.len(), "one value per point");
    }
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment metres, world frame\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n",
        cloud.len()
    );
    for property in properties {
        header.push_str(&format!("property float {}\n", property.name));
    }
    header.push_str("end_header\n");
    let mut bytes = header.into_bytes();
    for (index, (point, color)) in cloud.points.iter().zip(&cloud.colors).enumerate() {
        point.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend(color);
        for property in properties {
            bytes.extend(property.values[index].to_le_bytes());
        }
    }
    write_atomically(path, |file| file.write_all(&bytes)).map_err(|source| PlyError {
        path: path.to_owned(),
        source,
    })
}
