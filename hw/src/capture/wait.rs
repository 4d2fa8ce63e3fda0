//! Waiting until a robot is where it was told to be, and still.

use std::ops::ControlFlow;
use std::time::Duration;

use super::Session;
use super::error::CaptureError;
use super::still::{StillDepth, Stillness, change};
use super::tendons::Swung;
use crate::rig::{OffGoal, Pictures, RigError, WinchState};

/// What was seen at last of a robot that one waited for.
pub(super) struct Seen {
    /// As the cameras gave it.
    pub pictures: Pictures,
    /// With the depth of the robot alone, by the rig's masks.
    pub robot: Pictures,
    /// What the servos did after the pictures.
    pub states: Vec<WinchState>,
    pub stillness: Stillness,
}

/// What a robot is waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// A sample, of this number.
    Sample(u64),
    /// A look at home.
    Home,
}

impl Session<'_> {
    /// Asks whether to go on.
    pub(super) fn ask(&mut self) -> Result<(), RigError> {
        match (self.go_on)() {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => {
                self.rig.release()?;
                Err(RigError::Interrupted)
            }
        }
    }

    /// Waits until the servos are at their goals, and they and depth are still, as long as patience lasts; the last pictures. The
    /// servos are at their goals before and after them.
    ///
    /// # Errors
    /// [`CaptureError::OffGoal`] where patience comes to its end and a servo is not at its goal; where something moves but they
    /// are, the pictures are taken all the same. For a sample, [`CaptureError::Pull`].
    pub(super) fn wait_until_still(&mut self, purpose: Purpose) -> Result<Seen, CaptureError> {
        let motion = self.rig.spec().motion.clone();
        let began = self.rig.clock().now();
        let mut deadline = began + Duration::from_secs_f64(motion.patience);
        let mut compared = purpose == Purpose::Home;
        let mut before: Option<Pictures> = None;
        loop {
            self.ask()?;
            let speed = fastest(self.rig.read_all()?);
            let now = self.rig.clock().now();
            let late = now >= deadline;
            let off = self.rig.off_goal();
            self.must_arrive(off.filter(|_| late), now - began)?;
            if (speed > motion.still_speed || off.is_some()) && !late {
                continue;
            }
            if let (Purpose::Sample(index), false) = (purpose, compared) {
                compared = true;
                let states = self.rig.last_states().unwrap_or_default().to_vec();
                if self.compare_pulls(index, &states)? == Swung::Yes {
                    deadline += self.rig.clock().now().saturating_sub(now);
                    continue;
                }
            }
            let pictures = self.rig.grab()?;
            let states = self.rig.read_all()?.to_vec();
            let off = self.rig.off_goal();
            self.must_arrive(off.filter(|_| late), now - began)?;
            let fuser = &self.fuser;
            let sample = match purpose {
                Purpose::Sample(index) => index as usize,
                Purpose::Home => 0,
            };
            let kept = self.rig.hold_while(|| {
                let robot = fuser.keep_robot(&pictures, sample)?;
                let changes = before.as_ref().map(|before| changed(before, &robot));
                Ok::<_, CaptureError>((robot, changes))
            })?;
            let (robot, changes) = kept?;
            let at_rest = speed <= motion.still_speed && off.is_none();
            let still =
                changes.is_some_and(|most| most.is_none_or(|most| most <= motion.still_depth));
            if still && at_rest || late {
                let stillness = Stillness {
                    waited: now - began,
                    change: changes.flatten(),
                    speed,
                    end: match still && at_rest {
                        true => StillDepth::Still,
                        false => StillDepth::Moving,
                    },
                };
                return Ok(Seen {
                    pictures,
                    robot,
                    states,
                    stillness,
                });
            }
            before = Some(robot);
        }
    }

    /// Refuses a servo that is not at its goal.
    fn must_arrive(&mut self, off: Option<OffGoal>, waited: Duration) -> Result<(), CaptureError> {
        match off {
            None => Ok(()),
            Some(OffGoal { id, goal, position }) => Err(CaptureError::OffGoal {
                id: id.get(),
                goal: goal.0,
                position: position.0,
                limit: self.rig.spec().motion.arrived,
                waited,
            }),
        }
    }
}

/// Largest speed of a servo (rad/s).
fn fastest(states: &[WinchState]) -> f64 {
    let speeds = states.iter().map(|state| state.velocity.abs());
    speeds.fold(0.0, f64::max)
}

/// Largest mean change of depth (m) of a camera's pictures; `None` where no camera saw the robot twice.
fn changed(before: &Pictures, after: &Pictures) -> Option<f64> {
    let frames = before.frames.iter().zip(&after.frames);
    let changes = frames.filter_map(|(a, b)| change(&a.value, &b.value));
    changes.fold(None, |most, change| {
        Some(most.map_or(change, |most: f64| most.max(change)))
    })
}
