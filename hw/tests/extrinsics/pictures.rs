//! Detection in rendered pictures, and calibration from them.

use nalgebra::Isometry3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_hw::extrinsics::{Detector, Exposure, Sighting, World, calibrate, picture};
use tdcr_sim::camera::Camera;

use crate::{board, four, held, known, names, ring, worst};

/// Detected minus true pixels of all corners of a picture.
#[test]
fn detected() {
    let board = board();
    let detector = Detector::new(&board).unwrap();
    for (name, cameras) in [("ring", ring()), ("four", four())] {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut n, mut sum, mut sq, mut max) = (0, nalgebra::Vector2::zeros(), 0.0, 0f64);
        let begin = std::time::Instant::now();
        let mut time = 0.0;
        let mut images = 0;
        for view in 0..8 {
            let placed = held(&board, &cameras, view, &mut rng);
            for camera in &cameras {
                let image = picture(&board, &placed, camera, &Exposure::default(), &mut rng);
                let t = std::time::Instant::now();
                let found = detector.detect(&image);
                time += t.elapsed().as_secs_f64();
                images += 1;
                let expected = crate::corners_seen(&board, &placed, camera, 0.0, &mut rng).len();
                eprint!("{}/{} ", found.len(), expected);
                for corner in found {
                    let (u, v, _) = camera
                        .project(&(placed * board.corner(corner.id).unwrap()))
                        .unwrap();
                    let e = corner.pixel - nalgebra::Vector2::new(u, v);
                    n += 1;
                    sum += e;
                    sq += e.norm_squared();
                    max = max.max(e.norm());
                }
            }
        }
        eprintln!(
            "{name}: n {n} bias {:?} rms/axis {} max {max} detect {:.4}s/img total {:?}",
            sum / n as f64,
            (sq / 2.0 / n as f64).sqrt(),
            time / images as f64,
            begin.elapsed()
        );
    }
}
