//! Triangle meshes from STL files.

use std::path::{Path, PathBuf};

use tdcr_base::files::{LARGEST_MESH, read, without_mark};
use thiserror::Error;

use super::{Shape, ShapeError};

/// Why a mesh could not be read.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum StlError {
    /// The file could not be read.
    #[error("cannot read mesh {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not STL.
    #[error("mesh {} is not STL: {reason}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where, and what was expected there.
        reason: String,
    },
    /// The triangles are no mesh.
    #[error("mesh {}: {source}", path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: ShapeError,
    },
}

/// Length of a binary file's header and number of triangles, and of each triangle (bytes).
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

impl Shape {
    /// A triangle mesh from an STL file, binary or text, its numbers taken as metres.
    ///
    /// # Errors
    /// [`StlError`] when the file cannot be read, is not STL, or holds no mesh.
    pub fn read_stl(path: &Path) -> Result<Self, StlError> {
        let bytes = read(path, LARGEST_MESH).map_err(|source| StlError::Read {
            path: path.to_owned(),
            source,
        })?;
        let vertices = match binary(&bytes) {
            Some(vertices) => Ok(vertices),
            None => text(&bytes),
        };
        let vertices = vertices.map_err(|reason| StlError::Syntax {
            path: path.to_owned(),
            reason,
        })?;
        let triangles: Vec<[u32; 3]> = (0..vertices.len() as u32 / 3)
            .map(|triangle| [0, 1, 2].map(|corner| 3 * triangle + corner))
            .collect();
        Self::mesh(&vertices, &triangles).map_err(|source| StlError::Shape {
            path: path.to_owned(),
            source,
        })
    }
}

/// The corners of a binary file's triangles; `None` unless its length is that of its triangles.
fn binary(bytes: &[u8]) -> Option<Vec<[f64; 3]>> {
    let count = u32::from_le_bytes(*bytes.get(HEADER - 4..)?.first_chunk()?);
    let (triangles, rest) = bytes[HEADER..].as_chunks::<TRIANGLE>();
    if triangles.len() != count as usize || !rest.is_empty() {
        return None;
    }
    // After the normal, which the corners tell as well.
    let numbers = triangles
        .iter()
        .flat_map(|triangle| triangle[12..48].as_chunks::<4>().0);
    let numbers: Vec<f64> = numbers
        .map(|bytes| f32::from_le_bytes(*bytes).into())
        .collect();
    Some(numbers.as_chunks::<3>().0.to_vec())
}

/// The corners of a text file's triangles: three lines `vertex x y z` within each `facet`.
fn text(bytes: &[u8]) -> Result<Vec<[f64; 3]>, String> {
    let text = std::str::from_utf8(bytes)
        .ok()
        .map(without_mark)
        .filter(|text| text.trim_start().starts_with("solid"));
    let Some(text) = text else {
        let length = bytes.len();
        return Err(format!(
            "neither text that begins with `solid`, nor {length} bytes of the triangles it counts"
        ));
    };
    let mut vertices = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let at = |what: String| format!("line {}: {what}", index + 1);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("vertex") => {
                let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
                let vertex = <[f64; 3]>::try_from(numbers);
                vertices.push(vertex.map_err(|_| {
                    at(format!(
                        "`{}`; expected `vertex` and three numbers",
                        line.trim()
                    ))
                })?);
            }
            Some("endfacet") if vertices.len() % 3 != 0 => {
                return Err(at("a facet without three vertices".to_owned()));
            }
            _ => {}
        }
    }
    match vertices.len() % 3 {
        0 => Ok(vertices),
        _ => Err("the last facet has no end".to_owned()),
    }
}
