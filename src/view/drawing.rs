//! What is drawn: shapes and colours once for each robot, poses with each frame.

use nalgebra::Isometry3;
use serde::Serialize;
use tdcr_sim::camera::Camera;
use tdcr_sim::geometry::{Dimensions, Instance, Solid};
use tdcr_sim::pose::Pose;
use tdcr_sim::render::{BaseVisibility, Visuals, tendon_holes};
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;
use tdcr_sim::statics::Stability;

use super::frame::Frame;

/// Kinds of equilibria, in the order that frames number them.
const STABILITIES: [Stability; 4] = [
    Stability::Stable,
    Stability::Neutral,
    Stability::Unstable,
    Stability::Flutter,
];

/// What stays the same while a robot is shown.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Layout {
    name: String,
    /// What a file of the robot says; `None` for one that TOML cannot hold.
    toml: Option<String>,
    /// Length of the straight robot (m).
    length: f64,
    /// What moves with the robot, and its base.
    solids: Vec<Drawn>,
    obstacles: Vec<Obstacle>,
    tendons: Vec<TendonSlider>,
    /// Number of discs.
    discs: usize,
    /// Names of kinds of equilibria.
    stabilities: [&'static str; 4],
    /// Commands that can be played.
    recorded: Vec<Vec<f64>>,
    /// Coefficient of friction in the tendons' holes, where the robot's file says one.
    friction: Option<f64>,
    /// Number of cameras.
    cameras: usize,
}

/// A solid.
#[derive(Clone, Debug, Serialize)]
struct Drawn {
    shape: Dimensions,
    color: [u8; 3],
    /// The disc that it is, from 0, if it is one.
    disc: Option<u16>,
}

#[derive(Clone, Debug, Serialize)]
struct Obstacle {
    name: String,
    #[serde(flatten)]
    drawn: Drawn,
    /// Position (m) and quaternion (x, y, z, w).
    pose: [f64; 7],
}

/// What a tendon's slider says.
#[derive(Clone, Debug, Serialize)]
struct TendonSlider {
    /// What it belongs to, such as `module 1`.
    group: String,
    low: f64,
    high: f64,
    unit: &'static str,
    /// Direction of the hole where it ends about the axis of its disc (rad).
    angle: f64,
    /// Number of holes that frames have of it.
    holes: usize,
}

impl Layout {
    pub fn new(robot: &Robot, scene: &Scene, pose: Pose<'_>, recorded: &[Vec<f64>]) -> Self {
        let spec = robot.spec();
        let groups = spec.tendon_groups();
        let group = |tendon: usize| groups.iter().find(|group| group.tendons.contains(&tendon));
        let tendons = robot.tendons().iter().enumerate();
        let tendons = tendons.map(|(index, tendon)| {
            let end = tendon
                .route
                .last()
                .and_then(|end| spec.hole_position(end.0, end.1));
            TendonSlider {
                group: group(index)
                    .map(|group| group.name.clone())
                    .unwrap_or_default(),
                low: tendon.range[0],
                high: tendon.range[1],
                unit: tendon.unit().symbol(),
                angle: end.map_or(0.0, |[x, y]| y.atan2(x)),
                holes: tendon.route.len(),
            }
        });
        Self {
            name: spec.name.clone(),
            toml: spec.to_toml().ok(),
            length: robot.arc_lengths().last().copied().unwrap_or(0.0),
            solids: solids(robot, pose).iter().map(Drawn::new).collect(),
            obstacles: obstacles(scene),
            tendons: tendons.collect(),
            discs: robot.discs().len(),
            stabilities: STABILITIES.map(Stability::name),
            recorded: recorded.to_vec(),
            friction: friction(robot),
            cameras: Camera::placed(&spec.cameras).len(),
        }
    }
}

impl Drawn {
    fn new(solid: &Solid) -> Self {
        let disc = match solid.instance {
            Instance::Disc(disc) => Some(disc),
            _ => None,
        };
        Self {
            shape: solid.shape.dimensions(),
            color: solid.color,
            disc,
        }
    }
}

/// What moves with the robot, and its base, in an order that does not change.
fn solids(robot: &Robot, pose: Pose<'_>) -> Vec<Solid> {
    Visuals::of_robot(robot, pose, BaseVisibility::Shown).solids
}

fn obstacles(scene: &Scene) -> Vec<Obstacle> {
    let mut seen = Visuals::default();
    seen.add_scene(scene);
    let named = scene.obstacles().iter().zip(&seen.solids);
    let named = named.map(|(obstacle, solid)| Obstacle {
        name: obstacle.name.clone(),
        drawn: Drawn::new(solid),
        pose: numbers(&solid.pose),
    });
    named.collect()
}

impl Frame {
    /// Takes over where everything is drawn.
    pub fn draw(&mut self, robot: &Robot, pose: Pose<'_>) {
        self.solids.clear();
        let solids = solids(robot, pose);
        self.solids
            .extend(solids.iter().map(|solid| numbers(&solid.pose)));
        self.holes.clear();
        let holes = tendon_holes(robot, pose);
        self.holes.extend(
            holes
                .iter()
                .flatten()
                .map(|hole| <[f64; 3]>::from(hole.coords)),
        );
    }

    /// Takes over what kind of equilibrium it is.
    pub fn tell_stability(&mut self, stability: Option<Stability>) {
        let place = |kind| STABILITIES.iter().position(|known| *known == kind);
        self.stability = stability.and_then(place).map_or(-1.0, |place| place as f64);
    }
}

fn numbers(pose: &Isometry3<f64>) -> [f64; 7] {
    let [x, y, z] = pose.translation.vector.into();
    let turn = pose.rotation.coords;
    [x, y, z, turn.x, turn.y, turn.z, turn.w]
}

/// The largest coefficient of friction that the file of a robot says of its tendons.
fn friction(robot: &Robot) -> Option<f64> {
    let tendons = robot.tendons().iter().filter_map(|tendon| tendon.friction);
    tendons
        .map(|friction| friction.coefficient)
        .reduce(f64::max)
}
