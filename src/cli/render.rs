//! `tdcr render`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use serde::Serialize;
use tdcr::learn::data::{NpzArray, NpzValues, write_npy};
use tdcr::pipeline::Noise;
use tdcr::report::counted;
use tdcr::sim::camera::Camera;
use tdcr::sim::cloud::{PointCloud, VoxelGrid, write_ply};
use tdcr::sim::contact::ContactSettler;
use tdcr::sim::geometry::{Instance, Shape};
use tdcr::sim::render::{BaseVisibility, RgbdFrame, Sensor, Visuals};
use tdcr::sim::robot::Robot;
use tdcr::sim::scene::Scene;

use super::console::Console;
use super::loads::{LoadArgs, LoadsJson};
use super::scene::SceneArgs;
use super::{CommandArg, command_of, images, output};

/// Render a settled robot with its cameras: colour, depth and mask images, and the fused cloud
#[derive(Debug, Args)]
pub(super) struct RenderArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    #[command(flatten)]
    command: CommandArg,
    #[command(flatten)]
    loads: LoadArgs,
    #[command(flatten)]
    scene: SceneArgs,
    /// Show the robot's base
    #[arg(long)]
    base: bool,
    /// Show a base of your own: an STL mesh in the frame of the robot's base (m)
    #[arg(long, value_name = "FILE", conflicts_with = "base")]
    base_mesh: Option<PathBuf>,
    /// Show more than the discs; may be given several times
    #[arg(long, value_enum, value_name = "WHAT")]
    show: Vec<Extra>,
    /// Simulate the noise of a real depth camera
    #[arg(long, value_enum)]
    noise: Option<Noise>,
    /// Seed of the faults
    #[arg(long, default_value_t = 0, requires = "noise")]
    seed: u64,
    /// Edge of the voxels that thin the fused cloud (m)
    #[arg(long, default_value_t = 0.002, value_parser = super::positive, value_name = "M")]
    voxel: f64,
    /// Folder to write to, empty or not there yet
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Extra {
    /// The payload, as a steel ball on the tip disc
    Payload,
    /// The tendons, as lines
    Tendons,
}

/// What `views.json` says.
#[derive(Serialize)]
struct Views<'a> {
    robot: &'a str,
    command: &'a [f64],
    #[serde(flatten)]
    loads: LoadsJson,
    sensor: Option<Sensor>,
    seed: u64,
    cameras: Vec<ViewFiles>,
    /// What the values in the mask images mean.
    mask: Vec<MaskValue>,
    cloud: &'static str,
    points: usize,
}

/// A camera and its images' file names.
#[derive(Serialize)]
struct ViewFiles {
    color: String,
    /// 16-bit, millimetres, 0 where there is none.
    depth_png: String,
    /// 32-bit float, metres, 0 where there is none.
    depth_npy: String,
    /// 16-bit, values as listed.
    mask: String,
    intrinsics: tdcr::sim::camera::Intrinsics,
    /// Centre of projection, world frame (m).
    position: [f64; 3],
    /// Orientation of the camera frame (x right, y down, z forward) in the world: (w, x, y, z).
    orientation: [f64; 4],
}

#[derive(Serialize)]
struct MaskValue {
    value: u16,
    instance: String,
    /// Of an obstacle, as its scene file has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    /// Pixels in all images.
    pixels: usize,
}

pub(super) fn run(args: &RenderArgs, console: &Console) -> anyhow::Result<()> {
    output::folder(
        "--out",
        &args.out,
        "a folder for the pictures of all cameras",
    )?;
    if !VoxelGrid::is_size(args.voxel) {
        let expected = VoxelGrid::EXPECTED_SIZE;
        anyhow::bail!("--voxel is {} m; expected {expected}", args.voxel);
    }
    let robot = Robot::new(args.robot.load()?)?;
    let command = command_of(args.command.lengths.as_deref(), &robot, "")?;
    let loads = args.loads.on(&robot)?;
    let scene = args.scene.load()?;
    let mut settler = ContactSettler::new(&robot, &scene);
    let equilibrium = &settler.settle(&command, &loads)?.equilibrium;
    if let Some(failure) = equilibrium.failure(&robot, &command) {
        return Err(failure.into());
    }
    let mesh = args.base_mesh.as_deref().map(Shape::read_stl).transpose()?;
    prepare(&args.out)?;
    let base = match args.base {
        true => BaseVisibility::Shown,
        false => BaseVisibility::Hidden,
    };
    let mut visuals = Visuals::of_robot(&robot, equilibrium, base);
    if let Some(mesh) = mesh {
        visuals.add_base(&robot, mesh);
    }
    if args.show.contains(&Extra::Payload) {
        visuals.add_payload(&robot, equilibrium, &loads.tip_payload());
    }
    if args.show.contains(&Extra::Tendons) {
        visuals.add_tendons(&robot, equilibrium);
    }
    visuals.add_scene(&scene);
    let sensor = args.noise.map(Noise::sensor);
    let frames = see(
        &visuals,
        &Camera::placed(&robot.spec().cameras),
        sensor,
        args.seed,
    );
    let mut cloud = PointCloud::default();
    frames.iter().for_each(|frame| cloud.add_frame(frame));
    let cloud = cloud.voxel_downsample(VoxelGrid::new(args.voxel));
    let views = Views {
        robot: &robot.spec().name,
        command: command.as_slice(),
        loads: LoadsJson::new(&loads),
        sensor,
        seed: args.seed,
        cameras: (frames.iter().enumerate())
            .map(|(index, frame)| write_frame(&args.out, index, frame))
            .collect::<anyhow::Result<_>>()?,
        mask: mask_values(&frames, &scene),
        cloud: "cloud.ply",
        points: cloud.len(),
    };
    write_ply(&args.out.join(views.cloud), &cloud)?;
    let text = serde_json::to_string_pretty(&views)? + "\n";
    output::write(&args.out.join("views.json"), text.as_bytes())?;
    console.summary(&views, |views| {
        let cameras = counted(views.cameras.len(), "view");
        let points = counted(views.points, "point");
        let folder = args.out.display();
        format!("{folder}: {cameras}, {points} in cloud.ply; views.json lists them")
    })
}

