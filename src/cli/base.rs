//! Where the robot's base is, as an option.

use clap::Args;
use tdcr::sim::robot::Robot;

use super::numbers;

/// Where the base is.
#[derive(Debug, Args)]
pub(super) struct BaseArg {
    /// Where the robot's base is, in place of where its file has it: position (m) and orientation (a quaternion), world frame. Without a
    /// quaternion it keeps its orientation
    #[arg(long, value_name = "X,Y,Z[,QW,QX,QY,QZ]", value_parser = pose, allow_hyphen_values = true)]
    base: Option<BasePose>,
}

/// Position (m), and a quaternion (w, x, y, z) where one is given.
type BasePose = ([f64; 3], Option<[f64; 4]>);

impl BaseArg {
    /// The robot with its base there.
    pub fn put(&self, robot: Robot) -> anyhow::Result<Robot> {
        let Some((position, orientation)) = self.base else {
            return Ok(robot);
        };
        let orientation = orientation.unwrap_or(robot.spec().base.orientation);
        Ok(robot.with_base(position, orientation)?)
    }
}

/// Parses `X,Y,Z[,QW,QX,QY,QZ]`.
fn pose(text: &str) -> Result<BasePose, String> {
    match *numbers(text)? {
        [x, y, z] => Ok(([x, y, z], None)),
        [x, y, z, qw, qx, qy, qz] => Ok(([x, y, z], Some([qw, qx, qy, qz]))),
        ref other => Err(format!(
            "expected 3 numbers (m), or 7 with a quaternion, found {}",
            other.len()
        )),
    }
}
