//! One observation of a robot.

use tdcr_sim::cloud::PointCloud;

/// A command and the cloud that the settled robot was seen as.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Command: tendon rest lengths (m), one per motor.
    pub motors: Vec<f32>,
    /// The robot's visible surface, world frame (m).
    pub cloud: PointCloud,
}
