//! What is nearer than the empty scene was.

use tdcr_sim::render::RgbdFrame;

use super::{Mask, MaskError, Masker, Shot};

/// When a pixel is nearer than the empty scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackgroundSetting {
    /// By so many standard deviations of its depth there.
    pub deviations: f64,
    /// And by so much (m) than it ever was there.
    pub margin: f64,
}

impl Default for BackgroundSetting {
    /// 4 standard deviations, and 5 mm.
    fn default() -> Self {
        Self {
            deviations: 4.0,
            margin: 0.005,
        }
    }
}

/// Pictures of the empty scene that are needed at least.
const LEAST_PICTURES: u32 = 5;

/// Pixels with a depth that is less than that of the empty scene, or where the empty scene had none.
///
/// Statistics are of the inverse depth, in which a stereo camera's noise is everywhere the same.
#[derive(Clone, Debug)]
pub struct Background {
    views: Vec<View>,
}

/// The empty scene before one camera.
#[derive(Clone, Debug)]
struct View {
    size: [u32; 2],
    /// Largest inverse depth (1/m) that belongs to the empty scene; 0 where it had no depth.
    nearest: Vec<f32>,
}

/// Learns a [`Background`] from pictures of the empty scene, in memory that their number does not change.
#[derive(Clone, Debug, Default)]
pub struct BackgroundLearner {
    views: Vec<Statistics>,
}

#[derive(Clone, Debug, Default)]
struct Statistics {
    size: [u32; 2],
    pictures: u32,
    pixels: Vec<Pixel>,
}

/// Statistics of a pixel's inverse depth (1/m).
#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    count: u32,
    mean: f64,
    /// Sum of squares of the differences to the mean.
    squares: f64,
    largest: f64,
}

impl Pixel {
    /// Welford's update of mean and variance (Knuth, The Art of Computer Programming, 4.2.2).
    fn add(&mut self, inverse: f64) {
        self.count += 1;
        let before = inverse - self.mean;
        self.mean += before / f64::from(self.count);
        self.squares += before * (inverse - self.mean);
        self.largest = self.largest.max(inverse);
    }

    /// Largest inverse depth (1/m) that belongs to the empty scene.
    fn nearest(&self, setting: &BackgroundSetting) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        let deviation = (self.squares / f64::from(self.count.saturating_sub(1).max(1))).sqrt();
        let by_noise = self.mean + setting.deviations * deviation;
        let depth = 1.0 / self.largest - setting.margin;
        // A surface nearer than the margin leaves no room before it.
        let by_margin = if depth > 0.0 {
            1.0 / depth
        } else {
            f64::INFINITY
        };
        by_noise.max(by_margin)
    }
}

impl BackgroundLearner {
    /// One that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a picture of the empty scene by camera number `view`.
    ///
    /// # Errors
    /// [`MaskError::Size`] where it is of another size than that camera's first.
    pub fn add(&mut self, view: usize, frame: &RgbdFrame) -> Result<(), MaskError> {
        let k = &frame.camera.intrinsics;
        let size = [k.width, k.height];
        if self.views.len() <= view {
            self.views.resize_with(view + 1, Statistics::default);
        }
        let statistics = &mut self.views[view];
        if statistics.pictures == 0 {
            statistics.size = size;
            statistics.pixels = vec![Pixel::default(); frame.depth.len()];
        }
        if statistics.size != size {
            return Err(MaskError::Size {
                what: "the background".to_owned(),
                view,
                found: statistics.size,
                expected: size,
            });
        }
        statistics.pictures += 1;
        for (pixel, &depth) in statistics.pixels.iter_mut().zip(&frame.depth) {
            if depth > 0.0 {
                pixel.add(1.0 / f64::from(depth));
            }
        }
        Ok(())
    }

    /// The background of all cameras up to the last that was shown one.
    ///
    /// # Errors
    /// [`MaskError::TooFewPictures`] for a camera with fewer than five.
    pub fn finish(&self, setting: &BackgroundSetting) -> Result<Background, MaskError> {
        let view = |(view, statistics): (usize, &Statistics)| {
            if statistics.pictures < LEAST_PICTURES {
                return Err(MaskError::TooFewPictures {
                    view,
                    found: statistics.pictures,
                    least: LEAST_PICTURES,
                });
            }
            let nearest = statistics
                .pixels
                .iter()
                .map(|pixel| pixel.nearest(setting) as f32);
            Ok(View {
                size: statistics.size,
                nearest: nearest.collect(),
            })
        };
        let views = self.views.iter().enumerate().map(view);
        Ok(Background {
            views: views.collect::<Result<_, _>>()?,
        })
    }
}

impl Masker for Background {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        let background = self.views.get(shot.view).ok_or(MaskError::NoBackground {
            view: shot.view,
            learned: self.views.len(),
        })?;
        let k = &frame.camera.intrinsics;
        if background.size != [k.width, k.height] {
            return Err(MaskError::Size {
                what: "the background".to_owned(),
                view: shot.view,
                found: background.size,
                expected: [k.width, k.height],
            });
        }
        Ok(Mask::of_frame(frame, |index| {
            let depth = frame.depth[index];
            depth > 0.0 && 1.0 / depth > background.nearest[index]
        }))
    }
}
