//! Folders of images.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use tdcr_base::files::read;

use super::board::Board;
use super::calibrate::{KnownCamera, Sighting};
use super::detect::Detector;
use super::files::{FilesError, reading};
use super::image::GreyImage;

/// Largest image (bytes). PNGs of 16384 x 16384 pixels take about as much.
const LARGEST_IMAGE: u64 = 256 << 20;

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
