//! From a rig file's masks to what tells the robot from all else.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tdcr_sim::render::RgbdFrame;

use super::RigError;
use super::file::RigFile;
use super::masks::{BackgroundSpec, ComponentsSpec, LargestSpec, MasksSpec};
use crate::camera::{CameraError, RgbdCamera};
use crate::clock::VirtualClock;
use crate::mask::{
    Any, Background, BackgroundLearner, BackgroundSetting, Keep, Mask, MaskError, Masker, Not, Shot,
};
use crate::recorded::RecordedCamera;

/// All pixels with a depth: the start of other masks.
#[derive(Clone, Copy, Debug)]
struct Seen;

impl Masker for Seen {
    fn mask(&self, frame: &RgbdFrame, _: Shot) -> Result<Mask, MaskError> {
        Ok(Mask::of_frame(frame, |index| frame.depth[index] > 0.0))
    }
}

impl MasksSpec {
    fn masker(&self, file: &RigFile, field: &str) -> Result<Box<dyn Masker>, RigError> {
        let mut masker: Box<dyn Masker> = Box::new(Seen);
        if let Some(workspace) = self.workspace {
            masker = Box::new(masker.and(workspace));
        }
        if let Some(color) = self.color {
            masker = Box::new(masker.and(color));
        }
        if let Some(background) = &self.background {
            let field = format!("{field}.background");
            masker = Box::new(masker.and(background.read(file, &field)?));
        }
        if !self.any.is_empty() {
            let any = self.any.iter().enumerate();
            let any = any.map(|(k, masks)| masks.masker(file, &format!("{field}.any[{k}]")));
            masker = Box::new(masker.and(Any(any.collect::<Result<_, _>>()?)));
        }
        if let Some(not) = &self.not {
            let not = not.masker(file, &format!("{field}.not"))?;
            masker = Box::new(masker.and(Not(not)));
        }
        if let Some(ComponentsSpec { pixels, gap }) = self.components {
            masker = Box::new(masker.keeping(Keep::AtLeast(pixels), gap));
        }
        if let Some(LargestSpec { gap }) = self.largest {
            masker = Box::new(masker.keeping(Keep::Largest, gap));
        }
        Ok(masker)
    }
}

impl BackgroundSpec {
    /// Learns the background from the log.
    fn read(&self, file: &RigFile, field: &str) -> Result<Background, RigError> {
        let path = file.resolve(&self.log);
        let field = format!("{field}.log");
        let unavailable = |error: &dyn std::error::Error| {
            let reason = format!(
                "{error}; expected a log of the empty scene by all of the rig's cameras, as `tdcr background` writes it"
            );
            file.located(RigError::unavailable(&field, reason))
        };
        let mut learner = BackgroundLearner::new();
        for (view, camera) in file.spec.cameras.iter().enumerate() {
            let clock = Arc::new(VirtualClock::new());
            let mut camera = RecordedCamera::open(&path, &camera.serial, clock)
                .map_err(|error| unavailable(&error))?;
            loop {
                match camera.grab_after(Duration::ZERO, Duration::MAX) {
                    Ok(picture) => {
                        let added = learner.add(view, &picture.value);
                        added.map_err(|error| unavailable(&error))?;
                    }
                    Err(CameraError::Device { source, .. })
                        if source.kind() == io::ErrorKind::UnexpectedEof =>
                    {
                        break;
                    }
                    Err(error) => return Err(unavailable(&error)),
                }
            }
        }
        let setting = BackgroundSetting {
            deviations: self.deviations,
            margin: self.margin,
        };
        learner
            .finish(&setting)
            .map_err(|error| unavailable(&error))
    }
}

impl RigFile {
    /// What tells the robot from all else, with the empty scene read from its log where the file names one.
    ///
    /// # Errors
    /// [`RigError::Unavailable`] for a log that cannot be read, or lacks a camera.
    pub fn masker(&self) -> Result<Box<dyn Masker>, RigError> {
        self.spec.masks.masker(self, "masks")
    }
}
