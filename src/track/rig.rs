//! A rig as a plant: commands within what its file allows, the clouds of its cameras for a measurement.

use std::ops::ControlFlow;
use std::time::Duration;

use nalgebra::Vector3;
use tdcr_control::controller::{Limits, LimitsError};
use tdcr_control::estimator::EstimatorSettings;
use tdcr_control::plant::{Measurement, Plant, PlantError, thinned};
use tdcr_hw::capture::{CaptureError, Fuser, Session, SessionSettings};
use tdcr_hw::plan::{PlanError, Shaper};
use tdcr_hw::rig::{Rig, RigError, RigSpec};
use tdcr_hw::servo::Ticks;
use tdcr_sim::cloud::VoxelGrid;
use tdcr_sim::inverse::recording::Shown;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Command, Robot};
use thiserror::Error;

use super::TrackOptions;

/// Time between commands where nothing else is asked for (s): pictures of several cameras are taken and fused in less.
const PERIOD: f64 = 0.1;
/// Edge of the voxels that thin clouds (m), and most points of a measurement.
const VOXEL: f64 = 3e-3;
const POINTS: usize = 600;
/// Part of a period by which one may be late.
const LATE: f64 = 0.5;
/// Most goals between two commands.
const MOST_GOALS: f64 = 1000.0;

/// An engaged rig. Whatever ends it, its tension is released: [`end`](Self::end) does so as the rig's file says, and dropping it at once.
pub struct RigPlant<'a> {
    session: Session<'a>,
    fuser: Fuser,
    /// Time between commands (s), and goals sent in it.
    period: f64,
    goals: usize,
    /// The last command (m).
    command: Vec<f64>,
    /// When this period ends, by the rig's clock.
    due: Duration,
    /// Where the tip of a simulated robot was at the last measurement (m).
    tip: Option<Vector3<f64>>,
    late: usize,
}

impl<'a> RigPlant<'a> {
    /// Switches the motors on, brings the robot home and makes sure that all tendons pull. Commands are given every period of `options`, to
    /// the nearest multiple of the rig's `motion.period`. `go_on` is asked meanwhile whether to.
    ///
    /// # Errors
    /// [`CaptureError`]; the motors are off then.
    pub fn engage(
        rig: &'a mut Rig,
        options: &TrackOptions,
        go_on: &'a mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<Self, CaptureError> {
        let (period, goals) = period_of(rig.spec(), options.period);
        let fuser = Fuser {
            grid: VoxelGrid::new(VOXEL),
            masker: rig.masker()?,
        };
        let settings = SessionSettings {
            seed: options.seed,
            voxel_size: VOXEL,
            ..SessionSettings::default()
        };
        let mut session = Session::begin(rig, &settings, None, go_on)?;
        session.check_tendons()?;
        let rig = session.rig();
        let command = rig.commanded().unwrap_or_default();
        let due = rig.clock().now() + Duration::from_secs_f64(period);
        Ok(Self {
            session,
            fuser,
            period,
            goals,
            command,
            due,
            tip: None,
            late: 0,
        })
    }

    /// What its tendons are commanded (m).
    pub fn commanded(&self) -> &[f64] {
        &self.command
    }

    /// Periods that took longer than they were to: the path was followed more slowly then.
    pub fn late(&self) -> usize {
        self.late
    }

    /// Releases the tension as the rig's file says.
    ///
    /// # Errors
    /// As [`Rig::release`]; the motors are off then as far as they can be reached.
    pub fn end(self) -> Result<(), CaptureError> {
        Ok(self.session.end()?)
    }

    fn see(&mut self) -> Result<Measurement, CaptureError> {
        let rig = self.session.rig();
        let truth = rig.simulator().map(tdcr_hw::simulated::Simulator::truth);
        self.tip = truth.and_then(|truth| Some(truth.discs.last()?.translation.vector));
        if rig.cameras().is_empty() {
            return Ok(Measurement::default());
        }
        let pictures = rig.grab()?;
        let fuser = &self.fuser;
        let cloud = rig.hold_while(|| {
            let robot = fuser.keep_robot(&pictures, 0)?;
            Ok::<_, CaptureError>(thinned(&fuser.fuse(&robot), POINTS))
        })??;
        Ok(Measurement {
            cloud: Some(cloud),
            ..Measurement::default()
        })
    }

