//! From pictures to one cloud.

use std::sync::Arc;

use tdcr_sim::cloud::{PointCloud, VoxelGrid};

use crate::camera::Stamped;
use crate::mask::{Mask, MaskError, Masker, Shot};
use crate::rig::Pictures;

/// Keeps what is the robot in the pictures of all cameras, and fuses it, in voxels.
pub struct Fuser {
    /// The grid that thins the cloud.
    pub grid: VoxelGrid,
    /// What tells the robot from all else.
    pub masker: Arc<dyn Masker>,
}

/// The pictures without the depth of what `masker` does not take for the robot, of sample number `sample`.
///
/// # Errors
/// [`MaskError`].
pub(super) fn masked(
    masker: &dyn Masker,
    pictures: &Pictures,
    sample: usize,
) -> Result<Pictures, MaskError> {
    only(&masks(masker, pictures, sample)?, pictures)
}

/// What `masker` takes for the robot in each picture of sample number `sample`.
fn masks(masker: &dyn Masker, pictures: &Pictures, sample: usize) -> Result<Vec<Mask>, MaskError> {
    let frames = pictures.frames.iter().enumerate();
    let masks = frames.map(|(view, frame)| masker.mask(&frame.value, Shot { view, sample }));
    masks.collect()
}

/// The pictures without the depth of what is not in their masks.
fn only(masks: &[Mask], pictures: &Pictures) -> Result<Pictures, MaskError> {
    let frames = pictures.frames.iter().zip(masks);
    let frames = frames.map(|(frame, mask)| {
        Ok(Stamped {
            time: frame.time,
            value: mask.applied(&frame.value)?,
        })
    });
    Ok(Pictures {
        frames: frames.collect::<Result<_, MaskError>>()?,
        skew: pictures.skew,
    })
}

impl Fuser {
    /// The pictures without the depth of what is not the robot, of sample number `sample`.
    ///
    /// # Errors
    /// [`MaskError`].
    pub fn keep_robot(&self, pictures: &Pictures, sample: usize) -> Result<Pictures, MaskError> {
        masked(&self.masker, pictures, sample)
    }

    /// What shows the robot in each of the pictures, of sample number `sample`.
    ///
    /// # Errors
    /// [`MaskError`].
    pub fn masks(&self, pictures: &Pictures, sample: usize) -> Result<Vec<Mask>, MaskError> {
        masks(&self.masker, pictures, sample)
    }

    /// The cloud of what is in the masks of pictures.
    ///
    /// # Errors
    /// [`MaskError::Size`] for a mask that is not of its picture's size.
    pub fn fuse_masked(
        &self,
        pictures: &Pictures,
        masks: &[Mask],
    ) -> Result<PointCloud, MaskError> {
        Ok(self.fuse(&only(masks, pictures)?))
    }

    /// The cloud of pictures in which all but the robot has no depth.
    pub fn fuse(&self, pictures: &Pictures) -> PointCloud {
        let mut cloud = PointCloud::default();
        for frame in &pictures.frames {
            cloud.add_frame(&frame.value);
        }
        cloud.voxel_downsample(self.grid)
    }
}
