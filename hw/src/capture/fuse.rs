//! From pictures to one cloud.

use tdcr_sim::cloud::{PointCloud, VoxelGrid};

use crate::camera::Stamped;
use crate::mask::{MaskError, Masker, Shot};
use crate::rig::Pictures;

/// Keeps what is the robot in the pictures of all cameras, and fuses it, in voxels.
pub struct Fuser {
    /// The grid that thins the cloud.
    pub grid: VoxelGrid,
    /// What tells the robot from all else.
    pub masker: Box<dyn Masker>,
}

impl Fuser {
    /// The pictures without the depth of what is not the robot, of sample number `sample`.
    ///
    /// # Errors
    /// [`MaskError`].
    pub fn keep_robot(&self, pictures: Pictures, sample: usize) -> Result<Pictures, MaskError> {
        let frames = pictures.frames.into_iter().enumerate();
        let frames = frames.map(|(view, frame)| {
            let mask = self.masker.mask(&frame.value, Shot { view, sample })?;
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

    /// The cloud of pictures in which all but the robot has no depth.
    pub fn fuse(&self, pictures: &Pictures) -> PointCloud {
        let mut cloud = PointCloud::default();
        for frame in &pictures.frames {
            cloud.add_frame(&frame.value);
        }
        cloud.voxel_downsample(self.grid)
    }
}
