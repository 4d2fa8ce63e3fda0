//! What is within a box of the world.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use tdcr_sim::render::RgbdFrame;

use super::{Mask, MaskError, Masker, Shot};

/// Pixels with a depth whose points lie within a box along the world's axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkspaceBox {
    /// Its corner of the smallest coordinates (m).
    pub low: [f64; 3],
    /// Its corner of the largest coordinates (m).
    pub high: [f64; 3],
}

impl WorkspaceBox {
    /// Whether a point of the world (m) is within it.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        let bounds = self.low.iter().zip(&self.high);
        (point.iter().zip(bounds)).all(|(x, (low, high))| (low..=high).contains(&x))
    }
}

impl Masker for WorkspaceBox {
    fn mask(&self, frame: &RgbdFrame, _: Shot) -> Result<Mask, MaskError> {
        let camera = &frame.camera;
        let width = camera.intrinsics.width as usize;
        Ok(Mask::of_frame(frame, |index| {
            let depth = f64::from(frame.depth[index]);
            let (u, v) = ((index % width) as f64, (index / width) as f64);
            depth > 0.0 && self.contains(&camera.back_project(u, v, depth))
        }))
    }
}
