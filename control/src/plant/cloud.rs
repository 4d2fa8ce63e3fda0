//! Clouds of a robot as a measurement.

use nalgebra::Vector3;
use tdcr_sim::cloud::{Observer, PointCloud, VoxelGrid};
use tdcr_sim::pose::Pose;
use tdcr_sim::render::{BaseVisibility, Sensor};
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;

/// How the cameras of a robot's file see it in each period; its base they do not show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudSensor {
    /// The cameras' faults.
    pub sensor: Sensor,
    /// Edge of the voxel grid that thins their clouds (m).
    pub voxel_size: f64,
    /// Most points of a measurement: more tell hardly more.
    pub most: usize,
}

impl CloudSensor {
    /// Intel's RealSense D435, in voxels of 3 mm and at most 600 points.
    pub fn d435() -> Self {
        Self {
            sensor: Sensor::d435(),
            voxel_size: 3e-3,
            most: 600,
        }
    }
}

/// At most so many points of a cloud (m, world frame), spread evenly over its order.
pub fn thinned(cloud: &PointCloud, most: usize) -> Vec<Vector3<f64>> {
    let (count, kept) = (cloud.len(), cloud.len().min(most));
    let at = |k: usize| Vector3::from(cloud.points[k * count / kept].map(f64::from));
    (0..kept).map(at).collect()
}

/// Cameras that see a simulated robot.
pub(super) struct Cameras {
    observer: Observer,
    sensor: CloudSensor,
}

impl Cameras {
    pub fn new(robot: &Robot, scene: &Scene, sensor: CloudSensor) -> Self {
        let grid = VoxelGrid::new(sensor.voxel_size);
        Self {
            observer: Observer::new(robot, BaseVisibility::Hidden, grid).among(scene),
            sensor,
        }
    }

    /// What they see in their `index`-th pictures.
    pub fn see(&mut self, pose: Pose<'_>, seed: u64, index: u64) -> Vec<Vector3<f64>> {
        let sensor = &self.sensor;
        let cloud = self.observer.measure(pose, &sensor.sensor, seed, index);
        thinned(&cloud, sensor.most)
    }
}
