//! PLY files.

use std::io::Write;
use std::path::{Path, PathBuf};

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

/// Writes a cloud as binary little-endian PLY: `x y z` (float, m) and `red green blue` (uchar).
///
/// # Errors
/// [`PlyError`] when the file cannot be written.
pub fn write_ply(path: &Path, cloud: &PointCloud) -> Result<(), PlyError> {
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment metres, world frame\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        cloud.len()
    );
    let mut bytes = header.into_bytes();
    for (point, color) in cloud.points.iter().zip(&cloud.colors) {
        point.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend(color);
    }
    std::fs::File::create(path)
        .and_then(|mut file| file.write_all(&bytes))
        .map_err(|source| PlyError {
            path: path.to_owned(),
            source,
        })
}
