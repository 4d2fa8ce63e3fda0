//! What cameras see of a robot: images and clouds.

use nalgebra::{UnitQuaternion, Vector3};
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray2};
use pyo3::prelude::*;
use tdcr::pipeline::visibility;
use tdcr::sim::camera::Camera;
use tdcr::sim::chain::Configuration;
use tdcr::sim::cloud::{Observer, PointCloud, VoxelGrid, write_ply};
use tdcr::sim::geometry::Shape;
use tdcr::sim::pose::Pose;
use tdcr::sim::render::{RgbdFrame, Visuals};

use crate::arrays::{array, contiguous, quaternions};
use crate::errors::{Failure, Outcome};
use crate::loads::Loads;
use crate::options::sensor;
use crate::robot::Robot;
use crate::run;
use crate::scene::Scene;

/// Where all discs are, computed from the configuration.
pub struct Placed {
    configuration: Configuration,
    positions: Vec<Vector3<f64>>,
    orientations: Vec<UnitQuaternion<f64>>,
    /// Lengths and tensions, which nothing here looks at.
    none: Vec<f64>,
}

impl Placed {
    /// Places a robot in a configuration, shape (discs, 4).
    pub fn new(robot: &Robot, configuration: &PyReadonlyArray2<'_, f64>) -> Outcome<Self> {
        let discs = robot.0.discs().len();
        let joints = contiguous(configuration, "configuration", &[discs, 4])?;
        let configuration = Configuration(quaternions(joints));
        let (positions, orientations) = configuration.place(&robot.0);
        Ok(Self {
            configuration,
            positions,
            orientations,
            none: vec![0.0; robot.0.tendons().len()],
        })
    }

    /// The pose.
    pub fn pose(&self) -> Pose<'_> {
        Pose {
            configuration: &self.configuration,
            positions: &self.positions,
            orientations: &self.orientations,
            tendon_lengths: &self.none,
            tendon_tensions: &self.none,
        }
    }
}

/// One picture: what a camera is, and what it sees.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct View {
    color: Py<PyArray3<u8>>,
    depth: Py<PyArray2<f32>>,
    mask: Py<PyArray2<u16>>,
    /// fx, fy, cx, cy in pixels.
    intrinsics: [f64; 4],
    /// k1, k2, p1, p2, k3.
    distortion: [f64; 5],
    position: Py<PyArray1<f64>>,
    quaternion: Py<PyArray1<f64>>,
}

/// Pictures of a robot in a configuration by its own cameras.
#[pyfunction]
#[pyo3(signature = (robot, configuration, loads, base, base_mesh, payload, tendons, noise, seed, index, scene=None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn render(
    py: Python<'_>,
    robot: PyRef<'_, Robot>,
    configuration: PyReadonlyArray2<'_, f64>,
    loads: PyRef<'_, Loads>,
    base: bool,
    base_mesh: Option<std::path::PathBuf>,
    payload: bool,
    tendons: bool,
    noise: Option<&str>,
    seed: u64,
    index: u64,
    scene: Option<PyRef<'_, Scene>>,
) -> Outcome<Vec<View>> {
    let placed = Placed::new(&robot, &configuration)?;
    let sensor = sensor(noise)?;
    let (robot, loads) = (&robot.0, &loads.0);
    let scene = scene.map(|scene| scene.0.clone());
    let frames = run::long(py, None, |_| -> Outcome<Vec<RgbdFrame>> {
        let mut visuals = Visuals::of_robot(robot, placed.pose(), visibility(base));
        if let Some(path) = &base_mesh {
            let mesh = Shape::read_stl(path).map_err(|error| Failure::input(error.to_string()))?;
            visuals.add_base(robot, mesh);
        }
        if payload {
            visuals.add_payload(robot, placed.pose(), &loads.tip_payload());
        }
        if tendons {
            visuals.add_tendons(robot, placed.pose());
        }
        if let Some(scene) = &scene {
            visuals.add_scene(scene);
        }
        let mut frames = Vec::new();
        visuals.render_all_into(&Camera::placed(&robot.spec().cameras), &mut frames);
        if let Some(sensor) = sensor {
            for (camera, frame) in frames.iter_mut().enumerate() {
                *frame = sensor.take(frame, seed, camera as u64, index);
            }
        }
        Ok(frames)
    })??;
    frames.into_iter().map(|frame| view(py, frame)).collect()
}

