//! Masks.

use tdcr_sim::geometry::Instance;
use tdcr_sim::render::RgbdFrame;

use super::MaskError;

/// The pixels of a picture that show the robot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    width: u32,
    height: u32,
    /// Row by row.
    pixels: Vec<bool>,
}

/// How far masks agree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overlap {
    /// Pixels in both.
    pub both: u64,
    /// Pixels in the first alone.
    pub first: u64,
    /// Pixels in the second alone.
    pub second: u64,
}

impl Overlap {
    /// Intersection over union; 1 where there is nothing in either.
    pub fn iou(&self) -> f64 {
        share(self.both, self.first + self.second)
    }

    /// Share of the first's pixels that are in the second too: the precision, where the second is the truth.
    pub fn precision(&self) -> f64 {
        share(self.both, self.first)
    }

    /// Share of the second's pixels that are in the first too: the recall, where the second is the truth.
    pub fn recall(&self) -> f64 {
        share(self.both, self.second)
    }

    /// Adds the counts of another picture.
    pub fn add(&mut self, other: Overlap) {
        self.both += other.both;
        self.first += other.first;
        self.second += other.second;
    }
}

/// Share of `part` in it and `rest`; 1 where there is neither.
fn share(part: u64, rest: u64) -> f64 {
    if part + rest == 0 {
        1.0
    } else {
        part as f64 / (part + rest) as f64
    }
}

impl Mask {
    /// A mask of the size of a frame, with the pixels for which `shows` holds; it is asked by their index, row by row.
    pub fn of_frame(frame: &RgbdFrame, shows: impl FnMut(usize) -> bool) -> Self {
        let k = &frame.camera.intrinsics;
        Self::of_size([k.width, k.height], shows)
    }

    /// A mask of this width and height, with the pixels for which `shows` holds; it is asked by their index, row by row.
    pub fn of_size([width, height]: [u32; 2], shows: impl FnMut(usize) -> bool) -> Self {
        Self {
            width,
            height,
            pixels: (0..width as usize * height as usize).map(shows).collect(),
        }
    }

    /// What shows the robot in a picture that says what its pixels show: discs, rods, tendons and payload; not its base, which
    /// stands still.
    pub fn of_robot(labelled: &RgbdFrame) -> Self {
        Self::of_frame(labelled, |index| {
            matches!(
                labelled.mask[index],
                Instance::Disc(_) | Instance::Rod | Instance::Tendon(_) | Instance::Payload
            )
        })
    }

    /// Width and height.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Its pixels, row by row.
    pub fn pixels(&self) -> &[bool] {
        &self.pixels
    }

    /// Number of pixels that show the robot.
    pub fn count(&self) -> usize {
        self.pixels.iter().filter(|shown| **shown).count()
    }

    /// The picture without the depth of what is not in the mask, which becomes background.
    ///
    /// # Errors
    /// [`MaskError::Size`] where they are of different sizes.
    pub fn applied(&self, frame: &RgbdFrame) -> Result<RgbdFrame, MaskError> {
        self.must_fit(frame, 0, "the mask")?;
        let mut kept = frame.clone();
        for (index, shown) in self.pixels.iter().enumerate() {
            if !shown {
                kept.depth[index] = 0.0;
                kept.mask[index] = Instance::Background;
            }
        }
        Ok(kept)
    }

    /// How this and `truth` agree, over the pixels of a picture for which `counts` holds of their index; `None` where they are
    /// of different sizes.
    pub fn overlap(&self, truth: &Mask, counts: impl Fn(usize) -> bool) -> Option<Overlap> {
        let mut overlap = Overlap::default();
        for (index, pair) in self.pixels.iter().zip(&truth.pixels).enumerate() {
            match pair {
                (true, true) if counts(index) => overlap.both += 1,
                (true, false) if counts(index) => overlap.first += 1,
                (false, true) if counts(index) => overlap.second += 1,
                _ => {}
            }
        }
        (self.size() == truth.size()).then_some(overlap)
    }

    /// Pixel by pixel with another mask of the same picture; those that either lacks are not shown.
    pub(super) fn combined(self, other: &Mask, with: impl Fn(bool, bool) -> bool) -> Self {
        let at = |index: usize| other.pixels.get(index).copied().unwrap_or(false);
        let pixels = (self.pixels.iter().enumerate()).map(|(index, shown)| with(*shown, at(index)));
        Self {
            pixels: pixels.collect(),
            ..self
        }
    }

    /// Says whether the mask is of a picture's size.
    pub(super) fn must_fit(
        &self,
        frame: &RgbdFrame,
        view: usize,
        what: &str,
    ) -> Result<(), MaskError> {
        let k = &frame.camera.intrinsics;
        let expected = [k.width, k.height];
        if self.size() == expected {
            return Ok(());
        }
        Err(MaskError::Size {
            what: what.to_owned(),
            view,
            found: self.size(),
            expected,
        })
    }
}
