//! A capture in progress.

use std::ops::ControlFlow;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tdcr_sim::cloud::{PointCloud, VoxelGrid};
use thiserror::Error;

use super::fuse::Fuser;
use super::program::Program;
use super::still::{StillDepth, Stillness, change};
use crate::mask::MaskError;
use crate::plan::{PlanError, Shape};
use crate::rig::{Pictures, Rig, RigError, WinchState};
use crate::servo::Ticks;

/// How often temperatures are read while servos cool.
const COOLING: Duration = Duration::from_secs(1);

/// Longest time that one waits for servos to cool.
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);

/// Why a capture ended.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// The rig did not do what it should.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The robot cannot be told from what else is in a picture.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// There is no command, or no way to it.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// No camera saw the robot.
    #[error("no camera sees the robot under command {index}: are the masks right?")]
    NotSeen {
        /// Which command.
        index: u64,
    },
    /// No camera saw the robot at home.
    #[error("no camera sees the robot at home: are the masks right?")]
    NotSeenAtHome,
    /// The robot at home is not where it was.
    #[error(
        "the robot at home is seen {:.1} mm from where it was at first; safety.drift is {:.1} mm: has a tendon snapped or slipped, \
         or a camera moved? Samples since the last look are not to be trusted",
        1e3 * drift, 1e3 * limit
    )]
    Drift {
        /// Distance of what is seen from where it was (m).
        drift: f64,
        /// What it may be (m).
        limit: f64,
    },
    /// Servos stay hot.
    #[error(
        "servo {id} is still at {temperature} degrees Celsius after {} s of rest; safety.resume_below is {limit}",
        waited.as_secs()
    )]
    Hot {
        /// Address of the servo.
        id: u8,
        /// Its temperature (degrees Celsius).
        temperature: f64,
        /// What it should come to (degrees Celsius).
        limit: f64,
        /// How long one waited.
        waited: Duration,
    },
}

/// What a session captures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SessionSettings {
    /// Seed of the commands.
    pub seed: u64,
    /// Edge of the voxel grid that thins the fused clouds (m).
    pub voxel_size: f64,
}

/// A sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Captured {
    /// Which command.
    pub index: u64,
    /// When the first picture was taken, by the rig's clock.
    pub time: Duration,
    /// The command (m), to a tick.
    pub command: Vec<f64>,
    /// The same as positions of the servos, from home.
    pub goals: Vec<Ticks>,
    /// What the servos did when the pictures were taken.
    pub states: Vec<WinchState>,
    /// What the cameras saw of the robot, fused and thinned (m, world).
    pub cloud: PointCloud,
    /// Largest difference between the times of the pictures.
    pub skew: Duration,
    /// How stillness came.
    pub stillness: Stillness,
}

/// A look at the robot in its home pose, which tells what has changed since the first one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sentinel {
    /// Mean of the points that were seen (m, world).
    pub centroid: [f64; 3],
    /// Currents of the servos, positive where they pull (A).
    pub pulls: Vec<f64>,
    /// Distance of the centroid from that of the first look (m).
    pub drift: f64,
    /// Largest change of a current since the first look (A).
    pub current_drift: f64,
}

/// A capture in progress: a rig that is engaged until the session ends.
pub struct Session<'a> {
    rig: &'a mut Rig,
    program: Program,
    fuser: Fuser,
    /// Where the robot is.
    at: Shape,
    reference: Option<Sentinel>,
    go_on: &'a mut dyn FnMut() -> ControlFlow<()>,
}

impl<'a> Session<'a> {
    /// Engages the rig and brings the robot into its home pose. `reference` is the first look at it there, of an earlier session
    /// that this one goes on with. `go_on` is asked again and again whether to; where it says no, the session ends with
    /// [`RigError::Interrupted`], the tension released.
    ///
    /// # Errors
    /// [`CaptureError`].
    pub fn begin(
        rig: &'a mut Rig,
        settings: &SessionSettings,
        reference: Option<Sentinel>,
        go_on: &'a mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<Self, CaptureError> {
        let program = Program::new(rig.file(), settings.seed)?;
        rig.warm_up()?;
        rig.engage()?;
        rig.go_home()?;
        Ok(Self {
            fuser: Fuser {
                grid: VoxelGrid::new(settings.voxel_size),
                masker: rig.spec().masks.masker(),
            },
            at: program.rest().clone(),
            program,
            reference,
            rig,
            go_on,
        })
    }

    /// The rig.
    pub fn rig(&mut self) -> &mut Rig {
        self.rig
    }

    /// Where the robot is.
    pub fn shape(&self) -> &Shape {
        &self.at
    }

    /// What the session is going to do.
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// Captures command `index` of the session's seed.
    ///
    /// # Errors
    /// [`CaptureError`]; after one of the rig the tension is released.
    pub fn sample(&mut self, index: u64) -> Result<Captured, CaptureError> {
        let drawn = self.program.draw(index)?;
        self.rig.poll()?;
        self.visit(drawn.shape)?;
        self.observe(index)
    }

    /// Brings the robot into a shape.
    ///
    /// # Errors
    /// [`CaptureError::Plan`] where it cannot be reached, and nothing has moved; else as [`sample`](Self::sample).
    pub fn visit(&mut self, shape: Shape) -> Result<(), CaptureError> {
        let path = self.program.path(&self.at, &shape)?;
        self.rig.move_along(&path, self.go_on)?;
        self.at = shape;
        Ok(())
    }

