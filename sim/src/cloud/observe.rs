//! From a robot's pose to the cloud that a ring of cameras sees.

use rand::{Rng, RngExt};

use super::back_project::RowPoints;
use super::voxels::CellSet;
use super::{PointCloud, VoxelGrid};
use crate::camera::Camera;
use crate::geometry::Instance;
use crate::pose::Pose;
use crate::render::{BaseVisibility, RgbdFrame, Sensor, Visuals};
use crate::robot::Robot;
use crate::scene::Scene;

/// Sees a robot with several cameras and fuses the frames into one cloud, reusing memory.
pub struct Observer {
    robot: Robot,
    cameras: Vec<Camera>,
    base: BaseVisibility,
    scene: Scene,
    grid: VoxelGrid,
    frame: Option<RgbdFrame>,
    row: RowPoints,
    occupied: CellSet,
}

impl Observer {
    /// Watches `robot` with the cameras of its specification.
    pub fn new(robot: &Robot, base: BaseVisibility, grid: VoxelGrid) -> Self {
        Self {
            robot: robot.clone(),
            cameras: Camera::placed(&robot.spec().cameras),
            base,
            scene: Scene::default(),
            grid,
            frame: None,
            row: RowPoints::default(),
            occupied: CellSet::default(),
        }
    }

    /// The same with obstacles around the robot. They hide from the cameras what is behind them; points on themselves are
    /// left out of the clouds, which show the robot.
    #[must_use]
    pub fn among(mut self, scene: &Scene) -> Self {
        self.surround(scene);
        self
    }

    /// Puts other obstacles around the robot, as [`among`](Self::among).
    pub fn surround(&mut self, scene: &Scene) {
        self.scene = scene.clone();
    }

    /// Moves the pixels of each camera, and the voxels, by a random part of one, as `rng` says: what it sees of an
    /// equilibrium from then on is another sample of the same surface, in a phase of its own.
    ///
    /// Two regular samplings of one surface lie farthest apart where their phases differ by a half. A random phase is
    /// what two independent samplings have.
    pub fn displace(&mut self, rng: &mut impl Rng) {
        self.cameras = Camera::placed(&self.robot.spec().cameras);
        for camera in &mut self.cameras {
            camera.intrinsics.cx += rng.random::<f64>();
            camera.intrinsics.cy += rng.random::<f64>();
        }
        for corner in &mut self.grid.origin {
            *corner = self.grid.size * rng.random::<f64>();
        }
    }

    /// The fused cloud of the robot in a pose, for example of an equilibrium: of the pixels of all cameras, in their order, the first
    /// in each voxel.
    pub fn observe<'a>(&mut self, pose: impl Into<Pose<'a>>) -> PointCloud {
        self.fuse(pose.into(), |_, frame| frame)
    }

    /// The same as cameras with the faults of `sensor` see it, in their `index`-th pictures: see
    /// [`Sensor::take`].
    pub fn measure<'a>(
        &mut self,
        pose: impl Into<Pose<'a>>,
        sensor: &Sensor,
        seed: u64,
        index: u64,
    ) -> PointCloud {
        self.fuse(pose.into(), |camera, truth| {
            sensor.take(&truth, seed, camera as u64, index)
        })
    }

    /// Fuses what `take` makes of each camera's picture.
    fn fuse(&mut self, pose: Pose, take: impl Fn(usize, RgbdFrame) -> RgbdFrame) -> PointCloud {
        let mut visuals = Visuals::of_robot(&self.robot, pose, self.base);
        visuals.add_scene(&self.scene);
        self.occupied.clear();
        let mut cloud = PointCloud::default();
        for (index, camera) in self.cameras.iter().enumerate() {
            let mut truth = (self.frame.take()).unwrap_or_else(|| RgbdFrame::new(camera));
            visuals.render_into(camera, &mut truth);
            let frame = take(index, truth);
            let rows = 0..camera.intrinsics.height;
            for v in rows.filter(|&v| !frame.span(v).is_empty()) {
                self.row.take(&frame, v);
                self.row.find_cells(&self.grid);
                for (k, u) in frame.span(v).enumerate() {
                    let index = frame.index(u, v);
                    let seen = frame.depth[index] > 0.0 && !is_obstacle(frame.mask[index]);
                    if seen && self.occupied.insert(self.row.cell(k)) {
                        cloud.push(self.row.point(k), frame.color[index]);
                    }
                }
            }
            self.frame = Some(frame);
        }
        cloud
    }
}

fn is_obstacle(instance: Instance) -> bool {
    matches!(instance, Instance::Obstacle(_))
}
