//! A capture in progress.

use std::ops::ControlFlow;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tdcr_sim::cloud::{PointCloud, VoxelGrid};
use tdcr_sim::robot::Loads;

use super::Session;
use super::error::CaptureError;
use super::fuse::{Fuser, masked};
use super::program::Program;
use super::still::Stillness;
use super::wait::{Purpose, Seen};
use crate::log::{Event, Level, LogRecord};
use crate::mask::MaskFolder;
use crate::plan::Place;
use crate::rig::{Rig, RigError, WinchState};
use crate::servo::Ticks;

/// How often temperatures are read while servos cool.
const COOLING: Duration = Duration::from_secs(1);

/// Longest time that one waits for servos to cool.
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);

/// What a session captures.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionSettings {
    /// Seed of the commands.
    pub seed: u64,
    /// Edge of the voxel grid that thins the fused clouds (m).
    pub voxel_size: f64,
    /// Masks of the samples that another program has written, for their clouds: those of the rig's file then only say whether
    /// the robot is still, and where it is at home.
    pub masks: Option<MaskFolder>,
    /// What the robot carries: tensions are simulated under it.
    pub loads: Loads,
    /// What it carries in other sessions whose commands are the same.
    pub other_loads: Vec<Loads>,
}

/// Clouds of a point for every 2 mm, of a robot that carries nothing.
impl Default for SessionSettings {
    fn default() -> Self {
        Self {
            seed: 0,
            voxel_size: 0.002,
            masks: None,
            loads: Loads::default(),
            other_loads: Vec::new(),
        }
    }
}

/// A sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Captured {
    /// Which command.
    pub index: u64,
    /// When the first picture was taken, by the rig's clock.
    pub time: Duration,
    /// The command that the robot had (m): the positions of the servos, as they were read after the pictures. It is not that of
    /// their goals, from which they stand some ticks off.
    pub command: Vec<f64>,
    /// Goals of the servos, from home. Each stood within `motion.arrived` of its goal before and after the pictures.
    pub goals: Vec<Ticks>,
    /// What the servos did after the pictures were taken.
    pub states: Vec<WinchState>,
    /// What the cameras saw of the robot, fused and thinned (m, world).
    pub cloud: PointCloud,
    /// Largest difference between the times of the pictures.
    pub skew: Duration,
    /// How stillness came.
    pub stillness: Stillness,
}

impl Captured {
    /// Mean of the points that were seen (m, world).
    pub fn centroid(&self) -> [f64; 3] {
        centroid(&self.cloud)
    }
}

