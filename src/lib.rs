//! Tendon-driven continuum robots: simulate, see, learn, predict, evaluate.
//!
//! The library behind the `tdcr` command line. [`sim`] settles robots and sees them with virtual
//! RGB-D cameras; [`hw`] drives servos and RGB-D cameras, real or simulated; [`learn`] turns clouds into a shape predictor; [`pipeline`] joins the two into
//! stages that resume where they were interrupted; [`base`] has what all of these use; [`report`] shows the result, and [`pages`] joins these two. [`study`]
//! sweeps designs, loads and commands; [`view`] shows a robot in the browser. [`cli`] is the command line, which the binary and the Python package run.
//!
//! ```
//! use tdcr::learn::net::MlpShape;
//! use tdcr::learn::train::TrainSettings;
//! use tdcr::sim::robot::RobotSpec;
//! use tdcr::sim::scene::Scene;
//! use tdcr::pipeline::{CollectSettings, Silent, TrainingData, collect, train};
//!
//! # let folder = tempfile::tempdir()?;
//! # let folder = folder.path();
//! let (data, run) = (folder.join("data"), folder.join("run"));
//! let robot = RobotSpec::standard("2m").unwrap();
//! let settings = CollectSettings { samples: 20, points: 1000, ..CollectSettings::default() };
//! collect(&robot, &Scene::default(), &settings, &data, &Silent)?;
//!
//! // A toy: good shapes take thousands of steps, and a few minutes.
//! let shape = MlpShape { width: 32, depth: 3, embedding: 32, ..MlpShape::default() };
//! let settings = TrainSettings { steps: 50, warmup_steps: 5, validate_every: 25, ..TrainSettings::default() };
//! let trained = train(&TrainingData::Set(data), &run, shape, &settings, None, &Silent)?;
//!
//! let command = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
//! let cloud = trained.model.predict(&command, 500, 0, &trained.model.settings.sampler)?;
//! assert_eq!(cloud.points.len(), 500);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// So that the command line names the crates as any other user of the library does.
extern crate self as tdcr;

pub mod cli;
pub mod pages;
pub mod pipeline;
pub mod reach;
pub mod report;
pub mod study;
pub mod track;
pub mod view;

pub use tdcr_base as base;
pub use tdcr_control as control;
pub use tdcr_hw as hw;
pub use tdcr_learn as learn;
pub use tdcr_sim as sim;
