//! One observation of a robot.

use tdcr_sim::cloud::PointCloud;

use super::Condition;

/// A condition and the cloud that the settled robot was seen as.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// What the robot was under.
    pub condition: Condition,
    /// The robot's visible surface, world frame (m).
    pub cloud: PointCloud,
}
