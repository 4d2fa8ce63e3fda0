//! A tip led along a path by a controller: on a simulated robot that differs from the controller's model, the open loop beside it, or on a
//! rig.

mod log;
mod options;
mod results;
mod rig;
mod steer;

pub use log::write_log;
pub use options::{
    ControllerName, Sight, TrackOptions, TruthOptions, closed_path, curve_named, path_of_rows,
};
pub use results::{EstimatedJson, IncidentJson, TrackSummary, headline, page, table};
pub use rig::{RigLimitsError, RigPlant};
pub use steer::{SteerError, TipSteer};

use std::ops::ControlFlow;

use nalgebra::Vector3;
use tdcr_control::belief::BeliefError;
use tdcr_control::controller::{Inverse, LimitsError};
use tdcr_control::estimator::EstimatorSettings;
use tdcr_control::lag::Delay;
use tdcr_control::learning::Learner;
use tdcr_control::plant::{Plant, PlantError, SimulatedPlant, Truth, TruthError};
use tdcr_control::tip_path::{TipPath, TipPathError};
use tdcr_control::tracking::{Tracking, TrackingError, TrackingRow, TrackingSettings, track};
use tdcr_control::watch::{Incident, WatchSettings};
use tdcr_hw::capture::CaptureError;
use tdcr_hw::rig::Rig;
use tdcr_sim::inverse::shape::{Outcome, Search, ShapeControlError, ShapeController, Target};
use tdcr_sim::robot::{Command, Loads, LoadsError, Robot};
use tdcr_sim::scene::Scene;
use thiserror::Error;

/// Longest delay that is looked for (periods).
const LONGEST_DELAY: usize = 4;

/// Why a path cannot be tracked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrackError {
    /// It is no path.
    #[error(transparent)]
    Path(#[from] TipPathError),
    /// The path's first point is not reached by the model.
    #[error("the path starts {distance:.4} m out of reach of robot `{robot}`: at {start:?} m")]
    Start {
        /// Name of the robot.
        robot: String,
        /// The first point (m).
        start: [f64; 3],
        /// How far the nearest command found is from it (m).
        distance: f64,
    },
    /// A number that makes no sense.
    #[error("the {what} is {value}; expected {low} to {high}")]
    Option {
        /// Which, with its unit.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The smallest that it may be.
        low: f64,
        /// The largest.
        high: f64,
    },
    /// The search for a command at the start failed.
    #[error(transparent)]
    Search(Box<ShapeControlError>),
    /// Loads that are none.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// The simulated robot is none.
    #[error(transparent)]
    Truth(Box<TruthError>),
    /// Limits that make no sense.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// The model is none.
    #[error(transparent)]
    Model(Box<BeliefError>),
    /// The run failed.
    #[error(transparent)]
    Run(Box<TrackingError>),
    /// A rig that sees nothing.
    #[error(
        "rig `{0}` has no cameras; expected some, as the robot's clouds are what is measured, or a controller that measures nothing"
    )]
    NoCameras(String),
    /// A load of a robot on the desk, where only people hang masses.
    #[error("a payload of {mass} kg is given, and rig `{rig}` is not simulated; expected 0")]
    Payload {
        /// Name of the rig.
        rig: String,
        /// The mass (kg).
        mass: f64,
    },
    /// What is asked of a rig is not within its limits.
    #[error(transparent)]
    RigLimits(Box<RigLimitsError>),
    /// The rig stopped, and released the tension.
    #[error(transparent)]
    Rig(Box<CaptureError>),
}

/// The large ones lie in boxes: a result that fails is no larger than one that does not.
macro_rules! boxed {
    ($($variant:ident: $error:ty),*) => {$(
        impl From<$error> for TrackError {
            fn from(error: $error) -> Self {
                Self::$variant(Box::new(error))
            }
        }
    )*};
}
boxed!(
    Search: ShapeControlError,
    Truth: TruthError,
    Model: BeliefError,
    RigLimits: RigLimitsError,
    Rig: CaptureError
);

/// What stopped a rig is said as such.
impl From<TrackingError> for TrackError {
    fn from(error: TrackingError) -> Self {
        match error {
            TrackingError::Plant(PlantError::Other(other)) => match other.downcast() {
                Ok(stopped) => Self::Rig(stopped),
                Err(other) => Self::Run(Box::new(PlantError::Other(other).into())),
            },
            error => Self::Run(Box::new(error)),
        }
    }
}

