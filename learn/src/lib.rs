//! Action-conditioned flow matching: clouds in, a shape predictor out.
//!
//! A robot under a command settles into one shape. From (command, point cloud) pairs a
//! [`Trainer`](train::Trainer) learns a velocity field `u(X, t | c)` that carries points from a Gaussian
//! prior at flow time `t = 0` to the robot's surface under condition `c` at `t = 1`. The result, a
//! [`Model`](train::Model), predicts the cloud of a command it has never seen. Points may have colours
//! ([`Channels::XyzRgb`](net::Channels)), which are carried from a uniform prior along with the positions.
//!
//! ```
//! use tdcr_learn::data::{CloudSet, Normalisation};
//! use tdcr_learn::flow::Sampler;
//! use tdcr_learn::metrics::chamfer;
//! use tdcr_learn::net::{Channels, MlpShape, TimeFeatures};
//! use tdcr_learn::symmetry::Reduction;
//! use tdcr_learn::train::{Provenance, TrainSettings, Trainer};
//!
//! // Eight "robots" that are points: command c, in [0, 0.04] m, puts them at x = 10 c.
//! let conditions: Vec<f32> = (0..8).map(|k| k as f32 / 7.0).collect();
//! let points = conditions.iter().flat_map(|c| [*c, 0.0, 0.0].repeat(16)).collect();
//! let set = CloudSet { condition_dim: 1, points_per_cloud: 16, conditions, points, colors: None, starts: None };
//! let normalisation = Normalisation { motor_min: vec![0.0], motor_max: vec![0.04], scale: 0.4 };
//!
//! let shape = MlpShape { width: 32, depth: 3, embedding: 32, condition_dim: 1, condition_blocks: 0, octaves: 0, time_features: TimeFeatures::Plain, channels: Channels::Xyz };
//! let settings = TrainSettings {
//!     steps: 300,
//!     warmup_steps: 20,
//!     learning_rate: 3e-3,
//!     points: 16,
//!     validation_clouds: 8,
//!     validation_points: 16,
//!     ..TrainSettings::default()
//! };
//! let mut trainer = Trainer::new(shape, settings, &set, &set)?;
//! while !trainer.is_finished() {
//!     trainer.step()?;
//! }
//! trainer.validate(&|a, b| chamfer(a, b).unwrap_or(f64::NAN))?;
//! let provenance = Provenance { subject: None, normalisation, reduction: Reduction::default() };
//! let model = trainer.model(provenance).expect("just validated");
//!
//! let cloud = model.predict(&[0.03], 100, 0, &Sampler::default())?;
//! let mean = cloud.points.iter().map(|point| point[0]).sum::<f32>() / 100.0;
//! assert!((mean - 0.3).abs() < 0.1, "{mean}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! Networks see normalised units: points divided by the data set's scale `s`, commands min-max scaled
//! to `[0, 1]`. Everything outside is in metres. Learning is in `f32`, or with `bfloat16` operands
//! ([`Precision`](net::Precision)), metrics in `f64`. Results are functions of the seed, whatever the number of threads.
//!
//! # Modules
//!
//! - [`data`]: data sets on disk (HDF5) and in memory; splits and normalisation.
//! - [`net`]: the velocity networks, explicit layers with hand-derived backward passes.
//! - [`flow`]: path, prior and flow times; samplers.
//! - [`prior`]: noise or a simulated surface as the start of the flow.
//! - [`symmetry`]: a robot's symmetries in its clouds; data by one representative of each class.
//! - [`predict`]: what turns a condition into a cloud: the trait, and the trivial predictors.
//! - [`train`]: optimisers, schedule, weight average; models and resumable states on disk; distillation to few evaluations.
//! - [`metrics`]: Chamfer and exact earth mover's distance; the spread of points about their surface.
//!
//! # What it is not for
//!
//! It is no framework: the layers serve these networks alone, on a CPU. A command outside the training
//! range is extrapolated without any guarantee.

mod channels;
pub mod data;
pub mod flow;
pub mod metrics;
pub mod net;
pub mod options;
mod pool;
pub mod predict;
pub mod prior;
pub mod symmetry;
pub mod train;
