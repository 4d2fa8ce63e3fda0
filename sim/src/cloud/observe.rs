//! From an equilibrium to the cloud that a ring of cameras sees.

use super::back_project::RowPoints;
use super::voxels::CellSet;
use super::{PointCloud, VoxelGrid};
use crate::camera::Camera;
use crate::render::{BaseVisibility, RgbdFrame, Scene, Sensor};
use crate::robot::Robot;
use crate::statics::Equilibrium;

/// Sees settled robots with several cameras and fuses the frames into one cloud, reusing memory.
pub struct Observer<'a> {
    robot: &'a Robot,
    cameras: Vec<Camera>,
    base: BaseVisibility,
    grid: VoxelGrid,
    frame: Option<RgbdFrame>,
    row: RowPoints,
    occupied: CellSet,
}

impl<'a> Observer<'a> {
    /// Watches `robot` with the cameras of its specification.
    pub fn new(robot: &'a Robot, base: BaseVisibility, grid: VoxelGrid) -> Self {
        Self {
            robot,
            cameras: Camera::placed(&robot.spec().cameras),
            base,
            grid,
            frame: None,
            row: RowPoints::default(),
            occupied: CellSet::default(),
        }
    }

    /// The same cameras and grid, moved by half a pixel and half a voxel: what it sees of an
    /// equilibrium is a second, independent sample of the same surface.
    pub fn interleaved(&self) -> Self {
        let mut other = Self::new(self.robot, self.base, self.grid);
        for camera in &mut other.cameras {
            camera.intrinsics.cx += 0.5;
            camera.intrinsics.cy += 0.5;
        }
        for corner in &mut other.grid.origin {
            *corner += 0.5 * self.grid.size;
        }
        other
    }

    /// The fused cloud of the robot at rest: of the pixels of all cameras, in their order, the first
    /// in each voxel.
    pub fn observe(&mut self, equilibrium: &Equilibrium) -> PointCloud {
        self.fuse(equilibrium, |_, frame| frame)
    }

    /// The same as cameras with the faults of `sensor` see it, in their `index`-th pictures: see
    /// [`Sensor::take`].
    pub fn measure(
        &mut self,
        equilibrium: &Equilibrium,
        sensor: &Sensor,
        seed: u64,
        index: u64,
    ) -> PointCloud {
        self.fuse(equilibrium, |camera, truth| {
            sensor.take(&truth, seed, camera as u64, index)
        })
    }

    /// Fuses what `take` makes of each camera's picture.
    fn fuse(
        &mut self,
        equilibrium: &Equilibrium,
        take: impl Fn(usize, RgbdFrame) -> RgbdFrame,
    ) -> PointCloud {
        let scene = Scene::of_robot(self.robot, equilibrium, self.base);
        self.occupied.clear();
        let mut cloud = PointCloud::default();
        for (index, camera) in self.cameras.iter().enumerate() {
            let mut truth = (self.frame.take()).unwrap_or_else(|| RgbdFrame::new(camera));
            scene.render_into(camera, &mut truth);
            let frame = take(index, truth);
            let rows = 0..camera.intrinsics.height;
            for v in rows.filter(|&v| !frame.span(v).is_empty()) {
                self.row.take(&frame, v);
                self.row.find_cells(&self.grid);
                for (k, u) in frame.span(v).enumerate() {
                    let index = frame.index(u, v);
                    if frame.depth[index] > 0.0 && self.occupied.insert(self.row.cell(k)) {
                        cloud.push(self.row.point(k), frame.color[index]);
                    }
                }
            }
            self.frame = Some(frame);
        }
        cloud
    }
}
