//! Clouds of a robot, and of points given.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::cloud::{Observer, PointCloud, PointProperty, VoxelGrid, write_ply, write_ply_with};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::scene::{Obstacle, Scene};

use crate::{bent_robot, distance_to_disc};

#[test]
fn the_base_is_seen_only_when_shown() {
    let (robot, equilibrium) = bent_robot();
    let grid = VoxelGrid::new(0.002);
    let lowest = |base| {
        let cloud = Observer::new(&robot, base, grid).observe(&equilibrium);
        cloud
            .points
            .iter()
            .map(|p| p[2])
            .fold(f32::INFINITY, f32::min)
    };
    assert!(lowest(BaseVisibility::Shown) < 0.01);
    assert!(lowest(BaseVisibility::Hidden) > 0.15);
}

#[test]
fn a_cloud_lies_on_the_robot_one_point_to_a_voxel() {
    let (robot, equilibrium) = bent_robot();
    let mut observer = Observer::new(&robot, BaseVisibility::Hidden, VoxelGrid::new(0.002));
    let cloud = observer.observe(&equilibrium);
    assert_eq!(
        cloud,
        observer.observe(&equilibrium),
        "seen again, the same"
    );
    let voxel = |p: &[f32; 3]| p.map(|x| (f64::from(x) / 0.002).floor() as i64);
    let mut voxels: Vec<_> = cloud.points.iter().map(voxel).collect();
    voxels.sort_unstable();
    voxels.dedup();
    assert_eq!(voxels.len(), cloud.len());
    for point in &cloud.points {
        let point = Vector3::from(point.map(f64::from));
        let off = (0..10).map(|disc| distance_to_disc(&robot, &equilibrium, disc, &point));
        assert!(off.fold(f64::INFINITY, f64::min) < 1e-6);
    }
    // Both sides of the robot are there.
    for axis in 0..2 {
        let around = |sign: f32| cloud.points.iter().any(|p| sign * p[axis] > 0.01);
        assert!(around(1.0) && around(-1.0));
    }
}

#[test]
fn a_displaced_observer_sees_other_points_of_the_same_surface() {
    let (robot, equilibrium) = bent_robot();
    let mut observer = Observer::new(&robot, BaseVisibility::Hidden, VoxelGrid::new(0.002));
    let first = observer.observe(&equilibrium);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    observer.displace(&mut rng);
    let second = observer.observe(&equilibrium);
    assert!((first.len() as f64 / second.len() as f64 - 1.0).abs() < 0.05);
    let mut points: Vec<_> = first
        .points
        .iter()
        .chain(&second.points)
        .map(|p| p.map(f32::to_bits))
        .collect();
    points.sort_unstable();
    points.dedup();
    assert_eq!(
        points.len(),
        first.len() + second.len(),
        "no point in common"
    );
    for point in &second.points {
        let point = Vector3::from(point.map(f64::from));
        let off = (0..10).map(|disc| distance_to_disc(&robot, &equilibrium, disc, &point));
        assert!(off.fold(f64::INFINITY, f64::min) < 1e-6);
    }
    observer.displace(&mut rng);
    assert_ne!(observer.observe(&equilibrium), second, "each in its phase");
    let mut again = Observer::new(&robot, BaseVisibility::Hidden, VoxelGrid::new(0.002));
    again.displace(&mut ChaCha8Rng::seed_from_u64(3));
    assert_eq!(
        again.observe(&equilibrium),
        second,
        "a function of the seed"
    );
}

fn numbered_cloud(count: u8) -> PointCloud {
    let mut cloud = PointCloud::default();
    for k in 0..count {
        cloud.push([f32::from(k), 0.0, 0.0], [k, 0, 0]);
    }
    cloud
}

