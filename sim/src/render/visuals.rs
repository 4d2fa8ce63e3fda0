//! What the cameras see: the visuals of a robot and of what is around it, solids with poses and colours.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Point3, Translation3};
use serde::{Deserialize, Serialize};

use crate::geometry::{
    BASE_COLOR, Instance, Kind, Shape, Solid, Sphere, base_pose, base_solids, between, disc_solids,
    rod_solids,
};
use crate::pose::Pose;
use crate::robot::{Body, Payload, Robot, Waypoint};
use crate::scene::Scene;

const TENDON_COLOR: [u8; 3] = [60, 60, 60];
const PAYLOAD_COLOR: [u8; 3] = [150, 155, 165];
/// Radius that tendons are drawn with (m).
const TENDON_RADIUS: f64 = 0.0005;
/// Density of steel (kg/m³).
const STEEL: f64 = 7850.0;

/// Everything that cameras can see.
#[derive(Clone, Debug, Default)]
pub struct Visuals {
    /// The solids.
    pub solids: Vec<Solid>,
}

/// Whether the rigid base below the first module is seen: the paper's "with base" (WB)
/// and "no base" (NB) data sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BaseVisibility {
    /// The base is seen.
    Shown,
    /// The base is not there.
    Hidden,
}

impl Visuals {
    /// A robot in a pose, for example of an equilibrium: its discs, and the rods through them.
    pub fn of_robot<'a>(robot: &Robot, pose: impl Into<Pose<'a>>, base: BaseVisibility) -> Self {
        let pose = pose.into();
        let mut solids = match base {
            BaseVisibility::Shown => base_solids(robot),
            BaseVisibility::Hidden => Vec::new(),
        };
        let disc_pose = |disc| pose.disc(disc);
        solids.extend(disc_solids(robot, disc_pose));
        solids.extend(rod_solids(robot, disc_pose));
        Self { solids }
    }
}

impl Visuals {
    /// Adds a base of the user's own: a shape in the frame of the robot's base (m).
    pub fn add_base(&mut self, robot: &Robot, shape: Shape) {
        self.solids.push(Solid {
            shape,
            pose: base_pose(robot),
            color: BASE_COLOR,
            instance: Instance::Base,
        });
    }

    /// Adds the robot's tendons, as thin lines from hole to hole.
    pub fn add_tendons<'a>(&mut self, robot: &Robot, pose: impl Into<Pose<'a>>) {
        for (index, holes) in tendon_holes(robot, pose).iter().enumerate() {
            for ends in holes.windows(2) {
                let (shape, pose) = between([ends[0], ends[1]], TENDON_RADIUS);
                self.solids.push(Solid {
                    shape,
                    pose,
                    color: TENDON_COLOR,
                    instance: Instance::Tendon(index as u16),
                });
            }
        }
    }

    /// Adds a payload, as a steel ball of its mass that lies on the distal disc above the payload's
    /// offset; nothing for one without mass.
    pub fn add_payload<'a>(&mut self, robot: &Robot, pose: impl Into<Pose<'a>>, payload: &Payload) {
        let tip = robot.discs().len() - 1;
        let radius = (payload.mass / STEEL * 3.0 / (4.0 * PI)).cbrt();
        if radius > 0.0 {
            let [x, y, _] = payload.offset;
            let center = Translation3::new(x, y, robot.discs()[tip].half_height + radius);
            self.solids.push(Solid {
                shape: Shape(Kind::Sphere(Sphere { radius })),
                pose: pose.into().disc(tip) * center,
                color: PAYLOAD_COLOR,
                instance: Instance::Payload,
            });
        }
    }

    /// Adds an obstacle of a shape, at a pose in the world (m); returns what its pixels are labelled
    /// with.
    pub fn add_obstacle(&mut self, shape: Shape, pose: Isometry3<f64>, color: [u8; 3]) -> Instance {
        let instance = obstacle(self.obstacle_count());
        self.solids.push(Solid {
            shape,
            pose,
            color,
            instance,
        });
        instance
    }

    /// Adds the obstacles of a scene. They are labelled with their numbers in it, counted on from the obstacles that are there
    /// already.
    ///
    /// A pipe is seen as its [mesh](crate::geometry::Pipe::mesh), a half space as a box of 2 m by 2 m by 2 mm whose top is the
    /// plane about the origin of its frame.
    pub fn add_scene(&mut self, scene: &Scene) {
        let first = self.obstacle_count();
        for (index, added) in scene.obstacles().iter().enumerate() {
            let (shape, pose) = added.seen();
            self.solids.push(Solid {
                shape,
                pose,
                color: added.color,
                instance: obstacle(first + index),
            });
        }
    }

    fn obstacle_count(&self) -> usize {
        let is_obstacle = |solid: &&Solid| matches!(solid.instance, Instance::Obstacle(_));
        self.solids.iter().filter(is_obstacle).count()
    }
}

/// The holes that each tendon goes through, from the servo to where it is fastened, world frame (m).
pub fn tendon_holes<'a>(robot: &Robot, pose: impl Into<Pose<'a>>) -> Vec<Vec<Point3<f64>>> {
    let robot_pose = pose.into();
    let spec = robot.spec();
    let base = base_pose(robot);
    let hole = |waypoint: &Waypoint| {
        let [x, y] = spec.hole_position(waypoint.0, waypoint.1)?;
        Some(match waypoint.0 {
            Body::Base => base * Point3::new(x, y, spec.base.hole_height),
            Body::Disc(disc) => robot_pose.disc(disc) * Point3::new(x, y, 0.0),
        })
    };
    let tendons = robot.tendons().iter();
    tendons
        .map(|tendon| tendon.route.iter().filter_map(hole).collect())
        .collect()
}

/// The label of an obstacle; those beyond the largest share it.
fn obstacle(index: usize) -> Instance {
    Instance::Obstacle(u16::try_from(index).unwrap_or(u16::MAX))
}
