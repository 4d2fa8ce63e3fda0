//! Sightings from which no calibration follows.

use nalgebra::Vector2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_hw::extrinsics::{CalibrationError, Sighting, World, calibrate};

use crate::{board, known, names, ring, sightings};

const VIEWS: usize = 16;

/// What is said of sightings changed by `change`.
fn refused(world: &World, change: impl FnOnce(&mut Vec<Sighting>)) -> CalibrationError {
    let cameras = ring();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut sightings, _) = sightings(&board(), &cameras, VIEWS, 0.1, &mut rng);
    change(&mut sightings);
    calibrate(&board(), &known(&cameras), &names(VIEWS), &sightings, world).unwrap_err()
}

#[test]
fn a_board_that_nobody_sees_is_doubted() {
    let none = refused(&World::FirstCamera, |all| {
        all.iter_mut().for_each(|s| s.corners.clear())
    });
    assert_eq!(none, CalibrationError::NoBoard { views: VIEWS });
    assert!(
        none.to_string()
            .contains("is it the board described (squares, dictionary)")
    );
}

#[test]
fn cameras_that_never_see_the_board_are_named() {
    let blind = refused(&World::FirstCamera, |all| {
        let of_some = |s: &&mut Sighting| [3, 5].contains(&s.camera);
        all.iter_mut()
            .filter(of_some)
            .for_each(|s| s.corners.truncate(4));
    });
    let serials = vec!["cam3".to_owned(), "cam5".to_owned()];
    assert_eq!(blind, CalibrationError::Blind { serials });
    assert!(
        blind
            .to_string()
            .contains("no image of cam3, cam5 shows the board with 6 corners")
    );
}

#[test]
fn cameras_that_share_no_view_are_named_by_groups() {
    let apart = refused(&World::FirstCamera, |all| {
        all.retain(|s| (s.camera < 3) == (s.view % 8 < 3));
    });
    let said = apart.to_string();
    assert!(matches!(apart, CalibrationError::Disconnected { .. }));
    assert!(
        said.contains("(cam0, cam1, cam2") && said.contains(") and (cam"),
        "{said}"
    );
}

#[test]
fn the_view_that_is_the_world_must_be_seen() {
    let world = |view: &str| World::Board {
        view: view.into(),
        pose: nalgebra::Isometry3::identity(),
    };
    let unseen = refused(&world("view2"), |all| all.retain(|s| s.view != 2));
    assert_eq!(
        unseen.to_string(),
        "no camera sees the board in view view2, which says where the world is"
    );
    assert!(matches!(
        refused(&world("viwe2"), |_| ()),
        CalibrationError::WorldUnseen { .. }
    ));
}

#[test]
fn a_single_camera_is_calibrated_to_a_world_alone() {
    let cameras = &ring()[..1];
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (sightings, placed) = sightings(&board(), cameras, 4, 0.1, &mut rng);
    let solve = |world| calibrate(&board(), &known(cameras), &names(4), &sightings, &world);
    assert_eq!(
        solve(World::FirstCamera).unwrap_err(),
        CalibrationError::TooFewCameras { found: 1 }
    );
    let pose = placed[1];
    let found = solve(World::Board {
        view: "view1".into(),
        pose,
    })
    .unwrap();
    let apart =
        found.cameras[0].camera.pose.translation.vector - cameras[0].pose.translation.vector;
    assert!(apart.norm() < 2e-3, "{apart}");
}

/// Noise in place of corners, and corners on a line: an answer or an error, and no panic.
#[test]
fn nonsense_is_survived() {
    let turn = |s: &mut Sighting, f: &mut dyn FnMut(u32) -> Vector2<f64>| {
        s.corners
            .iter_mut()
            .for_each(|corner| corner.pixel = f(corner.id));
    };
    let line = refused(&World::FirstCamera, |all| {
        all.iter_mut()
            .for_each(|s| turn(s, &mut |id| [f64::from(id), 100.0].into()));
    });
    assert_eq!(line, CalibrationError::NoBoard { views: VIEWS });
    let cameras = ring();
    for seed in 0..5 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut sightings, _) = sightings(&board(), &cameras, VIEWS, 0.1, &mut rng);
        let mut random = || rand::RngExt::random_range(&mut rng, 0.0..700.0);
        for sighting in &mut sightings {
            turn(sighting, &mut |_| Vector2::new(random(), random()));
        }
        let _ = calibrate(
            &board(),
            &known(&cameras),
            &names(VIEWS),
            &sightings,
            &World::FirstCamera,
        );
    }
}