/// A run along a path, and the open loop on the same robot.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// The run, of several trials the last.
    pub run: Tracking,
    /// Root mean square error of each trial (m); `None` of one that did not come to the path.
    pub trials: Vec<Option<f64>>,
    /// The same by [`Inverse`], which looks at nothing; the run itself where that is its controller.
    pub open_loop: Option<Tracking>,
    /// Time between commands (s).
    pub period: f64,
    /// Mass that the robot bears in truth, and the controller does not know of (kg); NaN where nobody knows.
    pub payload: f64,
    /// Periods that took longer than they were to.
    pub late: usize,
}

/// Distance (m) from the path's first point within which the search for a first command ends.
const START: f64 = 1e-5;

/// What controllers know of a robot: the robot, and the obstacles around it.
#[derive(Clone, Copy, Debug)]
pub struct Model<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// What it settles among.
    pub scene: &'a Scene,
}

/// Leads the tip of a simulated robot along `path` by a model of it. `each` sees every period of the run (not those of the open
/// loop), and may end it by `false`.
///
/// # Errors
/// [`TrackError`].
pub fn track_simulated(
    model: Model<'_>,
    truth: &Truth,
    path: &TipPath,
    options: &TrackOptions,
    each: &mut dyn FnMut(&TrackingRow) -> bool,
) -> Result<Tracked, TrackError> {
    let start = first_command(model, path, options.seed)?;
    let mut plant = SimulatedPlant::new(truth, options.period(), &start, options.seed)?;
    let (run, trials) = track_plant(&mut plant, model, &start, path, options, each)?;
    let open_loop = match options.controller {
        ControllerName::Inverse if options.trials == 1 => None,
        _ => {
            let mut settings = settings(model, options, options.period())?;
            // Nothing steers an open loop: that it is far off is what is asked.
            settings.watch.error = f64::INFINITY;
            // It does not look at clouds, which are what takes the time.
            let mut unseen = truth.clone();
            unseen.sensors.cloud = None;
            let mut plant = SimulatedPlant::new(&unseen, options.period(), &start, options.seed)?;
            let mut inverse = Inverse::default();
            Some(track(
                &mut plant,
                model.robot,
                &start,
                path,
                &mut inverse,
                &settings,
                &mut |_| true,
            )?)
        }
    };
    Ok(Tracked {
        run,
        trials,
        open_loop,
        period: options.period(),
        payload: truth.loads.tip_payload().mass,
        late: 0,
    })
}

/// Leads the tip of a rig's robot along `path`, seen by its cameras. The model is among the obstacles of `scene`, and where none is given among those of
/// the rig's own `[scene]`. Its motors are on meanwhile; however this ends, the tension is
/// released. `payload` (kg) is hung from a simulated rig's robot, and nobody tells the controller. `goes_on` is asked again and again
/// whether to go on, and `each` sees every period.
///
/// # Errors
/// [`TrackError`].
pub fn track_rig(
    rig: &mut Rig,
    scene: Option<&Scene>,
    path: &TipPath,
    payload: f64,
    options: &TrackOptions,
    goes_on: &dyn Fn() -> bool,
    each: &mut dyn FnMut(&TrackingRow),
) -> Result<Tracked, TrackError> {
    if rig.cameras().is_empty() && options.controller.make().is_closed_loop() {
        return Err(TrackError::NoCameras(rig.spec().name.clone()));
    }
    let robot = rig.robot().clone();
    let scene = scene.or(rig.file().scene.as_ref()).cloned();
    let model = Model {
        robot: &robot,
        scene: &scene.unwrap_or_default(),
    };
    // That the path begins within reach is known before anything moves.
    first_command(model, path, options.seed)?;
    let (estimator, limits) = (
        rig::estimator(rig.spec(), &robot),
        rig::limits(rig, options)?,
    );
    match rig.simulator() {
        Some(simulator) => simulator.set_loads(Loads::payload(payload)?)?,
        None if payload == 0.0 => {}
        None => {
            return Err(TrackError::Payload {
                rig: rig.spec().name.clone(),
                mass: payload,
            });
        }
    }
    let is_simulated = rig.simulator().is_some();
    let mut go_on = || match goes_on() {
        true => ControlFlow::Continue(()),
        false => ControlFlow::Break(()),
    };
    let mut plant = RigPlant::engage(rig, options, &mut go_on)?;
    let start = robot
        .command(plant.commanded())
        .map_err(TrackingError::from)?;
    let period = plant.period();
    let settings = TrackingSettings {
        estimator,
        limits,
        ..settings(model, options, period)?
    };
    let mut each = |row: &TrackingRow| {
        each(row);
        goes_on()
    };
    let (run, trials) = try_again(
        &mut plant, &robot, &start, path, options, settings, &mut each,
    )?;
    let late = plant.late();
    plant.end()?;
    Ok(Tracked {
        run,
        trials,
        open_loop: None,
        period,
        payload: if is_simulated { payload } else { f64::NAN },
        late,
    })
}

