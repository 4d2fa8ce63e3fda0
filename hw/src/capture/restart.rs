//! Servos that lose their power, and with it their turns, while a robot is captured.

use super::Session;
use super::error::CaptureError;
use crate::rig::{EmergencyStop, LostTurns, RigError};

/// How often in a row a servo may lose its turns before a capture ends.
const RESTARTS: usize = 3;

impl Session<'_> {
    /// Addresses of the servos that restarted since this was last asked, and whose homes were found again.
    pub fn restarted(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.restarted)
    }

    /// Does some work; anew, where a servo was without power meanwhile and the rig's settings say so, from home.
    pub(super) fn persist<T>(
        &mut self,
        mut work: impl FnMut(&mut Self) -> Result<T, CaptureError>,
    ) -> Result<T, CaptureError> {
        let recalls = self.rig.spec().safety.lost_turns == LostTurns::Recall;
        for _ in 0..RESTARTS {
            match work(self) {
                Err(CaptureError::Rig(error)) if recalls => {
                    if let Some(stop) = self.stopped_by(error)? {
                        self.recall(stop)?;
                    }
                }
                done => return done,
            }
        }
        work(self)
    }

    /// The stop that a servo without power leads to; `None` where one that was silent answers again, and nothing has stopped.
    fn stopped_by(&mut self, error: RigError) -> Result<Option<Box<EmergencyStop>>, RigError> {
        match error {
            RigError::Stopped(stop) if stop.cause.may_be_restart() => Ok(Some(stop)),
            RigError::Servo(error) if self.rig.is_engaged() => {
                tracing::debug!("{error}");
                for _ in 0..=self.rig.spec().safety.lost_after {
                    if let Err(error) = self.rig.poll() {
                        return self.stopped_by(error);
                    }
                }
                Ok(None)
            }
            other => Err(other),
        }
    }

    /// Finds home again after a servo restarted, and looks whether the robot is there.
    fn recall(&mut self, stop: Box<EmergencyStop>) -> Result<(), CaptureError> {
        tracing::warn!("{stop}; finding home again");
        let id = stop.cause.id().get();
        match self.rig.home_recalled_after_restart() {
            Err(RigError::Servo(_)) => return Err(RigError::Stopped(stop).into()),
            recalled => drop(recalled?),
        }
        self.rig.engage()?;
        self.rig.go_home()?;
        self.at = self.program.rest().clone().into();
        self.restarted.push(id);
        self.look_home().map(drop)
    }
}
