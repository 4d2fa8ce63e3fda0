//! From pictures to one cloud.

use tdcr_sim::cloud::{PointCloud, VoxelGrid};

use crate::rig::{BoxSpec, Pictures};

/// Fuses the pictures of all cameras: what is the robot in them, in voxels.
#[derive(Clone, Debug)]
pub struct Fuser {
    /// The grid that thins the cloud.
    pub grid: VoxelGrid,
    /// Where points may be (m, world); anywhere where there is none.
    pub workspace: Option<BoxSpec>,
}

impl Fuser {
    /// The cloud of pictures in which all but the robot has no depth.
    pub fn fuse(&self, pictures: &Pictures) -> PointCloud {
        let mut cloud = PointCloud::default();
        for frame in &pictures.frames {
            cloud.add_frame(&frame.value);
        }
        if let Some(BoxSpec { low, high }) = self.workspace {
            let mut kept = PointCloud::default();
            for (point, color) in cloud.points.iter().zip(&cloud.colors) {
                let axes = point.iter().zip(low.iter().zip(&high));
                if axes
                    .into_iter()
                    .all(|(&x, (&low, &high))| (low..=high).contains(&f64::from(x)))
                {
                    kept.push(*point, *color);
                }
            }
            cloud = kept;
        }
        cloud.voxel_downsample(self.grid)
    }
}