/// Mean of the points (m) of a cloud that has some.
fn centroid(cloud: &PointCloud) -> [f64; 3] {
    let sum = |axis: usize| cloud.points.iter().map(|p| f64::from(p[axis])).sum::<f64>();
    [0, 1, 2].map(|axis| sum(axis) / cloud.len() as f64)
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
        let program = Program::new(rig.file(), settings.seed)?
            .carrying(settings.loads.clone(), &settings.other_loads)?;
        let fuser = Fuser {
            grid: VoxelGrid::new(settings.voxel_size),
            masker: rig.masker()?,
        };
        rig.warm_up()?;
        rig.engage()?;
        rig.go_home()?;
        Ok(Self {
            fuser,
            masks: settings.masks.clone(),
            at: program.rest().clone().into(),
            program,
            reference,
            scales: Vec::new(),
            restarted: Vec::new(),
            rig,
            go_on,
        })
    }

    /// The rig.
    pub fn rig(&mut self) -> &mut Rig {
        self.rig
    }

    /// Where the robot is.
    pub fn place(&self) -> &Place {
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
        let drawn = self.plan(|program| program.draw(index))??;
        self.sample_at(index, &drawn.shape.into())
    }

    /// Asks the session's program something. The servos are looked after meanwhile.
    ///
    /// # Errors
    /// As [`Rig::hold_while`].
    pub fn plan<T: Send>(
        &mut self,
        ask: impl FnOnce(&mut Program) -> T + Send,
    ) -> Result<T, RigError> {
        let program = &mut self.program;
        self.rig.hold_while(|| ask(program))
    }

    /// Captures the robot in a place, under the number `index`.
    ///
    /// # Errors
    /// As [`visit`](Self::visit) and [`observe`](Self::observe).
    pub fn sample_at(&mut self, index: u64, place: &Place) -> Result<Captured, CaptureError> {
        self.persist(|session| {
            session.rig.poll()?;
            session.visit(place.clone())?;
            session.observe(index)
        })
    }

    /// Brings the robot into a shape, or to a command.
    ///
    /// # Errors
    /// [`CaptureError::Plan`] where it cannot be reached, and nothing has moved; else as [`sample`](Self::sample).
    pub fn visit(&mut self, place: impl Into<Place>) -> Result<(), CaptureError> {
        self.visit_watched(place, &mut |_| {})
    }

    /// The same; `seen` is told after each step what the servos do.
    ///
    /// # Errors
    /// As [`visit`](Self::visit).
    pub fn visit_watched(
        &mut self,
        place: impl Into<Place>,
        seen: &mut dyn FnMut(&[WinchState]),
    ) -> Result<(), CaptureError> {
        let place = place.into();
        let (program, at) = (&mut self.program, &self.at);
        let path = self
            .rig
            .hold_while(|| program.path(at.clone(), place.clone()))??;
        for command in &path {
            self.rig.move_along([command], self.go_on)?;
            seen(self.rig.last_states().unwrap_or_default());
        }
        self.at = place;
        Ok(())
    }

    /// Waits until the robot is still and captures it as it is, under the number `index`.
    ///
    /// # Errors
    /// [`CaptureError::OffGoal`] and [`CaptureError::Pull`] where it is not where it was told to be; as [`sample`](Self::sample).
    pub fn observe(&mut self, index: u64) -> Result<Captured, CaptureError> {
        let Seen {
            pictures,
            robot,
            states,
            stillness,
        } = self.wait_until_still(Purpose::Sample(index))?;
        let (fuser, masks) = (&self.fuser, &self.masks);
        let cloud = self.rig.hold_while(|| {
            let robot = match masks {
                Some(folder) => masked(folder, &pictures, index as usize)?,
                None => robot,
            };
            Ok::<_, CaptureError>(fuser.fuse(&robot))
        })??;
        if cloud.is_empty() {
            return Err(CaptureError::NotSeen { index });
        }
        let command: Vec<f64> = states.iter().map(|state| state.command).collect();
        // Who reads clouds out of the log has them under what was measured, too.
        self.rig.log(|| LogRecord::Command(command.clone()));
        self.rig.log_event(Level::Info, Event::sample_text(index));
        self.rig.log(|| LogRecord::Cloud(cloud.clone()));
        Ok(Captured {
            index,
            time: pictures
                .frames
                .iter()
                .map(|frame| frame.time)
                .min()
                .unwrap_or_default(),
            command,
            goals: self.rig.held_goals().unwrap_or_default().to_vec(),
            states,
            cloud,
            skew: pictures.skew,
            stillness,
        })
    }

    /// Goes home, makes sure that all tendons pull, and looks at the robot there.
    ///
    /// # Errors
    /// [`CaptureError::Slack`], [`CaptureError::Drift`]; as [`sample`](Self::sample).
    pub fn sentinel(&mut self) -> Result<Sentinel, CaptureError> {
        self.persist(|session| {
            session.check_tendons()?;
            session.look_home()
        })
    }

    pub(super) fn look_home(&mut self) -> Result<Sentinel, CaptureError> {
        self.visit(self.program.rest().clone())?;
        let Seen { robot, states, .. } = self.wait_until_still(Purpose::Home)?;
        let pulls: Vec<f64> = states.iter().map(|state| state.pull).collect();
        let fuser = &self.fuser;
        let cloud = self.rig.hold_while(|| fuser.fuse(&robot))?;
        if cloud.is_empty() {
            return Err(CaptureError::NotSeenAtHome);
        }
        self.rig.log_event(Level::Info, "a look at home");
        self.rig.log(|| LogRecord::Cloud(cloud.clone()));
        let mut sentinel = Sentinel {
            centroid: centroid(&cloud),
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
        self.persist(Self::rest_hot_servos)
    }

    fn rest_hot_servos(&mut self) -> Result<Option<Duration>, CaptureError> {
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
                self.at = self.program.rest().clone().into();
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
