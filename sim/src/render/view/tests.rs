use super::*;
use crate::camera::{Distortion, Intrinsics};
use crate::geometry::Shape;
use crate::render::RgbdFrame;
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rand::{RngExt, SeedableRng};

/// A solid is never cut by the pixels it is cast at, wherever it is and however it is turned.
#[test]
fn bounds_hold_every_pixel_that_a_solid_covers() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
    let mut random = |size: f64| Vector3::from_fn(|_, _| size * (2.0 * rng.random::<f64>() - 1.0));
    for round in 0..400 {
        let mut intrinsics = Intrinsics::from_fovy(96, 72, 1.0);
        if round % 3 == 0 {
            let [k1, p1, p2] = (random(1.0).component_mul(&Vector3::new(0.1, 0.02, 0.02))).into();
            intrinsics.distortion = Some(Distortion {
                k1,
                p1,
                p2,
                ..Distortion::default()
            });
        }
        let camera = Camera {
            intrinsics,
            pose: Isometry3::from_parts(
                Translation3::from(random(1.0)),
                UnitQuaternion::from_scaled_axis(random(3.0)),
            ),
        };
        let half = random(0.1).abs().add_scalar(1e-4);
        let corners: Vec<[f64; 3]> = (0..6).map(|_| random(0.1).into()).collect();
        let shape = match round % 5 {
            0 => Shape::cylinder(half.x, half.y),
            1 => Shape::cuboid(half.into()),
            2 => Shape::sphere(half.x),
            3 => Shape::capsule(half.x, half.y),
            _ => Shape::mesh(&corners, &[[0, 1, 2], [3, 4, 5]]),
        };
        let place = Translation3::from(random(0.3) + Vector3::new(0.0, 0.0, 0.5));
        let solid = Solid {
            shape: shape.expect("sizes above 0"),
            pose: camera.pose
                * Isometry3::from_parts(place, UnitQuaternion::from_scaled_axis(random(3.0))),
            color: [200, 100, 50],
            instance: Instance::Disc(0),
        };
        let visuals = Visuals {
            solids: vec![solid],
        };
        let frame = visuals.render(&camera);
        let mut whole = RgbdFrame::new(&camera);
        let mut view = View::of(&visuals, &camera);
        for seen in &mut view.solids {
            (seen.columns, seen.rows) = (0..96, 0..72);
        }
        for v in 0..72 {
            let mut row = Row::default();
            row.clear(96);
            view.aim(v, 0..96, &mut row);
            for seen in &view.solids {
                seen.cast(1, &mut row, 0..96);
            }
            let pixels = 96 * v as usize..96 * (v as usize + 1);
            let finite = |z: f64| if z.is_finite() { z as f32 } else { 0.0 };
            for (depth, z) in whole.depth[pixels].iter_mut().zip(row.depth) {
                *depth = finite(z);
            }
        }
        assert_eq!(frame.depth, whole.depth, "round {round}");
    }
}

/// Of a floor on a table one is seen, and not now this and now that.
#[test]
fn of_two_faces_in_one_plane_one_is_seen() {
    let mut visuals = Visuals::default();
    for thickness in [0.05, 0.01] {
        let shape = Shape::cuboid([2.0, 2.0, thickness]).expect("sizes above 0");
        let pose = Isometry3::from(Translation3::new(0.0, 0.0, -thickness));
        visuals.add_obstacle(shape, pose, [200, 100, 50]);
    }
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    for _ in 0..10 {
        let turn = UnitQuaternion::from_euler_angles(2.8, 0.1, 6.0 * rng.random::<f64>());
        let camera = Camera {
            intrinsics: Intrinsics::from_fovy(96, 72, 0.7),
            pose: Isometry3::from_parts(Translation3::new(0.1, -0.2, 0.37), turn),
        };
        let seen = visuals.render(&camera).mask;
        assert_ne!(seen[0], Instance::Background);
        assert!(seen.iter().all(|instance| *instance == seen[0]));
    }
}
