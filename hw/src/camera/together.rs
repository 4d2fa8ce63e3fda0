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

/// Pictures of one moment that are waited for in turns, so that between them something else can be looked after.
#[derive(Debug)]
pub struct Gathering {
    /// Pictures are exposed at this time or later.
    start: Duration,
    /// What each camera gave, or why not yet.
    frames: Vec<Option<Result<Stamped<RgbdFrame>, CameraError>>>,
}

impl Gathering {
    /// Pictures of so many cameras, exposed at `start` or later.
    pub fn new(cameras: usize, start: Duration) -> Self {
        Self {
            start,
            frames: (0..cameras).map(|_| None).collect(),
        }
    }

    /// Waits until `until`, and no longer than it has to, for the pictures that are missing. `cameras` are the same in each turn.
    pub fn turn<C: RgbdCamera>(&mut self, cameras: &mut [C], until: Duration) {
        for (camera, frame) in cameras.iter_mut().zip(&mut self.frames) {
            if is_awaited(frame) {
                *frame = Some(camera.grab_after(self.start, until));
            }
        }
    }

    /// Whether no camera has to be waited for: each gave a picture, or failed.
    pub fn is_complete(&self) -> bool {
        !self.frames.iter().any(is_awaited)
    }

    /// What came until now, at the end of a wait of `waited` in all.
    pub fn finish(self, waited: Duration) -> Together {
        let mut frames: Vec<_> = self.frames.into_iter().flatten().collect();
        for frame in &mut frames {
            if let Err(CameraError::NoFrame { waited: in_all, .. }) = frame {
                *in_all = waited;
            }
        }
        let times = || frames.iter().flatten().map(|frame| frame.time);
        let skew = match (times().min(), times().max()) {
            (Some(first), Some(last)) if times().count() > 1 => Some(last - first),
            _ => None,
        };
        Together { frames, skew }
    }
}

fn is_awaited(frame: &Option<Result<Stamped<RgbdFrame>, CameraError>>) -> bool {
    matches!(frame, None | Some(Err(CameraError::NoFrame { .. })))
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
    let mut gathering = Gathering::new(cameras.len(), start);
    let mut turn = FIRST_TURN.min(patience);
    loop {
        gathering.turn(cameras, start + turn);
        if turn == patience || gathering.is_complete() {
            return gathering.finish(patience);
        }
        turn = (2 * turn).min(patience);
    }
}
