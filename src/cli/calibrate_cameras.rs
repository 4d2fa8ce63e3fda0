//! `tdcr calibrate-cameras`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use serde::Serialize;
use serde_json::{Value, json};
use tdcr::hw::extrinsics::{
    Album, Board, CalibratedCamera, Calibration, CameraFile, RejectedCorner, World, calibrate,
    read_board,
};
use tdcr::report::counted;

use super::console::Console;
use super::{camera_overlaps, output};

/// Find where cameras are from views of a ChArUco board
///
/// Print the board (--print-board), measure a square, and put the board at 20 places or so, tilted to several sides, where two
/// neighbouring cameras or more see it; at each, take an image with every camera. Of noise 0.15 px, that gives eight cameras
/// around a robot to about 0.3 mm and 0.03 degrees.
#[derive(Debug, Args)]
pub(super) struct CalibrateCamerasArgs {
    /// Folder with the images, SERIAL/VIEW.png: in all images of a view the board stands at one place
    #[arg(value_name = "FOLDER", required_unless_present_any = ["print_board", "check"])]
    folder: Option<PathBuf>,
    /// The board (TOML): squares = [columns, rows], square and marker (edges in m), dictionary ("DICT_4X4_50" or another of
    /// OpenCV's); with a table [world], the view in which its position (m) and orientation (quaternion w, x, y, z) in the world
    /// are known. Without one, the first camera is the world
    #[arg(long, value_name = "FILE", required_unless_present = "check")]
    board: Option<PathBuf>,
    /// The cameras: a rig's file, or another with serial, lens, resolution and distortion of each
    #[arg(long, value_name = "FILE", required_unless_present_any = ["print_board", "check"])]
    cameras: Option<PathBuf>,
    /// File to write (.toml): that of the cameras with their poses in it, comments left out
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the board for printing (.svg or .png), to be printed at 100 %, and nothing else
    #[arg(long, value_name = "FILE", conflicts_with_all = ["folder", "cameras", "out"])]
    print_board: Option<PathBuf>,
    /// Say how well the pictures of the robot by the cameras of this rig's file lie on each other, and nothing else: distances of
    /// points that one camera sees from the surface that another sees. Nothing moves
    #[arg(long, value_name = "RIG", conflicts_with_all = ["folder", "board", "cameras", "out", "print_board"])]
    check: Option<PathBuf>,
}

/// What was found.
#[derive(Serialize)]
struct Found {
    tdcr_version: &'static str,
    units: Value,
    /// What the poses are relative to.
    world: String,
    /// Corners that served.
    corners: usize,
    /// Standard deviation of their errors each way (px).
    noise: f64,
    cameras: Vec<FoundCamera>,
    views: Vec<FoundView>,
    rejected: Vec<Rejected>,
}

#[derive(Serialize)]
struct FoundCamera {
    serial: String,
    /// Centre of projection, world frame (m), and its standard deviation along each axis.
    position: [f64; 3],
    position_deviation: [f64; 3],
    /// Orientation of the camera frame in the world: (w, x, y, z), and standard deviations about the world's axes (rad).
    orientation: [f64; 4],
    orientation_deviation: [f64; 3],
    images: usize,
    /// Images in which the board served.
    views: usize,
    corners: usize,
    reprojection_rms: f64,
}

#[derive(Serialize)]
struct FoundView {
    view: String,
    cameras: usize,
    reprojection_rms: f64,
}

#[derive(Serialize)]
struct Rejected {
    serial: String,
    view: String,
    corner: u32,
    /// Distance from where it should be (px); `None` where that is behind the camera.
    error: Option<f64>,
}

/// The board's file.
#[derive(Serialize)]
struct Printed {
    file: PathBuf,
    /// Width and height of the board without its margin (m).
    size: [f64; 2],
}

