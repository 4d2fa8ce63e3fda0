//! Where cameras are: their poses from views of a ChArUco board.
//!
//! The board is put at several places; at each, all cameras take a picture (a view). A [`Detector`] finds its [`Corner`]s,
//! [`calibrate`] gives the poses of all cameras in one frame with their standard deviations. Cameras that never see the board
//! at the same time are related over others.
//!
//! # Example
//!
//! Two cameras and four places of the board, the corners computed in place of detected.
//!
//! ```
//! use nalgebra::{Isometry3, Vector3};
//! use tdcr_hw::extrinsics::{Board, BoardSpec, Corner, KnownCamera, Sighting, World, calibrate};
//! use tdcr_sim::camera::{Camera, Intrinsics};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let board = Board::new(BoardSpec {
//!     squares: [7, 5],
//!     square: 0.03,
//!     marker: 0.022,
//!     dictionary: "DICT_4X4_50".into(),
//! })?;
//! let intrinsics = Intrinsics::from_fovy(640, 480, 0.8);
//! let second = Isometry3::new(Vector3::new(0.3, 0.0, 0.1), Vector3::new(0.0, -0.4, 0.0));
//! let cameras = [Isometry3::identity(), second].map(|pose| Camera { intrinsics, pose });
//! let mut sightings = Vec::new();
//! for view in 0..4 {
//!     let turn = Vector3::new(0.4, 0.3 * f64::from(view) - 0.5, 0.2);
//!     let placed = Isometry3::new(Vector3::new(-0.1, -0.1, 0.6), turn);
//!     for (number, camera) in cameras.iter().enumerate() {
//!         let corner = |id| {
//!             let (u, v, _) = camera.project(&(placed * board.corner(id)?))?;
//!             Some(Corner { id, pixel: [u, v].into() })
//!         };
//!         let corners = (0..board.corners()).filter_map(corner).collect();
//!         sightings.push(Sighting { camera: number, view: view as usize, corners });
//!     }
//! }
//! let known = ["left", "right"].map(|serial| KnownCamera { serial: serial.into(), intrinsics });
//! let views = ["a", "b", "c", "d"].map(String::from);
//! let found = calibrate(&board, &known, &views, &sightings, &World::FirstCamera)?;
//! let error = found.cameras[1].camera.pose.translation.vector - second.translation.vector;
//! assert!(error.norm() < 1e-6);
//! # Ok(())
//! # }
//! ```

mod adjust;
mod album;
mod board;
mod calibrate;
mod detect;
mod files;
mod graph;
mod image;
mod outcome;
mod overlap;
mod picture;
mod planar;
mod print;
mod project;

pub use album::Album;
pub use board::{Board, BoardError, BoardSpec};
pub use calibrate::{KnownCamera, Sighting, World, calibrate};
pub use detect::{Corner, Detector};
pub use files::{CameraFile, FilesError, read_board};
pub use image::{GreyImage, PngError};
pub use outcome::{
    CalibratedCamera, Calibration, CalibrationError, FEWEST_CORNERS, PlacedBoard, RejectedCorner,
};
pub use overlap::{Overlap, overlaps};
pub use picture::{Exposure, picture};
pub use print::PrintError;
