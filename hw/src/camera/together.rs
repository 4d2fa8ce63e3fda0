//! Pictures of several cameras from one moment.

use std::time::Duration;

use tdcr_sim::render::RgbdFrame;

use super::{CameraError, RgbdCamera, Stamped};
use crate::clock::Clock;

/// First time that a camera is waited for before the others have their turn: a picture's period and way through USB.
const FIRST_TURN: Duration = Duration::from_millis(50);

/// What several cameras saw at about one moment.
#[derive(Debug)]
pub struct Together {
    /// One result for each camera, in their order.
    pub frames: Vec<Result<Stamped<RgbdFrame>, CameraError>>,
    /// Largest difference between the times of the pictures; `None` where there are fewer than two.
    pub skew: Option<Duration>,
}

/// Takes the first picture of each camera that is exposed from now on, and waits for them no longer than `patience` in all. All
/// cameras' times are of `clock`.
///
/// The skew is the cameras' periods at most: 33 ms for D435s that run freely, none for cameras with a sync cable. A camera that
/// is dead costs the others neither pictures nor skew: each is waited for in short turns, within which the others keep theirs.
pub fn grab_all<C: RgbdCamera>(
    cameras: &mut [C],
    clock: &dyn Clock,
    patience: Duration,
) -> Together {
    let start = clock.now();
    let mut frames: Vec<_> = cameras.iter().map(|_| None).collect();
    let mut turn = FIRST_TURN.min(patience);
    loop {
        for (camera, frame) in cameras.iter_mut().zip(&mut frames) {
            if matches!(frame, None | Some(Err(CameraError::NoFrame { .. }))) {
                let grabbed = camera.grab_after(start, start + turn);
                *frame = Some(grabbed);
            }
        }
        let waiting = |frame: &Option<_>| matches!(frame, Some(Err(CameraError::NoFrame { .. })));
        if turn == patience || !frames.iter().any(waiting) {
            break;
        }
        turn = (2 * turn).min(patience);
    }
    let mut frames: Vec<_> = frames.into_iter().flatten().collect();
    for frame in &mut frames {
        if let Err(CameraError::NoFrame { waited, .. }) = frame {
            *waited = patience;
        }
    }
    let times = || frames.iter().flatten().map(|frame| frame.time);
    let skew = match (times().min(), times().max()) {
        (Some(first), Some(last)) if times().count() > 1 => Some(last - first),
        _ => None,
    };
    Together { frames, skew }
}