pub(super) fn run(args: &CalibrateCamerasArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(rig) = &args.check {
        return camera_overlaps::run(rig, console);
    }
    let Some(board) = &args.board else {
        bail!("expected --board, or --check");
    };
    let (board, world) = read_board(board)?;
    if let Some(file) = &args.print_board {
        return print(file, &board, console);
    }
    if let Some(out) = &args.out {
        output::format("--out", out, &["toml"])?;
    }
    let (Some(folder), Some(cameras)) = (&args.folder, &args.cameras) else {
        bail!("expected FOLDER and --cameras, or --print-board");
    };
    let cameras = CameraFile::read(cameras)?;
    let album = Album::read(folder, cameras.cameras(), &board)?;
    let found = calibrate(
        &board,
        cameras.cameras(),
        &album.views,
        &album.sightings,
        &world,
    )?;
    if let Some(out) = &args.out {
        let text = cameras
            .with_poses(&found)
            .context("cannot write the cameras as TOML")?;
        output::write(out, text)?;
    }
    console.result(&found_json(found, &album, &world), |found| {
        shown(found, args.out.as_deref())
    })
}

fn print(file: &Path, board: &Board, console: &Console) -> anyhow::Result<()> {
    match output::format("--print-board", file, &["svg", "png"])? {
        "svg" => output::write(file, board.to_svg())?,
        _ => output::write(file, board.to_png()?)?,
    }
    let printed = Printed {
        file: file.to_owned(),
        size: board.size(),
    };
    console.summary(&printed, |printed| {
        let [width, height] = printed.size.map(|side| 1e3 * side);
        let file = printed.file.display();
        format!("{file}: a board of {width:.1} mm x {height:.1} mm; print it at 100 %, and measure a square")
    })
}

fn found_json(found: Calibration, album: &Album, world: &World) -> Found {
    let camera = |(index, camera): (usize, CalibratedCamera)| {
        let pose = camera.camera.pose;
        let turn = pose.rotation;
        FoundCamera {
            serial: camera.serial,
            position: pose.translation.vector.into(),
            position_deviation: camera.position_deviation,
            orientation: [turn.w, turn.i, turn.j, turn.k],
            orientation_deviation: camera.orientation_deviation,
            images: album.sightings.iter().filter(|s| s.camera == index).count(),
            views: camera.views,
            corners: camera.corners,
            reprojection_rms: camera.reprojection_rms,
        }
    };
    let rejected = |RejectedCorner {
                        serial,
                        view,
                        corner,
                        error,
                    }| Rejected {
        serial,
        view,
        corner,
        error,
    };
    let views = found.views.into_iter().map(|placed| FoundView {
        view: placed.view,
        cameras: placed.cameras,
        reprojection_rms: placed.reprojection_rms,
    });
    Found {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        units: json!({
            "position": "m", "position_deviation": "m", "orientation_deviation": "rad", "noise": "px",
            "reprojection_rms": "px", "error": "px",
        }),
        world: match world {
            World::FirstCamera => "first camera".to_owned(),
            World::Board { view, .. } => format!("board in view {view}"),
        },
        corners: found.corners,
        noise: found.noise,
        cameras: found.cameras.into_iter().enumerate().map(camera).collect(),
        views: views.collect(),
        rejected: found.rejected.into_iter().map(rejected).collect(),
    }
}

fn shown(found: &Found, out: Option<&Path>) -> String {
    let mut text = String::new();
    let length = |parts: &[f64; 3]| parts.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Writing to a string cannot fail.
    for camera in &found.cameras {
        let [x, y, z] = camera.position;
        let _ = writeln!(
            text,
            "camera {}: at {x:.4}, {y:.4}, {z:.4} m, known to {:.2} mm and {:.3} degrees; board in {} of {}, {}, {:.2} px rms",
            camera.serial,
            1e3 * length(&camera.position_deviation),
            length(&camera.orientation_deviation).to_degrees(),
            camera.views,
            counted(camera.images, "image"),
            counted(camera.corners, "corner"),
            camera.reprojection_rms,
        );
    }
    let _ = write!(
        text,
        "world: {}; {} left out; noise of corners {:.2} px",
        found.world,
        counted(found.rejected.len(), "corner"),
        found.noise
    );
    if let Some(out) = out {
        let _ = write!(text, "; poses in {}", out.display());
    }
    text
}
