//! RGB-D frames.

use std::ops::Range;

use crate::camera::Camera;

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Instance {
    /// Nothing.
    Background,
    /// The robot's base.
    Base,
    /// The disc with this index, from the base up.
    Disc(u16),
}

/// A rectangle of pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PixelBounds {
    /// Columns `u`.
    pub columns: Range<u32>,
    /// Rows `v`.
    pub rows: Range<u32>,
}

impl PixelBounds {
    /// Whether there is no pixel inside.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty() || self.rows.is_empty()
    }

    /// The smallest rectangle around both.
    fn union(&self, other: &Self) -> Self {
        if self.is_empty() {
            return other.clone();
        }
        let around = |a: &Range<u32>, b: &Range<u32>| a.start.min(b.start)..a.end.max(b.end);
        Self {
            columns: around(&self.columns, &other.columns),
            rows: around(&self.rows, &other.rows),
        }
    }
}

/// One picture of an RGB-D camera, with the instance mask that only a simulated one knows.
///
/// Images are row-major, `width * height`.
#[derive(Clone, Debug)]
pub struct RgbdFrame {
    /// The camera that took it.
    pub camera: Camera,
    /// Colours, 8-bit RGB; black on background.
    pub color: Vec<[u8; 3]>,
    /// Depth along the optical axis (m); 0 on background, as depth cameras report it.
    pub depth: Vec<f32>,
    /// What each pixel shows.
    pub mask: Vec<Instance>,
    touched: PixelBounds,
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
            touched: PixelBounds::default(),
        }
    }

    /// A rectangle outside which everything is background.
    pub fn touched(&self) -> &PixelBounds {
        &self.touched
    }

    /// Index of pixel `(u, v)` in the images.
    pub fn index(&self, u: u32, v: u32) -> usize {
        v as usize * self.camera.intrinsics.width as usize + u as usize
    }

    /// Makes the frame an empty picture of `camera`.
    pub(crate) fn clear_for(&mut self, camera: &Camera) {
        if self.camera.intrinsics != camera.intrinsics {
            *self = Self::new(camera);
            return;
        }
        self.camera = camera.clone();
        let touched = std::mem::take(&mut self.touched);
        for v in touched.rows {
            let row = self.index(touched.columns.start, v)..self.index(touched.columns.end, v);
            self.color[row.clone()].fill([0; 3]);
            self.depth[row.clone()].fill(0.0);
            self.mask[row].fill(Instance::Background);
        }
    }

    /// Notes that pixels in `bounds` are about to be drawn.
    pub(crate) fn touch(&mut self, bounds: &PixelBounds) {
        self.touched = self.touched.union(bounds);
    }
}