#[test]
fn a_voxel_keeps_its_first_point() {
    let mut cloud = PointCloud::default();
    cloud.push([0.0019, 0.0, 0.0], [1, 0, 0]);
    cloud.push([0.0001, 0.0, 0.0], [2, 0, 0]);
    cloud.push([-0.0001, 0.0, 0.0], [3, 0, 0]);
    let kept = cloud.voxel_downsample(VoxelGrid::new(0.002));
    assert_eq!(kept.colors, [[1, 0, 0], [3, 0, 0]]);
}

#[test]
fn samples_are_subsets_and_padding_repeats() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let cloud = numbered_cloud(100);
    let names = |cloud: &PointCloud| -> Vec<u8> {
        assert!(
            cloud
                .points
                .iter()
                .zip(&cloud.colors)
                .all(|(p, c)| p[0] == f32::from(c[0]))
        );
        let mut names: Vec<u8> = cloud.colors.iter().map(|c| c[0]).collect();
        names.sort_unstable();
        names.dedup();
        names
    };
    let subset = cloud.sample_or_pad(30, &mut rng);
    assert_eq!((subset.len(), names(&subset).len()), (30, 30));
    let padded = cloud.sample_or_pad(250, &mut rng);
    assert_eq!((padded.len(), names(&padded).len()), (250, 100));
    assert!(PointCloud::default().sample_or_pad(5, &mut rng).is_empty());
}

#[test]
fn ply_files_hold_the_properties_of_each_point_after_its_colour() {
    let path = std::env::temp_dir().join(format!("tdcr-property-{}.ply", std::process::id()));
    let depth = PointProperty {
        name: "depth",
        values: &[0.5, 1.5, 2.5],
    };
    write_ply_with(&path, &numbered_cloud(3), &[depth]).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    let end = b"property uchar blue\nproperty float depth\nend_header\n";
    let body = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let rows: Vec<&[u8]> = bytes[body..].chunks(19).collect();
    assert_eq!(rows.len(), 3);
    for (row, value) in rows.iter().zip(depth.values) {
        assert_eq!(row[15..], value.to_le_bytes());
    }
    assert_eq!(rows[1][..4], 1.0f32.to_le_bytes());
}

#[test]
fn ply_files_hold_what_was_written() {
    let path = std::env::temp_dir().join(format!("tdcr-cloud-{}.ply", std::process::id()));
    write_ply(&path, &numbered_cloud(3)).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    let end = b"end_header\n";
    let body = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let header = std::str::from_utf8(&bytes[..body]).unwrap();
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
    assert!(header.contains("element vertex 3\n"));
    assert_eq!(bytes.len() - body, 3 * 15);
    assert_eq!(bytes[body + 15..body + 19], 1.0f32.to_le_bytes());
    assert_eq!(bytes[body + 15 + 12], 1);
    let refused = write_ply(
        std::path::Path::new("/no/such/folder/x.ply"),
        &numbered_cloud(1),
    );
    assert!(
        refused
            .unwrap_err()
            .to_string()
            .contains("/no/such/folder/x.ply")
    );
}

#[test]
fn obstacles_hide_the_robot_and_are_not_in_its_cloud() {
    let (robot, equilibrium) = bent_robot();
    let grid = VoxelGrid::new(0.002);
    let alone = Observer::new(&robot, BaseVisibility::Hidden, grid).observe(&equilibrium);
    // Between the robot and the cameras on one side.
    let wall = Obstacle::cuboid("wall", [0.01, 1.0, 1.0]).unwrap();
    let scene = Scene::new(vec![wall.at([0.25, 0.0, 0.3])]).unwrap();
    let mut observer = Observer::new(&robot, BaseVisibility::Hidden, grid).among(&scene);
    let seen = observer.observe(&equilibrium);
    assert!(
        seen.len() < alone.len(),
        "{} of {}",
        seen.len(),
        alone.len()
    );
    assert!(seen.len() > alone.len() / 3);
    let farthest = |cloud: &PointCloud| cloud.points.iter().map(|p| p[0]).fold(f32::MIN, f32::max);
    assert!(farthest(&seen) <= farthest(&alone) + 0.002);
    assert!(farthest(&seen) < 0.24);
}