    /// Waits until the robot is still and captures it as it is, under the number `index`.
    ///
    /// # Errors
    /// As [`sample`](Self::sample).
    pub fn observe(&mut self, index: u64) -> Result<Captured, CaptureError> {
        let (pictures, stillness) = self.wait_until_still(index as usize)?;
        let states = self.rig.poll()?.to_vec();
        let cloud = self.fuser.fuse(&pictures);
        self.rig.poll()?;
        if cloud.is_empty() {
            return Err(CaptureError::NotSeen { index });
        }
        let goals = self.rig.held_goals().unwrap_or_default().to_vec();
        let winches = self.rig.winches().iter().zip(&goals);
        Ok(Captured {
            index,
            time: pictures
                .frames
                .iter()
                .map(|frame| frame.time)
                .min()
                .unwrap_or_default(),
            command: winches
                .map(|(winch, &goal)| winch.spool.command(goal))
                .collect(),
            goals,
            states,
            cloud,
            skew: pictures.skew,
            stillness,
        })
    }

    /// Goes home and looks at the robot there.
    ///
    /// # Errors
    /// [`CaptureError::Drift`]; as [`sample`](Self::sample).
    pub fn sentinel(&mut self) -> Result<Sentinel, CaptureError> {
        self.visit(self.program.rest().clone())?;
        let (pictures, _) = self.wait_until_still(0)?;
        let pulls: Vec<f64> = self.rig.poll()?.iter().map(|state| state.pull).collect();
        let cloud = self.fuser.fuse(&pictures);
        self.rig.poll()?;
        if cloud.is_empty() {
            return Err(CaptureError::NotSeenAtHome);
        }
        let count = cloud.len() as f64;
        let mean =
            |axis: usize| cloud.points.iter().map(|p| f64::from(p[axis])).sum::<f64>() / count;
        let mut sentinel = Sentinel {
            centroid: [mean(0), mean(1), mean(2)],
            pulls,
            drift: 0.0,
            current_drift: 0.0,
        };
        if let Some(first) = &self.reference {
            let apart = (0..3).map(|k| (sentinel.centroid[k] - first.centroid[k]).powi(2));
            sentinel.drift = apart.sum::<f64>().sqrt();
            let pulls = sentinel.pulls.iter().zip(&first.pulls);
            sentinel.current_drift = pulls.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let limit = self.rig.spec().safety.drift;
            if sentinel.drift > limit {
                let drift = sentinel.drift;
                return Err(CaptureError::Drift { drift, limit });
            }
        } else {
            self.reference = Some(sentinel.clone());
        }
        Ok(sentinel)
    }

    /// Lets servos that are too hot rest, at home and switched off, until they have cooled; says how long that took, if it had
    /// to be.
    ///
    /// # Errors
    /// As [`sample`](Self::sample); [`CaptureError::Hot`] where they do not cool within an hour.
    pub fn cool(&mut self) -> Result<Option<Duration>, CaptureError> {
        let safety = self.rig.spec().safety.clone();
        let (_, hottest) = self.rig.hottest()?;
        if hottest <= safety.pause_above {
            return Ok(None);
        }
        self.visit(self.program.rest().clone())?;
        self.rig.release()?;
        let began = self.rig.clock().now();
        loop {
            self.ask()?;
            let (id, temperature) = self.rig.hottest()?;
            let waited = self.rig.clock().now().saturating_sub(began);
            if temperature < safety.resume_below {
                self.rig.engage()?;
                self.rig.go_home()?;
                self.at = self.program.rest().clone();
                return Ok(Some(waited));
            }
            if waited > LONGEST_PAUSE {
                return Err(CaptureError::Hot {
                    id: id.get(),
                    temperature,
                    limit: safety.resume_below,
                    waited,
                });
            }
            self.rig.clock().wait(COOLING);
        }
    }

    /// Releases the tension.
    ///
    /// # Errors
    /// As [`Rig::release`].
    pub fn end(self) -> Result<(), RigError> {
        self.rig.release()
    }

    fn ask(&mut self) -> Result<(), RigError> {
        match (self.go_on)() {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => {
                self.rig.release()?;
                Err(RigError::Interrupted)
            }
        }
    }

    /// Waits until servos and depth are still, as long as patience lasts; the last pictures.
    fn wait_until_still(&mut self, sample: usize) -> Result<(Pictures, Stillness), CaptureError> {
        let motion = self.rig.spec().motion.clone();
        let began = self.rig.clock().now();
        let deadline = began + Duration::from_secs_f64(motion.patience);
        let mut before: Option<Pictures> = None;
        loop {
            self.ask()?;
            let speed = self.rig.poll()?.iter().map(|state| state.velocity.abs());
            let speed = speed.fold(0.0, f64::max);
            let now = self.rig.clock().now();
            let late = now >= deadline;
            if speed > motion.still_speed && !late {
                continue;
            }
            let pictures = self.fuser.keep_robot(self.rig.grab()?, sample)?;
            let changes = before.as_ref().map(|before| {
                let frames = before.frames.iter().zip(&pictures.frames);
                let changes = frames.filter_map(|(a, b)| change(&a.value, &b.value));
                changes.fold(None, |most: Option<f64>, c| {
                    Some(most.map_or(c, |m| m.max(c)))
                })
            });
            let still =
                changes.is_some_and(|most| most.is_none_or(|most| most <= motion.still_depth));
            if still && speed <= motion.still_speed || late {
                let stillness = Stillness {
                    waited: now - began,
                    change: changes.flatten(),
                    speed,
                    end: match still && speed <= motion.still_speed {
                        true => StillDepth::Still,
                        false => StillDepth::Moving,
                    },
                };
                return Ok((pictures, stillness));
            }
            before = Some(pictures);
        }
    }
}

impl Drop for Session<'_> {
    /// Releases the tension of a session that did not come to its [`end`](Session::end).
    fn drop(&mut self) {
        if self.rig.is_engaged() {
            let released = self.rig.release_at_once();
            if !released.is_complete() {
                tracing::warn!("{released}");
            }
        }
    }
}
