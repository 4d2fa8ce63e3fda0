//! What cameras see.

use nalgebra::{Point3, Vector3};
use tdcr_sim::camera::{Camera, Distortion};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::geometry::{Instance, Shape, ShapeError};
use tdcr_sim::render::{BaseVisibility, RgbdFrame, Visuals};
use tdcr_sim::robot::{Loads, Payload, Robot, RobotSpec, RodDamping, RodSpec};

use crate::{bent_robot, distance_to_disc};

#[test]
fn the_ring_stands_as_the_paper_says() {
    let robot = Robot::load("2m").unwrap();
    let cameras = Camera::placed(&robot.spec().cameras);
    assert_eq!(cameras.len(), 8);
    let first = &cameras[0];
    assert!((first.pose.translation.vector - Vector3::new(0.0, -0.5, 0.27)).norm() < 1e-12);
    let k = &first.intrinsics;
    assert!((k.fy - 720.0 / (2.0 * 22.5f64.to_radians().tan())).abs() < 1e-9);
    assert_eq!((k.fx, k.cx, k.cy), (k.fy, 639.5, 359.5));
    for camera in &cameras {
        let axis = camera.pose.rotation * Vector3::z();
        assert!((axis.z + 0.1973f64.sin()).abs() < 1e-12, "pitched down");
        // The optical axis meets the z axis, and up in the world is up in the picture.
        let reach = 0.5 / axis.xy().norm();
        let met = camera.pose.translation.vector + axis * reach;
        assert!(met.xy().norm() < 1e-12);
        let (u, v, _) = camera
            .project(&Point3::from(met + Vector3::z() * 0.01))
            .unwrap();
        assert!((u - 639.5).abs() < 1e-9 && v < 359.5);
    }
}

#[test]
fn projection_undoes_back_projection() {
    let robot = Robot::load("5m").unwrap();
    for camera in Camera::placed(&robot.spec().cameras) {
        for (u, v, depth) in [(0.0, 0.0, 0.3), (1279.0, 719.0, 1.7), (640.25, 100.5, 0.9)] {
            let (u2, v2, depth2) = camera.project(&camera.back_project(u, v, depth)).unwrap();
            assert!(
                (u - u2).abs() < 1e-9 && (v - v2).abs() < 1e-9 && (depth - depth2).abs() < 1e-12
            );
        }
        assert!(
            camera
                .project(&camera.back_project(3.0, 4.0, -1.0))
                .is_none()
        );
    }
}

#[test]
fn every_pixel_shows_the_nearest_surface_along_its_ray() {
    let (robot, equilibrium) = bent_robot();
    let visuals = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Hidden);
    for camera in Camera::placed(&robot.spec().cameras) {
        let frame = visuals.render(&camera);
        let mut seen = 0;
        for v in 0..camera.intrinsics.height {
            for u in 0..camera.intrinsics.width {
                let index = frame.index(u, v);
                let Instance::Disc(disc) = frame.mask[index] else {
                    assert_eq!((frame.depth[index], frame.color[index]), (0.0, [0; 3]));
                    continue;
                };
                seen += 1;
                let depth = f64::from(frame.depth[index]);
                let point = camera.back_project(u.into(), v.into(), depth).coords;
                let off = distance_to_disc(&robot, &equilibrium, disc.into(), &point);
                assert!(off < 1e-7, "pixel ({u}, {v}) is {off} m off disc {disc}");
            }
        }
        // The reference measured 2.5 % of the pixels; this pose leans towards some cameras.
        assert!(
            (9_000..60_000).contains(&seen),
            "{seen} pixels show the robot"
        );
    }
}

#[test]
fn nearer_discs_hide_farther_ones() {
    let (robot, equilibrium) = bent_robot();
    let visuals = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Shown);
    for camera in Camera::placed(&robot.spec().cameras) {
        let together = visuals.render(&camera);
        for solid in &visuals.solids {
            let alone = Visuals {
                solids: vec![solid.clone()],
            }
            .render(&camera);
            for (index, instance) in alone.mask.iter().enumerate() {
                if *instance != Instance::Background {
                    assert!(
                        together.depth[index] > 0.0 && together.depth[index] <= alone.depth[index]
                    );
                }
            }
        }
    }
}

#[test]
fn a_reused_frame_keeps_nothing_of_the_picture_before() {
    let (robot, equilibrium) = bent_robot();
    let straight = robot.settle(&robot.mean_command(), &Loads::default());
    let camera = &Camera::placed(&robot.spec().cameras)[2];
    let bent = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Shown);
    let upright = Visuals::of_robot(&robot, &straight, BaseVisibility::Hidden);
    let mut reused = bent.render(camera);
    upright.render_into(camera, &mut reused);
    let fresh = upright.render(camera);
    assert_eq!(reused.depth, fresh.depth);
    assert_eq!(reused.mask, fresh.mask);
    assert_eq!(reused.color, fresh.color);
}