/// Makes the folder; one with something in it is left alone.
fn prepare(folder: &Path) -> anyhow::Result<()> {
    let context = || format!("cannot write to {}", folder.display());
    std::fs::create_dir_all(folder).with_context(context)?;
    if let Some(entry) = std::fs::read_dir(folder).with_context(context)?.next() {
        let name = entry.with_context(context)?.file_name();
        let (folder, name) = (folder.display(), name.display());
        bail!("{folder} has {name} in it already; expected an empty folder, or a new one");
    }
    Ok(())
}

fn see(visuals: &Visuals, cameras: &[Camera], sensor: Option<Sensor>, seed: u64) -> Vec<RgbdFrame> {
    let mut frames = Vec::new();
    visuals.render_all_into(cameras, &mut frames);
    if let Some(sensor) = sensor {
        for (index, frame) in frames.iter_mut().enumerate() {
            *frame = sensor.take(frame, seed, index as u64, 0);
        }
    }
    frames
}

fn write_frame(folder: &Path, index: usize, frame: &RgbdFrame) -> anyhow::Result<ViewFiles> {
    let pose = &frame.camera.pose;
    let rotation = pose.rotation;
    let view = ViewFiles {
        color: format!("camera{index}_color.png"),
        depth_png: format!("camera{index}_depth.png"),
        depth_npy: format!("camera{index}_depth.npy"),
        mask: format!("camera{index}_mask.png"),
        intrinsics: frame.camera.intrinsics,
        position: pose.translation.vector.into(),
        orientation: [rotation.w, rotation.i, rotation.j, rotation.k],
    };
    let size = [
        frame.camera.intrinsics.width,
        frame.camera.intrinsics.height,
    ];
    // `as` saturates: what is farther than 65.535 m has that depth.
    let millimetres = frame.depth.iter().map(|z| (1e3 * z).round() as u16);
    let values = frame.mask.iter().map(|instance| instance.value());
    let color = images::rgb_png(size, frame.color.as_flattened())?;
    output::write(&folder.join(&view.color), &color)?;
    output::write(
        &folder.join(&view.depth_png),
        &images::grey_png(size, millimetres)?,
    )?;
    let depth = NpzArray {
        name: "depth",
        shape: &[size[1] as usize, size[0] as usize],
        values: NpzValues::Floats(&frame.depth),
    };
    write_npy(&folder.join(&view.depth_npy), &depth)?;
    output::write(&folder.join(&view.mask), &images::grey_png(size, values)?)?;
    Ok(view)
}

fn name_of(instance: Instance) -> String {
    match instance {
        Instance::Background => "background".to_owned(),
        Instance::Base => "base".to_owned(),
        Instance::Payload => "payload".to_owned(),
        Instance::Unknown => "unknown".to_owned(),
        Instance::Rod => "rod".to_owned(),
        Instance::Disc(index) => format!("disc {index}"),
        Instance::Tendon(index) => format!("tendon {}", index + 1),
        Instance::Obstacle(index) => format!("obstacle {index}"),
    }
}

/// The instances that are seen, by value.
fn mask_values(frames: &[RgbdFrame], scene: &Scene) -> Vec<MaskValue> {
    let mut seen = BTreeMap::new();
    for &instance in frames.iter().flat_map(|frame| &frame.mask) {
        seen.entry(instance.value()).or_insert((instance, 0)).1 += 1;
    }
    let obstacle = |instance| match instance {
        Instance::Obstacle(index) => scene.obstacles().get(usize::from(index)),
        _ => None,
    };
    let seen = seen.into_iter();
    seen.map(|(value, (instance, pixels))| MaskValue {
        value,
        instance: name_of(instance),
        name: obstacle(instance).map(|obstacle| obstacle.name.clone()),
        pixels,
    })
    .collect()
}
