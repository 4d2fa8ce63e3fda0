//! RGB-D images and masks of [`Visuals`] by casting rays at their shapes.
//!
//! Each solid is cast only at the pixels that it can cover, so background costs nothing: its
//! extents bound columns and rows, and of a cylinder or a sphere the outline bounds each row.
//! Colours are lit by a head light: brightest where the surface faces the camera.

mod cast;
mod frame;
mod lanes;
mod sensor;
mod view;
mod visuals;

pub use frame::{FrameError, RgbdFrame};
pub use sensor::{Edges, ExtrinsicError, Grazing, Sensor};
pub use visuals::{BaseVisibility, Visuals, tendon_holes};

use rayon::prelude::*;

use crate::camera::Camera;
use view::{Band, View};

/// Rows that one thread draws in one go.
const BAND: usize = 60;

impl Visuals {
    /// Sees the solids with `camera` on one thread, writing to `frame`, whose memory is reused.
    pub fn render_into(&self, camera: &Camera, frame: &mut RgbdFrame) {
        frame.turn_to(camera);
        View::of(self, camera).draw(&mut Band {
            first_row: 0,
            color: &mut frame.color,
            depth: &mut frame.depth,
            mask: &mut frame.mask,
            spans: &mut frame.spans,
        });
    }

    /// Sees the solids with `camera` on one thread.
    pub fn render(&self, camera: &Camera) -> RgbdFrame {
        let mut frame = RgbdFrame::new(camera);
        self.render_into(camera, &mut frame);
        frame
    }

    /// Sees the solids with all `cameras` on all threads, writing to `frames`, one for each, whose
    /// memory is reused.
    pub fn render_all_into(&self, cameras: &[Camera], frames: &mut Vec<RgbdFrame>) {
        frames.truncate(cameras.len());
        for camera in &cameras[frames.len()..] {
            frames.push(RgbdFrame::new(camera));
        }
        cameras.par_iter().zip(frames).for_each(|(camera, frame)| {
            frame.turn_to(camera);
            let view = View::of(self, camera);
            let pixels = BAND * camera.intrinsics.width as usize;
            let images = frame
                .color
                .par_chunks_mut(pixels)
                .zip(frame.depth.par_chunks_mut(pixels))
                .zip(frame.mask.par_chunks_mut(pixels));
            let bands = images.zip(frame.spans.par_chunks_mut(BAND)).enumerate();
            bands.for_each(|(index, (((color, depth), mask), spans))| {
                view.draw(&mut Band {
                    first_row: (index * BAND) as u32,
                    color,
                    depth,
                    mask,
                    spans,
                });
            });
        });
    }
}
