//! Clouds of a robot as several cameras see it.

use nalgebra::{Isometry3, Vector3};
use tdcr_hw::extrinsics::{Overlap, overlaps};
use tdcr_sim::camera::Camera;
use tdcr_sim::render::{BaseVisibility, RgbdFrame, Visuals};
use tdcr_sim::robot::{Cameras, Loads, Robot, RobotSpec};

/// A bent 3m seen by its ring at half the resolution.
fn frames() -> Vec<RgbdFrame> {
    let robot = Robot::new(RobotSpec::standard("3m").unwrap()).unwrap();
    let lengths: Vec<f64> = (0..9).map(|k| 0.01 + 0.012 * f64::from(k % 3)).collect();
    let equilibrium = robot.settle(&robot.command(&lengths).unwrap(), &Loads::default());
    let visuals = Visuals::of_robot(&robot, &equilibrium, BaseVisibility::Hidden);
    let Cameras::Ring(mut ring) = robot.spec().cameras.clone() else {
        panic!("the paper's cameras are a ring");
    };
    ring.resolution = [640, 360];
    let mut frames = Vec::new();
    visuals.render_all_into(&Camera::ring(&ring), &mut frames);
    frames
}

/// Distances of neighbouring cameras' points from each other's surfaces; those of camera 2, and all others.
fn of_neighbours(frames: &[RgbdFrame]) -> [Vec<Overlap>; 2] {
    let neighbours = |o: &Overlap| [1, 7].contains(&o.points_of.abs_diff(o.surface_of));
    let all = overlaps(frames, 0.006).into_iter().filter(neighbours);
    let (with, without) = all.partition(|o| o.points_of == 2 || o.surface_of == 2);
    [with, without]
}

/// True poses leave the steps between pixels. With the noise of D435s, and errors of their extrinsics, these are 1.2 to 2.3 mm.
#[test]
fn a_camera_that_was_pushed_shows_in_its_overlaps() {
    let mut frames = frames();
    let [with, others] = of_neighbours(&frames);
    assert_eq!((with.len(), others.len()), (4, 12));
    for overlap in with.iter().chain(&others) {
        assert!(overlap.points > 1000, "{overlap:?}");
        assert!(
            overlap.mean.abs() < 0.15e-3 && overlap.rms < 0.6e-3,
            "{overlap:?}"
        );
    }
    let pushed = Isometry3::new(
        Vector3::new(0.002, -0.001, 0.0015),
        Vector3::new(0.002, 0.003, -0.002),
    );
    frames[2].camera.pose = pushed * frames[2].camera.pose;
    let [after, unchanged] = of_neighbours(&frames);
    assert_eq!(unchanged, others);
    for overlap in after {
        assert!(
            overlap.mean.abs() > 1e-3 && overlap.rms > 1.5e-3,
            "{overlap:?}"
        );
    }
}

#[test]
fn frames_without_a_robot_have_no_overlaps() {
    let empty: Vec<RgbdFrame> = frames()[..2]
        .iter()
        .map(|f| RgbdFrame::new(&f.camera))
        .collect();
    assert_eq!(overlaps(&empty, 0.006), []);
    assert_eq!(overlaps(&[], 0.006), []);
}
