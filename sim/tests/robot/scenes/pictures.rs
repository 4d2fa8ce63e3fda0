//! What cameras see of scenes.

use std::f64::consts::PI;
use std::fs;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use tdcr_sim::camera::{Camera, Intrinsics};
use tdcr_sim::geometry::{Instance, Shape};
use tdcr_sim::render::{BaseVisibility, RgbdFrame, Visuals};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};

use super::{SHELF, STL, scene};

/// A camera 1 m above the origin that looks down.
fn above() -> Camera {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    Camera {
        intrinsics: Intrinsics::from_fovy(201, 201, 40_f64.to_radians()),
        pose: Isometry3::from_parts(Translation3::new(0.0, 0.0, 1.0), turn),
    }
}

/// Depth (m), label and colour at the pixel nearest to a point of the world.
fn at(frame: &RgbdFrame, point: [f64; 3]) -> (f32, Instance, [u8; 3]) {
    let (u, v, _) = frame.camera.project(&Point3::from(point)).unwrap();
    let pixel = frame.index(u.round() as u32, v.round() as u32);
    (frame.depth[pixel], frame.mask[pixel], frame.color[pixel])
}

fn visuals_of(scene: &Scene) -> Visuals {
    let mut visuals = Visuals::default();
    visuals.add_scene(scene);
    visuals
}

fn seen(obstacles: Vec<Obstacle>) -> RgbdFrame {
    visuals_of(&Scene::new(obstacles).unwrap()).render(&above())
}

#[test]
fn an_obstacle_is_seen_where_it_is_in_its_colour_with_its_number() {
    let scene = scene(
        "[[obstacle]]
         half_space = {}
         position = [0, 0, -0.5]
         color = [10, 20, 30]
         [[obstacle]]
         box = { size = [0.2, 0.1, 0.3] }
         position = [0, 0, 0.05]
         color = [200, 100, 50]",
    );
    let frame = visuals_of(&scene.unwrap()).render(&above());
    // The box reaches up to 0.2 m, the plane lies at -0.5 m; both face the camera where it looks straight down.
    let (depth, instance, color) = at(&frame, [0.0, 0.0, 0.2]);
    assert!((depth - 0.8).abs() < 1e-6, "{depth}");
    assert_eq!((instance, color), (Instance::Obstacle(1), [200, 100, 50]));
    let (depth, instance, color) = at(&frame, [0.3, 0.3, -0.5]);
    assert!((depth - 1.5).abs() < 1e-6, "{depth}");
    assert_eq!(instance, Instance::Obstacle(0));
    // Seen at an angle, it is darker.
    let ratios = color.map(f64::from);
    assert!(
        color[0] <= 10 && color[2] > 20 && (ratios[1] - 2.0 * ratios[0]).abs() <= 2.0,
        "{color:?}"
    );
    // Sides are whole: 0.2 m along x, 0.1 m along y.
    for (place, is_box) in [
        ([0.097, 0.0, 0.2], true),
        ([0.103, 0.0, 0.2], false),
        ([0.0, 0.047, 0.2], true),
        ([0.0, 0.053, 0.2], false),
    ] {
        assert_eq!(
            at(&frame, place).1 == Instance::Obstacle(1),
            is_box,
            "{place:?}"
        );
    }
}

#[test]
fn round_shapes_are_seen_in_their_sizes() {
    let top = |obstacle: Obstacle| at(&seen(vec![obstacle]), [0.0; 3]).0;
    let height = |depth: f32| 1.0 - f64::from(depth);
    // Heights above the origin: half the length, with the round end of a capsule.
    let cylinder = Obstacle::cylinder("c", 0.05, 0.4).unwrap();
    assert!((height(top(cylinder)) - 0.2).abs() < 1e-6);
    let capsule = Obstacle::capsule("c", 0.05, 0.4).unwrap();
    assert!((height(top(capsule)) - 0.25).abs() < 1e-6);
    let ball = Obstacle::sphere("b", 0.05).unwrap().at([0.0, 0.0, 0.1]);
    assert!((height(top(ball)) - 0.15).abs() < 1e-6);
    // Turned to lie along the world's y axis.
    let lying = Obstacle::cylinder("c", 0.05, 0.4).unwrap();
    let frame = seen(vec![lying.with_orientation([1.0, 1.0, 0.0, 0.0]).unwrap()]);
    assert!((height(at(&frame, [0.0; 3]).0) - 0.05).abs() < 1e-6);
    assert_eq!(at(&frame, [0.0, 0.18, 0.05]).1, Instance::Obstacle(0));
    assert_eq!(at(&frame, [0.18, 0.0, 0.05]).1, Instance::Background);
}

