//! Detection in rendered pictures, and calibration from them.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_hw::extrinsics::{Detector, Exposure, Sighting, World, calibrate, picture};

use crate::{board, four, held, known, names, ring, worst};

/// Detected minus true pixels of all corners of a picture.
#[test]
fn detected() {
    let board = board();
    let detector = Detector::new(&board).unwrap();
    for (name, cameras) in [("ring", ring()), ("four", four())] {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut errs = vec![];
        let mut sightings = vec![];
        for view in 0..20 {
            let placed = held(&board, &cameras, view, &mut rng);
            for (index, camera) in cameras.iter().enumerate() {
                let image = picture(&board, &placed, camera, &Exposure::default(), &mut rng);
                let found = detector.detect(&image);
                let facing = -(placed.rotation * nalgebra::Vector3::z())
                    .dot(&(camera.pose.translation.vector - placed.translation.vector).normalize());
                for corner in &found {
                    let (u, v, _) = camera
                        .project(&(placed * board.corner(corner.id).unwrap()))
                        .unwrap();
                    let e = corner.pixel - nalgebra::Vector2::new(u, v);
                    errs.push((e.norm(), facing));
                }
                sightings.push(Sighting {
                    camera: index,
                    view,
                    corners: found,
                });
            }
        }
        errs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let q = |p: f64| errs[(errs.len() as f64 * p) as usize];
        eprintln!(
            "{name}: n {} q50 {:?} q90 {:?} q95 {:?} q99 {:?}",
            errs.len(),
            q(0.5),
            q(0.9),
            q(0.95),
            q(0.99)
        );
        let found = calibrate(
            &board,
            &known(&cameras),
            &names(20),
            &sightings,
            &World::FirstCamera,
        )
        .unwrap();
        let (m, r) = worst(&cameras, &found, &World::FirstCamera);
        eprintln!(
            "{name} {:.3} mm {:.4} deg noise {} rejected {}",
            1e3 * m,
            r.to_degrees(),
            found.noise,
            found.rejected.len()
        );
    }
}
