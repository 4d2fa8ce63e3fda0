//! What the faults of a real camera do to a picture: each by its own statistics.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use tdcr_sim::camera::{Camera, Intrinsics};
use tdcr_sim::cloud::{Observer, VoxelGrid};
use tdcr_sim::geometry::{Instance, Shape};
use tdcr_sim::render::{
    BaseVisibility, Edges, ExtrinsicError, Grazing, RgbdFrame, Sensor, Visuals,
};
use tdcr_sim::robot::{Loads, Robot};

fn camera() -> Camera {
    Camera {
        intrinsics: Intrinsics::from_fovy(640, 360, 45f64.to_radians()),
        pose: Isometry3::identity(),
    }
}

/// A wall at `distance` (m) in front of the camera, turned by `turn` (rad) about the vertical.
fn wall(distance: f64, turn: f64, half_side: f64) -> RgbdFrame {
    let mut visuals = Visuals::default();
    let slab = Shape::cuboid([half_side, half_side, 1e-4]).unwrap();
    let pose = Isometry3::from_parts(
        Translation3::new(0.0, 0.0, distance),
        UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn),
    );
    visuals.add_obstacle(slab, pose, [128; 3]);
    visuals.render(&camera())
}

/// Depths of the pixels that show something: true, measured.
fn depths(truth: &RgbdFrame, seen: &RgbdFrame) -> Vec<(f64, f64)> {
    let pairs = truth.depth.iter().zip(&seen.depth);
    pairs
        .filter(|(z, _)| **z > 0.0)
        .map(|(z, seen)| ((*z).into(), (*seen).into()))
        .collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = values.map(|x| x * x).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn a_camera_without_faults_sees_the_truth() {
    let truth = wall(0.5, 0.3, 0.1);
    let seen = Sensor::ideal().take(&truth, 1, 2, 3);
    for (z, seen) in depths(&truth, &seen) {
        assert!((z - seen).abs() <= 1e-7);
    }
    assert_eq!((seen.color, seen.camera), (truth.color, truth.camera));
}

#[test]
fn depth_noise_grows_with_the_square_of_the_distance() {
    let sensor = Sensor {
        disparity_noise: Some(0.08),
        ..Sensor::ideal()
    };
    for distance in [0.4, 0.8, 1.6] {
        let truth = wall(distance, 0.0, 1.0);
        let seen = sensor.take(&truth, 1, 0, 0);
        let pairs = depths(&truth, &seen);
        assert!(pairs.len() > 100_000);
        let z = distance - 1e-4;
        let expected = z * z / (camera().intrinsics.fx * sensor.baseline) * 0.08;
        let found = rms(pairs.iter().map(|(z, seen)| seen - z));
        assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
        let bias = pairs.iter().map(|(z, seen)| seen - z).sum::<f64>() / pairs.len() as f64;
        assert!(bias.abs() < 0.05 * expected, "{bias}");
    }
}

#[test]
fn disparities_are_multiples_of_the_step() {
    let sensor = Sensor {
        disparity_step: Some(1.0 / 32.0),
        ..Sensor::ideal()
    };
    let truth = wall(0.7, 0.6, 0.2);
    let seen = sensor.take(&truth, 1, 0, 0);
    let scale = camera().intrinsics.fx * sensor.baseline;
    let pairs = depths(&truth, &seen);
    let steps = |z: f64| 32.0 * scale / z;
    for &(z, seen) in &pairs {
        assert!((steps(seen) - steps(seen).round()).abs() < 1e-3);
        assert!((steps(seen) - steps(z)).abs() < 0.501);
    }
    // Errors of rounding are uniform.
    let found = rms(pairs.iter().map(|&(z, seen)| steps(seen) - steps(z)));
    assert!((found - 1.0 / 12f64.sqrt()).abs() < 0.01, "{found}");
}

#[test]
fn nothing_is_seen_nearer_than_the_minimum_range() {
    let sensor = Sensor {
        max_disparity: Some(126.0),
        ..Sensor::ideal()
    };
    let nearest = camera().intrinsics.fx * sensor.baseline / 126.0;
    for (factor, expected) in [(0.99, 0.0), (1.01, 1.0)] {
        let truth = wall(nearest * factor + 1e-4, 0.0, 1.0);
        let pairs = depths(&truth, &sensor.take(&truth, 1, 0, 0));
        let share = pairs.iter().filter(|(_, seen)| *seen > 0.0).count() as f64;
        assert_eq!(share / pairs.len() as f64, expected);
    }
}

#[test]
fn surfaces_at_a_slant_are_lost_in_proportion() {
    let sensor = Sensor {
        grazing: Some(Grazing { limit: 0.3 }),
        ..Sensor::ideal()
    };
    for turn in [0.5f64, 1.35, 1.45] {
        let truth = wall(0.6, turn, 0.2);
        let seen = sensor.take(&truth, 1, 0, 0);
        let normal = Vector3::new(turn.sin(), 0.0, turn.cos());
        let (mut expected, mut lost, mut count) = (0.0, 0, 0);
        for v in 0..360 {
            // Pixels at the outline show the wall's edge.
            let shown = |u: u32| truth.mask[truth.index(u, v)] != Instance::Background;
            for u in (2..638).filter(|&u| (u - 2..=u + 2).all(shown)) {
                let ray = truth.camera.ray(u.into(), v.into()).normalize();
                expected += (1.0 - ray.dot(&normal).abs() / 0.3).max(0.0);
                lost += u32::from(seen.depth[truth.index(u, v)] == 0.0);
                count += 1;
            }
        }
        let (found, expected) = (
            f64::from(lost) / f64::from(count),
            expected / f64::from(count),
        );
        assert!(
            count > 3_000 && (found - expected).abs() < 0.02,
            "{found} {expected}"
        );
    }
}

#[test]
fn pixels_at_edges_are_lost_or_fly_between_the_two_sides() {
    let mut visuals = Visuals::default();
    for (distance, side) in [(0.5, 0.05), (0.7, 1.0)] {
        let slab = Shape::cuboid([side, side, 1e-4]).unwrap();
        visuals.add_obstacle(slab, Translation3::new(0.0, 0.0, distance).into(), [200; 3]);
    }
    let truth = visuals.render(&camera());
    let sensor = Sensor {
        edges: Some(Edges {
            jump: 0.01,
            lost: 0.4,
            flying: 0.5,
            reach: 0.1,
        }),
        ..Sensor::ideal()
    };
    let (mut edge, mut lost, mut flying) = (0, 0, 0);
    for index in 0..20 {
        let seen = sensor.take(&truth, 1, 0, index);
        for v in 1..359 {
            for u in 1..639 {
                let at = |u, v| f64::from(truth.depth[truth.index(u, v)]);
                let (z, sides) = (
                    at(u, v),
                    [at(u - 1, v), at(u + 1, v), at(u, v - 1), at(u, v + 1)],
                );
                let found = f64::from(seen.depth[truth.index(u, v)]);
                if sides.iter().all(|side| (side - z).abs() < 0.01) {
                    assert!((found - z).abs() < 1e-6, "away from edges nothing happens");
                    continue;
                }
                edge += 1;
                lost += u32::from(found == 0.0);
                flying += u32::from(found > 0.0 && (found - z).abs() > 1e-6);
                assert!(found == 0.0 || (0.4998..0.7).contains(&found), "{found}");
            }
        }
    }
    let share = |count: u32| f64::from(count) / f64::from(edge);
    assert!(edge > 5_000, "{edge}");
    assert!((share(lost) - 0.4).abs() < 0.03, "{}", share(lost));
    assert!(
        (share(flying) - 0.6 * 0.5).abs() < 0.03,
        "{}",
        share(flying)
    );
}

#[test]
fn colour_noise_has_its_rms_and_leaves_the_background_black() {
    let sensor = Sensor {
        color_noise: Some(5.0),
        ..Sensor::ideal()
    };
    let truth = wall(0.5, 0.0, 0.1);
    let seen = sensor.take(&truth, 1, 0, 0);
    let mut differences = Vec::new();
    for (pixel, mask) in truth.mask.iter().enumerate() {
        if *mask == Instance::Background {
            assert_eq!(seen.color[pixel], [0; 3]);
        } else {
            let pairs = seen.color[pixel].iter().zip(truth.color[pixel]);
            differences.extend(pairs.map(|(a, b)| f64::from(*a) - f64::from(b)));
        }
    }
    let found = rms(differences.into_iter());
    // Rounding to whole levels adds 1/12.
    assert!(
        (found - (25.0f64 + 1.0 / 12.0).sqrt()).abs() < 0.05,
        "{found}"
    );
}

#[test]
fn extrinsic_errors_have_their_rms_and_stay_with_the_camera() {
    let sensor = Sensor {
        extrinsics: Some(ExtrinsicError {
            position: 0.002,
            rotation: 0.01,
        }),
        ..Sensor::ideal()
    };
    let truth = RgbdFrame::new(&Camera {
        intrinsics: Intrinsics::from_fovy(4, 4, 1.0),
        pose: Isometry3::identity(),
    });
    let pose = |camera, index| sensor.take(&truth, 7, camera, index).camera.pose;
    assert_eq!(pose(3, 0), pose(3, 9), "the same in all frames of a camera");
    assert_ne!(pose(3, 0), pose(4, 0));
    let poses: Vec<_> = (0..4_000).map(|camera| pose(camera, 0)).collect();
    let places = poses
        .iter()
        .flat_map(|p| p.translation.vector.iter().copied().collect::<Vec<_>>());
    assert!((rms(places) / 0.002 - 1.0).abs() < 0.03);
    let turns = poses
        .iter()
        .flat_map(|p| p.rotation.scaled_axis().iter().copied().collect::<Vec<_>>());
    assert!((rms(turns) / 0.01 - 1.0).abs() < 0.03);
}

#[test]
fn a_picture_is_a_function_of_seed_camera_and_index() {
    let truth = wall(0.5, 1.0, 0.1);
    let sensor = Sensor::d435();
    let seen = |seed, camera, index| sensor.take(&truth, seed, camera, index).depth;
    assert_eq!(seen(1, 2, 3), seen(1, 2, 3));
    for other in [seen(9, 2, 3), seen(1, 9, 3), seen(1, 2, 9)] {
        assert_ne!(seen(1, 2, 3), other);
    }
}

#[test]
fn one_fault_does_not_change_the_draws_of_another() {
    let truth = wall(0.5, 0.2, 0.1);
    let noise = Sensor {
        disparity_noise: Some(0.08),
        ..Sensor::ideal()
    };
    let both = Sensor {
        color_noise: Some(3.0),
        ..noise
    };
    assert_eq!(
        noise.take(&truth, 1, 0, 0).depth,
        both.take(&truth, 1, 0, 0).depth
    );
}

#[test]
fn a_measured_cloud_is_the_true_one_without_faults_and_a_function_of_seed_and_index_with_them() {
    let robot = Robot::load("2m").unwrap();
    let equilibrium = robot.settle(&robot.mean_command(), &Loads::default());
    let mut observer = Observer::new(&robot, BaseVisibility::Hidden, VoxelGrid::new(0.002));
    let truth = observer.observe(&equilibrium);
    let ideal = observer.measure(&equilibrium, &Sensor::ideal(), 0, 0);
    assert_eq!(ideal.colors, truth.colors);
    let apart =
        |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
    // Depths go through disparities and back.
    assert!(
        ideal
            .points
            .iter()
            .zip(&truth.points)
            .map(apart)
            .fold(0.0, f32::max)
            < 1e-6
    );
    let mut measure = |seed, index| observer.measure(&equilibrium, &Sensor::d435(), seed, index);
    let first = measure(1, 2);
    assert_eq!(first, measure(1, 2));
    assert_ne!(first, measure(1, 3));
    assert_ne!(first, measure(2, 2));
    assert!(first.len() > truth.len() / 2 && first != truth);
}