#[test]
fn pictures_do_not_depend_on_the_number_of_threads() {
    let (robot, equilibrium) = bent_robot();
    let cameras = Camera::placed(&robot.spec().cameras);
    let visuals = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Shown);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        // Frames with another picture in them, of another number of cameras.
        let mut frames = vec![visuals.render(&cameras[5]); 9];
        pool.install(|| visuals.render_all_into(&cameras, &mut frames));
        assert_eq!(frames.len(), cameras.len());
        for (camera, frame) in cameras.iter().zip(&frames) {
            let alone = visuals.render(camera);
            assert_eq!(frame.camera, alone.camera);
            assert!(frame.depth == alone.depth && frame.mask == alone.mask);
            assert!(frame.color == alone.color);
        }
    }
}

#[test]
fn what_the_user_adds_is_seen_and_labelled() {
    let (robot, equilibrium) = bent_robot();
    let camera = &Camera::placed(&robot.spec().cameras)[0];
    let mut visuals = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Hidden);
    let count = |visuals: &Visuals, instance| {
        let frame = visuals.render(camera);
        frame.mask.iter().filter(|&&seen| seen == instance).count()
    };
    let payload = |mass| Payload {
        mass,
        ..Payload::default()
    };
    visuals.add_payload(&robot, &equilibrium, &payload(0.0));
    assert_eq!(count(&visuals, Instance::Payload), 0, "no mass, no ball");
    visuals.add_payload(&robot, &equilibrium, &payload(0.03));
    // 30 g of steel are a ball of 9.7 mm radius, seen at about half a metre: 17 pixels of radius.
    assert!((300..1_500).contains(&count(&visuals, Instance::Payload)));
    let discs = |visuals: &Visuals| {
        (0..10)
            .map(|disc| count(visuals, Instance::Disc(disc)))
            .sum::<usize>()
    };
    let discs_before = discs(&visuals);
    visuals.add_tendons(&robot, &equilibrium);
    let tendons: usize = (0..6).map(|t| count(&visuals, Instance::Tendon(t))).sum();
    assert!((20..3_000).contains(&tendons), "{tendons}");
    // A pyramid before the camera hides the robot; its base is 4 cm wide, its tip towards the camera.
    let corner = |x, y| [x, y, 0.0];
    let vertices = [
        corner(-0.02, -0.02),
        corner(0.02, -0.02),
        corner(0.02, 0.02),
        corner(-0.02, 0.02),
        [0.0, 0.0, -0.02],
    ];
    let pyramid = Shape::mesh(&vertices, &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]).unwrap();
    let pose = camera.pose * nalgebra::Translation3::new(0.0, 0.0, 0.1);
    assert_eq!(
        visuals.add_obstacle(pyramid, pose, [9; 3]),
        Instance::Obstacle(0)
    );
    let frame = visuals.render(camera);
    let side = 2.0 * 0.02 / 0.1 * camera.intrinsics.fx;
    let area = frame
        .mask
        .iter()
        .filter(|&&seen| seen == Instance::Obstacle(0))
        .count();
    assert!((area as f64 / (side * side) - 1.0).abs() < 0.02, "{area}");
    let tip = frame.depth[frame.index(640, 360)];
    assert!((tip - 0.08).abs() < 2e-4, "{tip}");
    assert!(discs(&visuals) < discs_before);
    let ball = Shape::sphere(0.01).unwrap();
    assert_eq!(
        visuals.add_obstacle(ball, pose, [9; 3]),
        Instance::Obstacle(1)
    );
}

#[test]
fn a_shape_that_there_is_not_is_refused() {
    let message = |refused: Result<Shape, ShapeError>| refused.unwrap_err().to_string();
    let said = message(Shape::cylinder(0.02, -1.0));
    assert_eq!(
        said,
        "the half height of a cylinder is -1 m; expected a finite length above 0"
    );
    assert!(message(Shape::cuboid([1.0, f64::NAN, 1.0])).contains("half side of a box is NaN"));
    assert!(message(Shape::sphere(0.0)).contains("the radius of a sphere is 0 m"));
    assert!(
        message(Shape::capsule(1.0, f64::INFINITY)).contains("half length of a capsule is inf")
    );
    let triangle = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    assert!(message(Shape::mesh(&triangle, &[])).contains("no triangles"));
    let said = message(Shape::mesh(&triangle, &[[0, 1, 2], [0, 1, 3]]));
    assert_eq!(
        said,
        "triangle 1 of a mesh is [0, 1, 3]; the mesh has 3 vertices"
    );
    assert!(message(Shape::mesh(&[[f64::NAN; 3]], &[[0; 3]])).contains("vertex 0"));
}