/// A picture as arrays.
pub fn view(py: Python<'_>, frame: RgbdFrame) -> Outcome<View> {
    let lens = &frame.camera.intrinsics;
    let size = [lens.height as usize, lens.width as usize];
    let pose = &frame.camera.pose;
    let q = pose.rotation;
    let mask = frame.mask.iter().map(|instance| instance.value()).collect();
    Ok(View {
        color: array(py, frame.color.into_flattened(), [size[0], size[1], 3])?.unbind(),
        depth: array(py, frame.depth, size)?.unbind(),
        mask: array(py, mask, size)?.unbind(),
        intrinsics: [lens.fx, lens.fy, lens.cx, lens.cy],
        distortion: lens
            .distortion
            .map_or([0.0; 5], |distortion| distortion.coefficients()),
        position: PyArray1::from_slice(py, pose.translation.vector.as_slice()).unbind(),
        quaternion: PyArray1::from_slice(py, &[q.w, q.i, q.j, q.k]).unbind(),
    })
}

/// Clouds of a robot in each of several configurations, as its own cameras see them: points (m) and colours. Obstacles
/// of a scene hide what is behind them, and are not in the clouds.
#[pyfunction]
#[pyo3(signature = (robot, configurations, base, voxel, noise, seed, first, scene=None, progress=None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn clouds<'py>(
    py: Python<'py>,
    robot: PyRef<'_, Robot>,
    configurations: Vec<PyReadonlyArray2<'_, f64>>,
    base: bool,
    voxel: f64,
    noise: Option<&str>,
    seed: u64,
    first: u64,
    scene: Option<PyRef<'_, Scene>>,
    progress: Option<Bound<'_, PyAny>>,
) -> Outcome<Vec<Cloud<'py>>> {
    if !VoxelGrid::is_size(voxel) {
        let expected = VoxelGrid::EXPECTED_SIZE;
        let message = format!("the voxels' edge is {voxel} m; expected {expected}");
        return Err(Failure::input(message));
    }
    let placed: Vec<Placed> = configurations
        .iter()
        .map(|configuration| Placed::new(&robot, configuration))
        .collect::<Outcome<_>>()?;
    let sensor = sensor(noise)?;
    let scene = scene.map(|scene| scene.0.clone()).unwrap_or_default();
    let robot = &robot.0;
    let seen = run::long(py, progress.as_ref(), |watch| {
        use rayon::prelude::*;
        let observer =
            || Observer::new(robot, visibility(base), VoxelGrid::new(voxel)).among(&scene);
        let see = |observer: &mut Observer, (row, placed): (usize, &Placed)| {
            if watch.stopped() {
                return PointCloud::default();
            }
            let cloud = match &sensor {
                None => observer.observe(placed.pose()),
                Some(sensor) => observer.measure(placed.pose(), sensor, seed, first + row as u64),
            };
            watch.advance(1);
            cloud
        };
        placed
            .par_iter()
            .enumerate()
            .map_init(observer, see)
            .collect::<Vec<_>>()
    })?;
    let clouds = seen.into_iter();
    clouds.map(|cloud| cloud_arrays(py, cloud)).collect()
}

/// A cloud as arrays.
pub fn cloud_arrays(py: Python<'_>, cloud: PointCloud) -> Outcome<Cloud<'_>> {
    let count = cloud.len();
    let points = array(py, cloud.points.into_flattened(), [count, 3])?;
    let colors = array(py, cloud.colors.into_flattened(), [count, 3])?;
    Ok((points, colors))
}

/// Points (m) and colours.
pub type Cloud<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<u8>>);

/// Writes a cloud as PLY.
#[pyfunction]
pub fn save_ply(
    path: std::path::PathBuf,
    points: PyReadonlyArray2<'_, f32>,
    colors: PyReadonlyArray2<'_, u8>,
) -> Outcome<()> {
    let count = points.as_array().nrows();
    let cloud = PointCloud {
        points: contiguous(&points, "points", &[count, 3])?
            .as_chunks()
            .0
            .to_vec(),
        colors: contiguous(&colors, "colors", &[count, 3])?
            .as_chunks()
            .0
            .to_vec(),
    };
    write_ply(&path, &cloud).map_err(|error| Failure::Of("DataError", error.to_string()))
}
