//! Keeping in touch with servos that hold their goals while something else takes its time.
//!
//! A servo whose watchdog hears nothing for `safety.watchdog` stops, and refuses goals. So nothing that lasts is done between two
//! looks at the servos while the motors are on: pictures are waited for in turns of `motion.period`, and what computes does so
//! beside ([`Rig::hold_while`]). As a period is half of the watchdog's time at the most, so is the silence on the bus.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use super::motion::Drive;
use super::{Pictures, Rig, RigError};
use crate::camera::{Gathering, RgbdCamera, Together, WarmUp};

impl Rig {
    /// Does some work, and looks at the servos meanwhile, each period, as [`poll`](Self::poll) does. Where the motors are off, or
    /// time passes only where somebody waits, it is just done.
    ///
    /// # Errors
    /// As [`poll`](Self::poll), after the work has come to its end: what it gave is lost then.
    pub fn hold_while<T: Send>(&mut self, work: impl FnOnce() -> T + Send) -> Result<T, RigError> {
        if !self.is_engaged() || !self.clock.runs() {
            return Ok(work());
        }
        std::thread::scope(|scope| {
            // Whatever ends the work, a panic too, drops this end.
            let (working, ended) = channel::<()>();
            let worker = scope.spawn(move || {
                let _working = working;
                work()
            });
            let held = loop {
                match ended.recv_timeout(self.until_due()) {
                    Err(RecvTimeoutError::Timeout) => {
                        if let Err(error) = self.poll() {
                            break Err(error);
                        }
                    }
                    _ => break Ok(()),
                }
            };
            let done = (worker.join()).unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            held.map(|()| done)
        })
    }

    /// How long it is until the servos are to be looked at.
    fn until_due(&self) -> Duration {
        match &self.drive {
            Drive::Engaged(engaged) => engaged.next.saturating_sub(self.clock.now()),
            Drive::Released => Duration::ZERO,
        }
    }

    /// A look at the servos, where their motors are on.
    fn look_if_engaged(&mut self) -> Result<(), RigError> {
        match self.is_engaged() {
            true => self.poll().map(drop),
            false => Ok(()),
        }
    }

    /// Waits until all cameras have found their exposure. Where the motors are on, the servos are looked at meanwhile.
    ///
    /// # Errors
    /// [`RigError::Camera`]; as [`poll`](Self::poll).
    pub fn warm_up(&mut self) -> Result<(), RigError> {
        let period = self.file.spec.motion.period();
        self.with_cameras(|rig, cameras| {
            for camera in cameras {
                let mut between = || rig.look_if_engaged();
                WarmUp::default().run_in_turns(camera, period, &mut between)?;
            }
            Ok(())
        })
    }

    /// Pictures of all cameras, of the present or later. Where the motors are on, the servos are looked at meanwhile.
    ///
    /// # Errors
    /// [`RigError::Camera`] for the first camera that gave none, or gives one picture over and over though the robot moves in its
    /// sight; the tension is released then, as nobody sees any more what it does. As [`poll`](Self::poll).
    pub fn grab(&mut self) -> Result<Pictures, RigError> {
        let together = self.with_cameras(Self::gather)?;
        let frames: Result<Vec<_>, _> = together.frames.into_iter().collect();
        let frames = frames.map_err(RigError::from).and_then(|frames| {
            self.must_be_fresh(&frames)?;
            Ok(frames)
        });
        match frames {
            Ok(frames) => Ok(Pictures {
                frames,
                skew: together.skew.unwrap_or_default(),
            }),
            Err(error) => {
                self.release_at_once();
                Err(error)
            }
        }
    }

    fn gather(&mut self, cameras: &mut [Box<dyn RgbdCamera>]) -> Result<Together, RigError> {
        let motion = &self.file.spec.motion;
        let (period, patience) = (motion.period(), Duration::from_secs_f64(motion.picture));
        let start = self.clock.now();
        let end = start + patience;
        let mut gathering = Gathering::new(cameras.len(), start);
        loop {
            let until = end.min(self.clock.now() + period);
            self.hold_while(|| gathering.turn(cameras, until))?;
            if gathering.is_complete() || self.clock.now() >= end {
                return Ok(gathering.finish(patience));
            }
            self.look_if_engaged()?;
        }
    }

    /// Does something with the cameras and the rest of the rig.
    fn with_cameras<T>(
        &mut self,
        work: impl FnOnce(&mut Self, &mut [Box<dyn RgbdCamera>]) -> Result<T, RigError>,
    ) -> Result<T, RigError> {
        let mut cameras = std::mem::take(&mut self.cameras);
        let done = work(self, &mut cameras);
        self.cameras = cameras;
        done
    }
}
