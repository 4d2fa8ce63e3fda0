//! Corners of a board in images, by the crate `calib-targets-charuco`.

use calib_targets_charuco::{CharucoDetector, CharucoParams, GrayImageView};
use nalgebra::Vector2;

use super::board::{Board, BoardError};
use super::image::GreyImage;

/// A corner of a board in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Which one: [`Board::corner`] says where it is on the board.
    pub id: u32,
    /// Column and row (pixels, centres at integers).
    pub pixel: Vector2<f64>,
}

/// Finds a board in images.
#[derive(Debug)]
pub struct Detector {
    detector: CharucoDetector,
    corners: u32,
}

impl Detector {
    /// For images of `board`.
    ///
    /// # Errors
    /// [`BoardError`] where the detector cannot tell the board's placements apart.
    pub fn new(board: &Board) -> Result<Self, BoardError> {
        let parameters = CharucoParams::for_board(board.layout());
        let detector = CharucoDetector::new(parameters);
        let dictionary = &board.spec().dictionary;
        Ok(Self {
            detector: detector.map_err(|_| BoardError::Dictionary {
                found: dictionary.clone(),
            })?,
            corners: board.corners(),
        })
    }

    /// The corners found, by number; none where the board is not seen.
    ///
    /// Where the image shows not all of them it is tried again at twice its size: the filter that finds corners is ten pixels
    /// wide, so that small markers disturb it.
    pub fn detect(&self, image: &GreyImage) -> Vec<Corner> {
        let found = self.at_size(image);
        if found.len() == self.corners as usize || image.pixels().is_empty() {
            return found;
        }
        let mut enlarged = self.at_size(&image.doubled());
        for corner in &mut enlarged {
            corner.pixel = corner.pixel.map(|x| (x - 0.5) / 2.0);
        }
        if enlarged.len() > found.len() {
            enlarged
        } else {
            found
        }
    }

    fn at_size(&self, image: &GreyImage) -> Vec<Corner> {
        let [width, height] = image.size().map(|side| side as usize);
        let view = GrayImageView {
            width,
            height,
            data: image.pixels(),
        };
        // All of its errors say that there is no board in the image.
        let Ok(detection) = self.detector.detect(&view) else {
            return Vec::new();
        };
        let corner = |found: &calib_targets_charuco::CharucoCorner| Corner {
            id: found.id,
            pixel: found.position.coords.cast(),
        };
        let mut corners: Vec<Corner> = detection.corners.iter().map(corner).collect();
        corners.retain(|c| c.id < self.corners && c.pixel.iter().all(|x| x.is_finite()));
        corners.sort_by_key(|corner| corner.id);
        corners.dedup_by_key(|corner| corner.id);
        corners
    }
}
