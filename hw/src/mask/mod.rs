//! Foreground masks: which pixels of a picture show the robot.
//!
//! A [`Masker`] says so for each [`Shot`]; maskers combine by `and`, `or`, [`Any`], [`Not`] and [`Masker::keeping`]. What is masked
//! becomes a cloud like any other frame: [`Mask::applied`] takes the depth of all else.
//!
//! - [`Background`]: nearer than the empty scene was. Needs fixed cameras, and nothing else that moves.
//! - [`WorkspaceBox`]: within a box of the world. Needs extrinsics.
//! - [`ColorKey`]: of some range of colours.
//! - [`Components`]: what hangs together, the largest of it or all that is not small; around another masker.
//! - [`MaskFolder`]: what another program, such as SAM 2, has written to a folder.
//!
//! How well each does on rendered pictures of a D435 stands in `docs/masks.md`.
//!
//! ```
//! use tdcr_hw::mask::{Masker, Shot, WorkspaceBox};
//! use tdcr_sim::camera::Camera;
//! use tdcr_sim::render::RgbdFrame;
//! use tdcr_sim::robot::Robot;
//!
//! let robot = Robot::load("2m")?;
//! let camera = &Camera::placed(&robot.spec().cameras)[0];
//! let (color, depth) = (vec![[0; 3]; 1280 * 720], vec![0.5; 1280 * 720]);
//! let frame = RgbdFrame::measured(camera, color, depth)?;
//!
//! let workspace = WorkspaceBox { low: [-0.3, -0.3, 0.1], high: [0.3, 0.3, 0.9] };
//! let mask = workspace.mask(&frame, Shot { view: 0, sample: 0 })?;
//! let robot_alone = mask.applied(&frame)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod background;
mod color;
mod combine;
mod components;
mod folder;
mod pixels;
mod workspace;

pub use background::{Background, BackgroundLearner, BackgroundSetting};
pub use color::ColorKey;
pub use combine::{And, Any, Not, Or};
pub use components::{Components, Keep};
pub use folder::MaskFolder;
pub use pixels::{Mask, Overlap};
pub use workspace::WorkspaceBox;

use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use tdcr_sim::render::RgbdFrame;
use thiserror::Error;

/// Which picture it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Shot {
    /// Number of its camera, from 0.
    pub view: usize,
    /// Number of its sample, from 0.
    pub sample: usize,
}

/// Why there is no mask.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum MaskError {
    /// An image of another size.
    #[error("{what} has {} x {} pixels; expected {} x {}, as the picture of camera {view}", found[0], found[1], expected[0], expected[1])]
    Size {
        /// What it is.
        what: String,
        /// Number of the camera.
        view: usize,
        /// Its width and height.
        found: [u32; 2],
        /// The picture's.
        expected: [u32; 2],
    },
    /// No background for this camera.
    #[error(
        "no background of camera {view} was learned; there are {learned} cameras with one: show each the empty scene first"
    )]
    NoBackground {
        /// Number of the camera.
        view: usize,
        /// Cameras with a background.
        learned: usize,
    },
    /// Too few pictures of the empty scene.
    #[error(
        "{found} pictures of the empty scene of camera {view}; expected {least} at least, to tell noise from things"
    )]
    TooFewPictures {
        /// Number of the camera.
        view: usize,
        /// Pictures seen.
        found: u32,
        /// Pictures needed.
        least: u32,
    },
    /// A file that cannot be read.
    #[error("cannot read the mask of camera {view} and sample {sample} from {}: {source}; expected an image per camera and sample, named as camera0/000000.png", path.display())]
    Read {
        /// Number of the camera.
        view: usize,
        /// Number of the sample.
        sample: usize,
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A file that is no such image.
    #[error("{} is no mask: {what}; expected a PNG image of 8 bits, grey or of indexed colours, 0 where the robot is not", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
}

/// Tells the robot from everything else in pictures.
pub trait Masker: Send + Sync {
    /// The pixels of a picture that show the robot.
    ///
    /// # Errors
    /// [`MaskError`] where it cannot tell.
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError>;

    /// What this and another take for the robot.
    fn and<M: Masker>(self, other: M) -> And<Self, M>
    where
        Self: Sized,
    {
        And(self, other)
    }

    /// What this or another takes for the robot.
    fn or<M: Masker>(self, other: M) -> Or<Self, M>
    where
        Self: Sized,
    {
        Or(self, other)
    }

    /// The components that are kept of what this takes for the robot; pixels hang together over gaps of up to `gap` pixels.
    fn keeping(self, keep: Keep, gap: u32) -> Components<Self>
    where
        Self: Sized,
    {
        Components {
            of: self,
            keep,
            gap,
        }
    }
}

impl<M: Masker + ?Sized> Masker for Box<M> {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        (**self).mask(frame, shot)
    }
}

impl<M: Masker + ?Sized> Masker for Arc<M> {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        (**self).mask(frame, shot)
    }
}

#[cfg(test)]
mod tests;