    /// Goes to a command in steps that the rig takes, as many as are left of the period, and more where it is far.
    fn go(&mut self, to: &[f64]) -> Result<(), CaptureError> {
        let rig = self.session.rig();
        let period = rig.spec().motion.period;
        let left = self.due.saturating_sub(rig.clock().now()).as_secs_f64();
        let steps = ((left / period).round() as usize).min(self.goals);
        let goal = rig.robot().command(to).map_err(RigError::from)?;
        rig.move_to_over(&goal, steps, &mut || ControlFlow::Continue(()))?;
        self.command.copy_from_slice(to);
        let (now, period) = (rig.clock().now(), Duration::from_secs_f64(self.period));
        if now > self.due + period.mul_f64(LATE) {
            self.late += 1;
            self.due = now;
        }
        self.due += period;
        Ok(())
    }
}

impl Plant for RigPlant<'_> {
    fn period(&self) -> f64 {
        self.period
    }

    fn measure(&mut self) -> Result<Measurement, PlantError> {
        self.see()
            .map_err(|error| PlantError::Other(Box::new(error)))
    }

    fn command(&mut self, command: &Command) -> Result<(), PlantError> {
        let gone = self.go(command.as_slice());
        gone.map_err(|error| PlantError::Other(Box::new(error)))
    }

    fn true_tip(&self) -> Option<Vector3<f64>> {
        self.tip
    }
}

/// Time between commands (s) and goals sent in it, for one that is asked for.
fn period_of(rig: &RigSpec, asked: Option<f64>) -> (f64, usize) {
    let one = rig.motion.period;
    let goals = (asked.unwrap_or(PERIOD) / one)
        .round()
        .clamp(1.0, MOST_GOALS);
    (goals * one, goals as usize)
}

/// What commands of a rig must keep: the positions that its servos may have, its slew, the tensions that its commands may lead to. Preferred
/// are those under which modules share the mean of their tensions.
pub(super) fn limits(rig: &Rig, options: &TrackOptions) -> Result<Limits, RigLimitsError> {
    let spec = rig.spec();
    let (period, _) = period_of(spec, options.period);
    let tension = options.tension.unwrap_or(spec.commands.tension);
    let slew = options.rate.unwrap_or(spec.motion.slew);
    if slew > spec.motion.slew {
        return Err(RigLimitsError::Rate {
            rate: slew,
            slew: spec.motion.slew,
        });
    }
    let robot = rig.robot();
    let mut limits = Limits::new(robot, period, Some(slew), tension)?;
    for (t, winch) in rig.winches().iter().enumerate() {
        let ends = winch.limits.map(|ticks| winch.spool.command(Ticks(ticks)));
        limits.low[t] = limits.low[t].max(ends[0].min(ends[1]));
        limits.high[t] = limits.high[t].min(ends[0].max(ends[1]));
    }
    let [low, high] = spec.commands.co_contraction;
    let shared = vec![(low + high) / 2.0; robot.tendons().len()];
    let preferred = Shaper::new(robot)
        .map_err(PlanError::from)?
        .straight(&shared);
    limits.preferred = (preferred.iter().enumerate())
        .map(|(t, command)| command.clamp(limits.low[t], limits.high[t]))
        .collect();
    Ok(limits)
}

/// Why a rig's limits and those that were asked for do not fit.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RigLimitsError {
    /// A rate above the rig's.
    #[error("the rate is {rate} m/s; expected at most {slew}, the rig's motion.slew")]
    Rate {
        /// The rate (m/s).
        rate: f64,
        /// That of the rig (m/s).
        slew: f64,
    },
    /// Rates or tensions that make no sense.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// A robot that has no shapes.
    #[error(transparent)]
    Shape(#[from] PlanError),
}

/// What is estimated of a rig's robot, and how its clouds are weighed.
pub(super) fn estimator(rig: &RigSpec, robot: &Robot) -> EstimatorSettings {
    EstimatorSettings {
        shown: Shown::of(robot.spec(), rig.base == BaseVisibility::Shown),
        ..EstimatorSettings::for_robot(robot)
    }
}