#[test]
fn meshes_and_pipes_are_seen() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("part.stl");
    fs::write(&file, STL).unwrap();
    // A tetrahedron with sides of 0.2 m: its slanted face is at a height of 0.1 m above (0.05, 0.05).
    let frame = seen(vec![Obstacle::mesh("m", &file, 0.2).unwrap()]);
    let (depth, instance, _) = at(&frame, [0.05, 0.05, 0.1]);
    assert!((depth - 0.9).abs() < 4e-3, "{depth}");
    assert_eq!(instance, Instance::Obstacle(0));
    // Through a pipe that stands on the floor, the floor is seen; beside it the wall.
    let pipe = Obstacle::pipe("p", 0.05, 0.2).unwrap();
    let frame = seen(vec![Obstacle::half_space("f").at([0.0, 0.0, -0.1]), pipe]);
    assert_eq!(at(&frame, [0.0, 0.0, -0.1]).1, Instance::Obstacle(0));
    assert!(frame.mask.contains(&Instance::Obstacle(1)));
}

/// Its top is the plane of the obstacle's own frame, and it is 2 mm thick, 2 m wide.
#[test]
fn a_half_space_is_seen_as_a_thin_box_below_its_plane() {
    let turned = Obstacle::half_space("wall")
        .with_orientation([1.0, 1.0, 0.0, 0.0])
        .unwrap();
    let visuals = visuals_of(&Scene::new(vec![turned.at([1.0, 2.0, 3.0])]).unwrap());
    let solid = &visuals.solids[0];
    // Its z axis points along the world's -y.
    let top = solid.pose * Point3::new(0.0, 0.0, 0.001);
    assert!((top - Point3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
    let below = Point3::from(solid.pose.translation.vector) - top;
    assert!((below - Vector3::new(0.0, 0.001, 0.0)).norm() < 1e-12);
    let frame = seen(vec![Obstacle::half_space("floor").at([0.0, 0.0, -2.0])]);
    assert_eq!(at(&frame, [0.98, 0.98, -2.0]).1, Instance::Obstacle(0));
    assert_eq!(at(&frame, [1.02, 0.0, -2.0]).1, Instance::Background);
}

#[test]
fn obstacles_of_a_scene_are_counted_on_from_those_that_are_there() {
    let mut visuals = Visuals::default();
    let ball = Shape::sphere(0.01).unwrap();
    visuals.add_obstacle(ball, Isometry3::identity(), [9; 3]);
    visuals.add_scene(&scene(SHELF).unwrap());
    let labels: Vec<Instance> = visuals.solids.iter().map(|solid| solid.instance).collect();
    assert_eq!(labels, (0..8).map(Instance::Obstacle).collect::<Vec<_>>());
}

/// The example file stands around the robot 2m: every obstacle is in sight of one of its cameras at least, and so is every disc.
#[test]
fn the_example_is_seen_around_its_robot() {
    let robot = Robot::load("2m").unwrap();
    let command = robot
        .command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
        .unwrap();
    let equilibrium = robot.settle(&command, &Loads::default());
    let mut visuals = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Shown);
    let shelf = scene(SHELF).unwrap();
    visuals.add_scene(&shelf);
    let mut frames = Vec::new();
    visuals.render_all_into(&Camera::placed(&robot.spec().cameras), &mut frames);
    let count = |instance| {
        let pixels = frames.iter().flat_map(|frame| &frame.mask);
        pixels.filter(|seen| **seen == instance).count()
    };
    for (index, obstacle) in shelf.obstacles().iter().enumerate() {
        let pixels = count(Instance::Obstacle(index as u16));
        assert!(pixels > 2_000, "{}: {pixels}", obstacle.name);
    }
    assert!((0..10).all(|disc| count(Instance::Disc(disc)) > 1_000));
}