#[test]
fn a_picture_of_a_real_camera_gives_the_same_cloud() {
    let (robot, equilibrium) = bent_robot();
    let camera = &Camera::placed(&robot.spec().cameras)[1];
    let frame = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Hidden).render(camera);
    let real = RgbdFrame::measured(camera, frame.color.clone(), frame.depth.clone()).unwrap();
    let cloud = |frame: &RgbdFrame| {
        let mut cloud = PointCloud::default();
        cloud.add_frame(frame);
        cloud
    };
    assert_eq!(cloud(&frame), cloud(&real));
    let known = |instance: &Instance| *instance != Instance::Background;
    let count = |frame: &RgbdFrame| frame.mask.iter().filter(|i| known(i)).count();
    assert_eq!(count(&frame), count(&real));
    let refused = RgbdFrame::measured(camera, frame.color, vec![0.0; 7]).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "the depth image has 7 pixels; the camera's have 921600"
    );
}

#[test]
fn points_are_back_projections_of_pixels_through_any_lens() {
    let (robot, equilibrium) = bent_robot();
    let mut camera = Camera::placed(&robot.spec().cameras)[3].clone();
    let visuals = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Shown);
    for distortion in [
        None,
        Some(Distortion {
            k1: -0.2,
            p1: 0.01,
            ..Distortion::default()
        }),
    ] {
        camera.intrinsics.distortion = distortion;
        let frame = visuals.render(&camera);
        let mut cloud = PointCloud::default();
        cloud.add_frame(&frame);
        let mut points = cloud.points.iter();
        for v in 0..camera.intrinsics.height {
            for u in 0..camera.intrinsics.width {
                let depth = f64::from(frame.depth[frame.index(u, v)]);
                if depth > 0.0 {
                    let expected = camera.back_project(u.into(), v.into(), depth).coords;
                    let point = Vector3::from(points.next().unwrap().map(f64::from));
                    assert!((point - expected).amax() < 1e-7);
                }
            }
        }
        assert!(points.next().is_none() && cloud.len() > 10_000);
    }
}

#[test]
fn the_rod_of_a_robot_is_seen_between_its_discs() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.gravity = [0.0; 3];
    let radius = 0.002;
    for module in &mut spec.modules {
        module.half_height = 0.003;
        module.joint_below = module.pitch / 2.0;
    }
    let pixels = |spec: &RobotSpec| {
        let robot = Robot::new(spec.clone()).unwrap();
        let equilibrium = robot.settle(&robot.mean_command(), &Loads::default());
        let visuals = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Hidden);
        let mut frame = visuals.render(&Camera::placed(&robot.spec().cameras)[0]);
        let mut heights = Vec::new();
        let others = frame
            .mask
            .iter()
            .enumerate()
            .filter(|(_, seen)| **seen != Instance::Rod);
        let others: Vec<usize> = others.map(|(pixel, _)| pixel).collect();
        others.iter().for_each(|&pixel| frame.depth[pixel] = 0.0);
        let mut cloud = PointCloud::default();
        cloud.add_frame(&frame);
        // Below the base's origin is the rod's rounded end.
        let base = spec.base.position[2] as f32;
        for [x, y, z] in cloud.points.into_iter().filter(|p| p[2] > base) {
            // The robot is straight: the rod's surface is at its radius from the z axis.
            assert!((x.hypot(y) - radius as f32).abs() < 2e-5, "{x} {y} {z}");
            heights.push(z);
        }
        heights
    };
    assert!(pixels(&spec).is_empty(), "no rod");
    for module in &mut spec.modules {
        module.rod = Some(RodSpec {
            youngs: 1e9,
            poisson: 0.3,
            radius,
            density: 1000.0,
            damping: RodDamping::default(),
        });
    }
    let heights = pixels(&spec);
    // Half of the way between the discs is free; a pixel is 0.6 mm wide.
    assert!(heights.len() > 500, "{} pixels", heights.len());
    let base = spec.base.position[2];
    let [low, high] = [0.002, 0.15].map(|height| (base + height) as f32);
    assert!(heights.iter().any(|&z| z < low + 0.004) && heights.iter().any(|&z| z > high));
}
