//! Plans, estimation and control of tendon-driven continuum robots: whatever can be measured and commanded, simulated or on the
//! desk. It uses the simulator ([`tdcr_sim`]) and knows neither servos and cameras nor learners.
//!
//! [`plan`] finds motions among obstacles:
//!
//! ```
//! use tdcr_control::plan::{Goal, MotionPlanner, PlanSettings};
//! use tdcr_sim::robot::{Loads, Robot};
//! use tdcr_sim::scene::{Obstacle, Scene};
//!
//! let robot = Robot::load("2m")?;
//! let ball = Obstacle::sphere("ball", 0.02)?.at([-0.05, 0.09, 0.29]);
//! let scene = Scene::new(vec![ball])?;
//! let from = robot.command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])?;
//! let to = robot.command(&[0.007, 0.001, 0.034, 0.019, 0.015, 0.026])?;
//!
//! let settings = PlanSettings { clearance: 0.003, ..PlanSettings::default() };
//! let mut planner = MotionPlanner::new(&robot, &scene, &Loads::default(), settings)?;
//! let plan = planner.plan(&from.into(), &Goal::Stance(to.into()))?;
//! for step in &plan.steps {
//!     assert!(step.clearance.is_some_and(|away| away >= 0.003));
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Plant`](plant::Plant) is measured and commanded; an [`Estimator`](estimator::Estimator) tells what pulls at it; a
//! [`Controller`](controller::Controller) chooses the next command; [`track`](tracking::track) leads the tip along a
//! [`TipPath`](tip_path::TipPath), and holds or stops where something goes wrong.
//!
//! ```
//! use tdcr_control::controller::{Limits, ResolvedRate};
//! use tdcr_control::estimator::EstimatorSettings;
//! use tdcr_control::lag::Delay;
//! use tdcr_control::plant::{SimulatedPlant, Truth};
//! use tdcr_control::tip_path::{Shape, TipPath};
//! use tdcr_control::tracking::{TrackingSettings, track};
//! use tdcr_control::watch::WatchSettings;
//! use nalgebra::Isometry3;
//! use tdcr_sim::robot::{Loads, Robot, RobotSpec};
//! use tdcr_sim::scene::Scene;
//!
//! // The robot hangs, as its world is turned over, and bears 2 g that nobody knows of.
//! let mut spec = RobotSpec::load("2m")?;
//! spec.gravity = [0.0, 0.0, 9.81];
//! let robot = Robot::new(spec)?;
//! let (start, period) = (robot.mean_command(), 0.05);
//! let truth = Truth { loads: Loads::payload(0.002)?, ..Truth::ideal(&robot) };
//! let mut plant = SimulatedPlant::new(&truth, period, &start, 0)?;
//! let level = Isometry3::translation(0.0, 0.0, 0.325);
//! let circle = TipPath::closed(Shape::Circle, &level, 0.06, 20.0)?;
//! let settings = TrackingSettings {
//!     approach: 3.0,
//!     loads: Loads::default(),
//!     scene: Scene::default(),
//!     correction: Vec::new(),
//!     estimator: EstimatorSettings::for_robot(&robot),
//!     delay: Delay::Known(0),
//!     limits: Limits::new(&robot, period, None, [0.0, f64::INFINITY])?,
//!     watch: WatchSettings::default(),
//! };
//! let mut controller = ResolvedRate::default();
//! let run = track(&mut plant, &robot, &start, &circle, &mut controller, &settings, &mut |_| true)?;
//! assert!(run.rms_error().is_some_and(|error| error < 1e-3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod belief;
pub mod controller;
pub mod estimator;
mod jacobian;
pub mod lag;
pub mod learning;
pub mod plan;
pub mod plant;
pub mod quadratic;
pub mod tip_path;
pub mod tracking;
pub mod watch;
