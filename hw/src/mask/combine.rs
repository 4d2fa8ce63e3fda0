//! Maskers of maskers.

use tdcr_sim::render::RgbdFrame;

use super::{Mask, MaskError, Masker, Shot};

/// What both take for the robot.
#[derive(Clone, Debug)]
pub struct And<A, B>(pub A, pub B);

/// What either takes for the robot.
#[derive(Clone, Debug)]
pub struct Or<A, B>(pub A, pub B);

/// What any of several takes for the robot.
pub struct Any(pub Vec<Box<dyn Masker>>);

/// What another does not take for the robot.
#[derive(Clone, Debug)]
pub struct Not<M>(pub M);

impl<A: Masker, B: Masker> Masker for And<A, B> {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        let other = self.1.mask(frame, shot)?;
        Ok(self.0.mask(frame, shot)?.combined(&other, |a, b| a && b))
    }
}

impl<A: Masker, B: Masker> Masker for Or<A, B> {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        let other = self.1.mask(frame, shot)?;
        Ok(self.0.mask(frame, shot)?.combined(&other, |a, b| a || b))
    }
}

impl<M: Masker> Masker for Not<M> {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        let mask = self.0.mask(frame, shot)?;
        Ok(Mask::of_size(mask.size(), |index| !mask.pixels()[index]))
    }
}

impl Masker for Any {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        let nothing = Mask::of_frame(frame, |_| false);
        self.0.iter().try_fold(nothing, |mask, masker| {
            Ok(mask.combined(&masker.mask(frame, shot)?, |a, b| a || b))
        })
    }
}
