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

pub mod plan;
