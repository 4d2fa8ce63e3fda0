//! Camera calibration against cameras whose poses are known.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod accuracy;
mod boards;
mod overlap;
mod pictures;
mod refusals;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tdcr_hw::extrinsics::{Board, BoardSpec, Calibration, Corner, KnownCamera, Sighting, World};
use tdcr_sim::camera::{Camera, Distortion, Intrinsics};
use tdcr_sim::robot::{Aim, CameraSpec, Cameras, Lens, PinholeSpec, RingSpec, RobotSpec};

/// A board on a sheet of A3.
fn board() -> Board {
    Board::new(BoardSpec {
        squares: [9, 7],
        square: 0.035,
        marker: 0.026,
        dictionary: "DICT_4X4_50".into(),
    })
    .unwrap()
}

/// A wide lens's distortion.
const DISTORTION: Distortion = Distortion {
    k1: -0.05,
    k2: 0.06,
    p1: 0.0008,
    p2: -0.0006,
    k3: -0.02,
};

/// The paper's ring of eight around the robot `3m`, with lenses that distort.
fn ring() -> Vec<Camera> {
    let Cameras::Ring(ring) = RobotSpec::standard("3m").unwrap().cameras else {
        panic!("the paper's cameras are a ring");
    };
    Camera::ring(&RingSpec {
        distortion: Some(DISTORTION),
        ..ring
    })
}

/// Four D435 colour cameras around a robot, each at its own height, with the factory's kind of intrinsics.
fn four() -> Vec<Camera> {
    let places = [
        [0.62, 0.05, 0.42],
        [0.1, 0.7, 0.3],
        [-0.58, -0.08, 0.5],
        [0.02, -0.66, 0.35],
    ];
    let camera = |position| {
        Camera::free(&CameraSpec {
            position,
            aim: Aim::At([0.0, 0.0, 0.15]),
            lens: Lens::Pixels(PinholeSpec {
                focal: [912.3, 910.8],
                principal: [641.7, 363.2],
            }),
            resolution: [1280, 720],
            distortion: None,
        })
    };
    places.map(camera).into()
}

/// Where somebody holds the board in a view: near the middle, facing the gap between two neighbouring cameras so that both see
/// it, and tilted.
fn held(board: &Board, cameras: &[Camera], view: usize, rng: &mut ChaCha8Rng) -> Isometry3<f64> {
    let camera = |number: usize| cameras[number % cameras.len()].pose.translation.vector;
    let faced = (camera(view) + camera(view + 1)) / 2.0;
    let mut draw = |range: f64| rng.random_range(-range..range);
    let middle = Vector3::new(draw(0.1), draw(0.1), 0.15 + draw(0.08));
    // From the middle to the camera, turned aside by up to half a radian about each axis.
    let aside = UnitQuaternion::from_euler_angles(draw(0.5), draw(0.5), draw(0.5));
    let z = -(aside * (faced - middle)).normalize();
    let x = Vector3::z().cross(&-z).normalize();
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let turned = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), draw(3.0));
    let size = board.size();
    let corner = Vector3::new(-size[0] / 2.0, -size[1] / 2.0, 0.0);
    let rotation = turned * roll;
    Isometry3::from_parts(Translation3::from(middle + rotation * corner), rotation)
}

/// What a camera sees of the board, as a detector would find it, with errors of this deviation each way (pixels); at grazing
/// angles and beyond the image's edge nothing.
fn corners_seen(
    board: &Board,
    placed: &Isometry3<f64>,
    camera: &Camera,
    noise: f64,
    rng: &mut ChaCha8Rng,
) -> Vec<Corner> {
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let sight = placed.translation.vector - camera.pose.translation.vector;
    let facing = (placed * Vector3::z()).dot(&sight.normalize());
    if facing < 0.35 {
        return Vec::new();
    }
    let Intrinsics { width, height, .. } = camera.intrinsics;
    let mut corners = Vec::new();
    for id in 0..board.corners() {
        let point: Point3<f64> = placed * board.corner(id).unwrap();
        let Some((u, v, _)) = camera.project(&point) else {
            continue;
        };
        let inside = (5.0..f64::from(width) - 6.0).contains(&u)
            && (5.0..f64::from(height) - 6.0).contains(&v);
        if inside {
            let pixel = [u + noise * normal(), v + noise * normal()].into();
            corners.push(Corner { id, pixel });
        }
    }
    corners
}

/// The cameras without their poses.
fn known(cameras: &[Camera]) -> Vec<KnownCamera> {
    let known = |(index, camera): (usize, &Camera)| KnownCamera {
        serial: format!("cam{index}"),
        intrinsics: camera.intrinsics,
    };
    cameras.iter().enumerate().map(known).collect()
}

fn names(views: usize) -> Vec<String> {
    (0..views).map(|view| format!("view{view}")).collect()
}

/// Sightings of the board held in `views` places, and those places.
fn sightings(
    board: &Board,
    cameras: &[Camera],
    views: usize,
    noise: f64,
    rng: &mut ChaCha8Rng,
) -> (Vec<Sighting>, Vec<Isometry3<f64>>) {
    let placed: Vec<_> = (0..views)
        .map(|view| held(board, cameras, view, rng))
        .collect();
    let mut sightings = Vec::new();
    for (view, placed) in placed.iter().enumerate() {
        for (camera, seeing) in cameras.iter().enumerate() {
            sightings.push(Sighting {
                camera,
                view,
                corners: corners_seen(board, placed, seeing, noise, rng),
            });
        }
    }
    (sightings, placed)
}

/// Largest errors of the cameras' positions (m) and orientations (rad), in the frame of the first camera.
fn worst(cameras: &[Camera], found: &Calibration, world: &World) -> (f64, f64) {
    let truth = |camera: &Camera| match world {
        World::FirstCamera => cameras[0].pose.inverse() * camera.pose,
        World::Board { .. } => camera.pose,
    };
    let errors = cameras.iter().zip(&found.cameras).map(|(camera, found)| {
        let (truth, found) = (truth(camera), found.camera.pose);
        let apart = (truth.translation.vector - found.translation.vector).norm();
        (apart, truth.rotation.angle_to(&found.rotation))
    });
    errors.fold((0.0, 0.0), |worst, error| {
        (worst.0.max(error.0), worst.1.max(error.1))
    })
}