/// A run, of several trials the last, and the root mean square error (m) of each trial.
pub type Trials = (Tracking, Vec<Option<f64>>);

/// Leads the tip of any plant along `path` by a model of it; its tendons are under `start`.
///
/// # Errors
/// [`TrackError`].
pub fn track_plant(
    plant: &mut dyn Plant,
    model: Model<'_>,
    start: &Command,
    path: &TipPath,
    options: &TrackOptions,
    each: &mut dyn FnMut(&TrackingRow) -> bool,
) -> Result<Trials, TrackError> {
    let settings = settings(model, options, plant.period())?;
    try_again(plant, model.robot, start, path, options, settings, each)
}

/// Trials of a path with what was learnt in all of them, each from where the first one began, or where the one before ended with a robot
/// that cannot be brought back at once.
fn try_again(
    plant: &mut dyn Plant,
    robot: &Robot,
    start: &Command,
    path: &TipPath,
    options: &TrackOptions,
    mut settings: TrackingSettings,
    each: &mut dyn FnMut(&TrackingRow) -> bool,
) -> Result<Trials, TrackError> {
    let (mut learner, mut start) = (Learner::default(), start.clone());
    let mut errors = Vec::new();
    loop {
        let mut controller = options.controller.make();
        let mut run = track(
            plant,
            robot,
            &start,
            path,
            &mut *controller,
            &settings,
            each,
        )?;
        errors.push(run.rms_error());
        if errors.len() >= options.trials || run.stopped.is_some() {
            run.incidents.extend(rise(&errors, path.duration()));
            return Ok((run, errors));
        }
        if let (false, Some(last)) = (
            plant.restart().map_err(TrackingError::from)?,
            run.last_given(),
        ) {
            start = robot.command(last).map_err(TrackingError::from)?;
        }
        learner.learn(&mut settings.correction, &run, plant.period());
    }
}

/// What is said where the last trial's error (m) is not the smallest.
fn rise(errors: &[Option<f64>], time: f64) -> Option<Incident> {
    let last = (*errors.last()?)?;
    let known = errors.iter().enumerate();
    let known = known.filter_map(|(place, error)| Some((place + 1, (*error)?)));
    let (trial, least) = known.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (least < last).then(|| Incident {
        time,
        reason: format!(
            "the last trial's error, {:.3} mm, is above the {:.3} mm of trial {trial}",
            1e3 * last,
            1e3 * least
        ),
        is_end: false,
    })
}

fn settings(
    Model { robot, scene }: Model<'_>,
    options: &TrackOptions,
    period: f64,
) -> Result<TrackingSettings, TrackError> {
    let tension = options.tension.unwrap_or([0.0, f64::INFINITY]);
    Ok(TrackingSettings {
        approach: options.approach,
        loads: Loads::default(),
        scene: scene.clone(),
        correction: Vec::new(),
        estimator: EstimatorSettings::for_robot(robot),
        delay: Delay::Estimated {
            most: LONGEST_DELAY,
        },
        limits: tdcr_control::controller::Limits::new(robot, period, options.rate, tension)?,
        watch: WatchSettings::default(),
    })
}

/// The command under which the model, without loads, has its tip at the path's first point.
///
/// # Errors
/// [`TrackError::Start`] where none is found.
pub fn first_command(
    Model { robot, scene }: Model<'_>,
    path: &TipPath,
    seed: u64,
) -> Result<Command, TrackError> {
    let search = Search {
        tolerance: START,
        seed,
        ..Search::default()
    };
    let controller = ShapeController::among(robot, scene, &Loads::default(), search)?;
    let start: Vector3<f64> = path.at(0.0);
    let found = controller.reach(&[Target::tip(robot, start)])?;
    match found.outcome {
        Outcome::Reached => Ok(found.command),
        _ => Err(TrackError::Start {
            robot: robot.spec().name.clone(),
            start: start.into(),
            distance: found.errors[0],
        }),
    }
}
