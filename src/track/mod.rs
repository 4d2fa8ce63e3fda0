//! A tip led along a path by a controller, on a simulated robot that differs from the controller's model; the open loop beside it.

mod options;
mod results;

pub use options::{
    ControllerName, TrackOptions, TruthOptions, closed_path, curve_named, path_of_rows,
};
pub use results::{EstimatedJson, IncidentJson, TrackSummary, headline, page, table};

use nalgebra::Vector3;
use tdcr_control::belief::BeliefError;
use tdcr_control::controller::{Inverse, LimitsError};
use tdcr_control::estimator::EstimatorSettings;
use tdcr_control::lag::Delay;
use tdcr_control::plant::{Plant, SimulatedPlant, Truth, TruthError};
use tdcr_control::tip_path::{TipPath, TipPathError};
use tdcr_control::tracking::{Tracking, TrackingError, TrackingRow, TrackingSettings, track};
use tdcr_control::watch::WatchSettings;
use tdcr_sim::inverse::shape::{Outcome, Search, ShapeControlError, ShapeController, Target};
use tdcr_sim::robot::{Command, LoadsError, Robot};
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
boxed!(Search: ShapeControlError, Truth: TruthError, Model: BeliefError, Run: TrackingError);

/// A run along a path, and the open loop on the same robot.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// The run.
    pub run: Tracking,
    /// The same by [`Inverse`], which looks at nothing; the run itself where that is its controller.
    pub open_loop: Option<Tracking>,
    /// Time between commands (s).
    pub period: f64,
    /// Mass that the robot bears in truth, and the controller does not know of (kg).
    pub payload: f64,
}

/// Distance (m) from the path's first point within which the search for a first command ends.
const START: f64 = 1e-5;

/// Leads the tip of a simulated robot along `path`, whose model is `robot`. `each` sees every period of the run (not those of the open
/// loop), and may end it by `false`.
///
/// # Errors
/// [`TrackError`].
pub fn track_simulated(
    robot: &Robot,
    truth: &Truth,
    path: &TipPath,
    options: &TrackOptions,
    each: &mut dyn FnMut(&TrackingRow) -> bool,
) -> Result<Tracked, TrackError> {
    let start = first_command(robot, path, options.seed)?;
    let mut plant = SimulatedPlant::new(truth, options.period, &start, options.seed)?;
    let run = track_plant(&mut plant, robot, &start, path, options, each)?;
    let open_loop = match options.controller {
        ControllerName::Inverse => None,
        _ => {
            let mut settings = settings(robot, options, options.period)?;
            // Nothing steers an open loop: that it is far off is what is asked.
            settings.watch.error = f64::INFINITY;
            let mut plant = SimulatedPlant::new(truth, options.period, &start, options.seed)?;
            let mut inverse = Inverse::default();
            Some(track(
                &mut plant,
                robot,
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
        open_loop,
        period: options.period,
        payload: truth.loads.tip_payload().mass,
    })
}

/// Leads the tip of any plant along `path`, whose model is `robot` and whose tendons are under `start`.
///
/// # Errors
/// [`TrackError`].
pub fn track_plant(
    plant: &mut dyn Plant,
    robot: &Robot,
    start: &Command,
    path: &TipPath,
    options: &TrackOptions,
    each: &mut dyn FnMut(&TrackingRow) -> bool,
) -> Result<Tracking, TrackError> {
    let settings = settings(robot, options, plant.period())?;
    let mut controller = options.controller.make();
    Ok(track(
        plant,
        robot,
        start,
        path,
        &mut *controller,
        &settings,
        each,
    )?)
}

fn settings(
    robot: &Robot,
    options: &TrackOptions,
    period: f64,
) -> Result<TrackingSettings, TrackError> {
    let tension = options.tension.unwrap_or([0.0, f64::INFINITY]);
    Ok(TrackingSettings {
        approach: options.approach,
        loads: tdcr_sim::robot::Loads::default(),
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
pub fn first_command(robot: &Robot, path: &TipPath, seed: u64) -> Result<Command, TrackError> {
    let search = Search {
        tolerance: START,
        seed,
        ..Search::default()
    };
    let controller = ShapeController::new(robot, &tdcr_sim::robot::Loads::default(), search)?;
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
