//! RGB-D frames.
//!
//! A frame knows a span of each row outside which all is background, so clearing it, back-projection and voxels pass over
//! the rest.

use std::ops::Range;

use thiserror::Error;

use crate::camera::Camera;
use crate::geometry::Instance;

/// One picture of an RGB-D camera, with the instance mask that only a simulated one knows.
///
/// Images are row-major, `width * height`.
#[derive(Clone, Debug)]
pub struct RgbdFrame {
    /// The camera that took it.
    pub camera: Camera,
    /// Colours, 8-bit RGB; black on background.
    pub color: Vec<[u8; 3]>,
    /// Depth along the optical axis (m); 0 where there is none, as depth cameras report it.
    pub depth: Vec<f32>,
    /// What each pixel shows.
    pub mask: Vec<Instance>,
    /// Per row, the columns outside which everything is background.
    pub(super) spans: Vec<Span>,
}

/// Columns of a row: from, to (not included).
pub(super) type Span = [u32; 2];

/// Why images are not a frame of a camera.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("the {image} image has {found} pixels; the camera's have {expected}")]
pub struct FrameError {
    /// Which image.
    pub image: &'static str,
    /// Its pixels.
    pub found: usize,
    /// The camera's pixels.
    pub expected: usize,
}

impl RgbdFrame {
    /// An empty picture: background everywhere.
    pub fn new(camera: &Camera) -> Self {
        let pixels = camera.intrinsics.width as usize * camera.intrinsics.height as usize;
        Self {
            camera: camera.clone(),
            color: vec![[0; 3]; pixels],
            depth: vec![0.0; pixels],
            mask: vec![Instance::Background; pixels],
            spans: vec![[0; 2]; camera.intrinsics.height as usize],
        }
    }

    /// A picture of a real camera: colours, and depth along the optical axis (m) with 0 where there
    /// is none, row-major. What is not background is [`Instance::Unknown`].
    ///
    /// # Errors
    /// [`FrameError`] unless both images are of the camera's size.
    pub fn measured(
        camera: &Camera,
        color: Vec<[u8; 3]>,
        depth: Vec<f32>,
    ) -> Result<Self, FrameError> {
        let [width, height] = [camera.intrinsics.width, camera.intrinsics.height];
        let expected = width as usize * height as usize;
        for (image, found) in [("colour", color.len()), ("depth", depth.len())] {
            if found != expected {
                return Err(FrameError {
                    image,
                    found,
                    expected,
                });
            }
        }
        let instance = |depth: &f32| match *depth > 0.0 {
            true => Instance::Unknown,
            false => Instance::Background,
        };
        Ok(Self {
            camera: camera.clone(),
            mask: depth.iter().map(instance).collect(),
            color,
            depth,
            spans: vec![[0, width]; height as usize],
        })
    }

    /// The columns of row `v` outside which everything is background.
    pub fn span(&self, v: u32) -> Range<u32> {
        let [from, to] = self.spans[v as usize];
        from..to
    }

    /// Index of pixel `(u, v)` in the images.
    pub fn index(&self, u: u32, v: u32) -> usize {
        v as usize * self.camera.intrinsics.width as usize + u as usize
    }

    /// Makes the frame one of `camera`, with the old picture still in it.
    pub(super) fn turn_to(&mut self, camera: &Camera) {
        let size = |camera: &Camera| (camera.intrinsics.width, camera.intrinsics.height);
        if size(&self.camera) == size(camera) {
            self.camera = camera.clone();
        } else {
            *self = Self::new(camera);
        }
    }
}
