//! Whether what cameras see still moves.

use std::time::Duration;

use tdcr_sim::render::RgbdFrame;

/// Side of the squares (pixels) over which depth is averaged: that takes most of a depth camera's noise away, which differs from
/// pixel to pixel, and leaves motion, which does not.
const SIDE: usize = 8;

/// Share of a square's pixels that need a depth for it to count.
const SHARE: f64 = 0.75;

/// What waiting for stillness found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stillness {
    /// How long it took.
    pub waited: Duration,
    /// Mean change of depth at the end (m); `None` where there were no two pictures with the robot in them.
    pub change: Option<f64>,
    /// Fastest servo at the end (rad/s).
    pub speed: f64,
    /// Whether all was still, or patience came to its end.
    pub end: StillDepth,
}

/// How waiting for stillness ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StillDepth {
    /// All was still.
    Still,
    /// It was not, to the end of patience.
    Moving,
}

/// Mean change of depth (m) between two pictures of a camera, over squares of pixels that have a depth in both; `None` where
/// there is none.
pub(super) fn change(before: &RgbdFrame, after: &RgbdFrame) -> Option<f64> {
    let [width, height] = [before, after].map(|frame| {
        let intrinsics = &frame.camera.intrinsics;
        [intrinsics.width as usize, intrinsics.height as usize]
    });
    if width != height {
        return None;
    }
    let [width, height] = width;
    let (mut sum, mut squares) = (0.0, 0);
    for top in (0..height).step_by(SIDE) {
        for left in (0..width).step_by(SIDE) {
            let [rows, columns] = [SIDE.min(height - top), SIDE.min(width - left)];
            let (mut moved, mut count) = (0.0, 0);
            for row in top..top + rows {
                let line = row * width + left..row * width + left + columns;
                for (&a, &b) in before.depth[line.clone()].iter().zip(&after.depth[line]) {
                    if a > 0.0 && b > 0.0 {
                        moved += f64::from(b) - f64::from(a);
                        count += 1;
                    }
                }
            }
            if count > 0 && count as f64 >= SHARE * (rows * columns) as f64 {
                sum += (moved / f64::from(count)).abs();
                squares += 1;
            }
        }
    }
    (squares > 0).then(|| sum / f64::from(squares))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tdcr_sim::camera::Camera;
    use tdcr_sim::render::{BaseVisibility, Sensor, Visuals};
    use tdcr_sim::robot::{Loads, Robot};

    /// A robot that moves by a millimetre is told from a D435's noise on one that stands.
    #[test]
    fn motion_is_told_from_noise() {
        let robot = Robot::load("2m").expect("a standard robot");
        let camera = &Camera::placed(&robot.spec().cameras)[0];
        let seen = |shift: f64, index: u64| {
            let command = [0.02 - shift, 0.02, 0.02, 0.02, 0.02, 0.02];
            let command = robot.command(&command).expect("in range");
            let settled = robot.settle(&command, &Loads::default());
            let visuals = Visuals::of_robot(&robot, &settled, BaseVisibility::Hidden);
            Sensor::d435().take(&visuals.render(camera), 0, 0, index)
        };
        let first = seen(0.0, 0);
        let noise = change(&first, &seen(0.0, 1)).expect("seen");
        let motion = change(&first, &seen(2e-3, 1)).expect("seen");
        assert!(noise < 3e-4, "{noise}");
        assert!(motion > 2.0 * noise, "{motion} against {noise}");
        let nothing = RgbdFrame::new(camera);
        assert_eq!(change(&nothing, &first), None);
    }
}
