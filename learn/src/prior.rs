//! Where the flow starts: noise about the origin, or the surface of a simulated robot.
//!
//! A simulator that is wrong by millimetres knows nearly all of a robot's shape. With [`Prior::Surface`] the flow starts at
//! points of the simulated surface under the condition, and the network learns what carries them to the real one: a small,
//! smooth field, which few samples determine. Network, loss and samplers are those of the Gaussian prior, of which the
//! paper's (Sec. Method) is one.
//!
//! A training cloud is matched one to one with points of its simulated surface before the run, all points at once, such that the
//! mean squared distance is least (optimal transport). Were small groups matched at every step, partners would lie
//! centimetres apart along the surface, and the mean of such displacements pulls points of a curved surface into the robot.
//!
//! The points are those that the model's cameras see, with pixels and voxels in random phases, so they cover the same parts of
//! the robot in the same density as a data set's.

use rand::Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use tdcr_base::hash::hash;
use tdcr_sim::robot::{Robot, SpecError};

use crate::channels::{Channels, DIM};
use crate::data::{CloudSet, Condition, Normalisation, Recipe, SimulateError, Simulator};
use crate::flow::{Stream, rng};
use crate::metrics::{MetricError, emd_squared};

/// Where the flow starts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Prior {
    /// Noise of [`FlowPath::prior_deviation`](crate::flow::FlowPath::prior_deviation) about the origin, whatever the condition
    /// (the paper's).
    #[default]
    Gaussian,
    /// Points of the surface of a simulated robot under the condition, and noise of
    /// [`FlowPath::prior_deviation`](crate::flow::FlowPath::prior_deviation) about them.
    Surface(Box<Recipe>),
}

impl Prior {
    /// Standard deviation of the noise about a simulated surface, in normalised units, where none is asked for.
    pub const SURFACE_DEVIATION: f32 = 0.005;

    /// Whether it is noise alone.
    pub fn is_gaussian(&self) -> bool {
        matches!(self, Self::Gaussian)
    }

    /// What tells it from other priors.
    pub(crate) fn fingerprint(&self) -> String {
        let text = serde_json::to_string(self).expect("plain values serialise");
        format!("{:016x}", hash(text.bytes().map(u32::from)))
    }
}

/// Why there is no surface to start from.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// The robot cannot be built.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// It has another number of tendons than the conditions have motors.
    #[error(
        "the prior's robot has {tendons} tendons, the conditions have {values} values: expected {tendons}, or one more for a payload"
    )]
    Values {
        /// Tendons of the robot.
        tendons: usize,
        /// Values of a condition.
        values: usize,
    },
    /// It cannot be simulated under a condition.
    #[error("the prior's robot: {0}")]
    Simulate(#[from] SimulateError),
    /// A cloud cannot be matched with its surface.
    #[error("matching a cloud with the prior's surface: {0}")]
    Cloud(#[from] MetricError),
    /// Making the surfaces was interrupted.
    #[error("interrupted")]
    Interrupted,
}

/// A simulated robot whose surface is a prior.
#[derive(Clone, Debug)]
pub struct SurfacePrior {
    robot: Robot,
    recipe: Recipe,
}

impl SurfacePrior {
    /// The prior by `recipe`.
    ///
    /// # Errors
    /// [`SpecError`] where its robot is refused.
    pub fn new(recipe: &Recipe) -> Result<Self, SpecError> {
        Ok(Self {
            robot: Robot::new(recipe.subject.robot.clone())?,
            recipe: recipe.clone(),
        })
    }

    /// `count` points (m, world frame), row-major `(count, 3)`, independent of each other, of the surface under `values`
    /// `(D)`: the command, then the payload (kg) where there is one more value than tendons.
    ///
    /// # Errors
    /// [`SurfaceError`] where the values do not fit the robot or it cannot be simulated under them.
    pub fn points(
        &self,
        values: &[f64],
        count: usize,
        rng: &mut impl Rng,
    ) -> Result<Vec<f32>, SurfaceError> {
        let mut simulator = Simulator::new(&self.robot, &self.recipe);
        let cloud = simulator.independent_points(&self.condition(values)?, count, rng)?;
        Ok(cloud.points.into_flattened())
    }

    /// For each point of `set`, whose conditions are `conditions`, the point of the simulated surface that the flow to it starts
    /// from, row-major `(B, N, 3)` in the units of `normalisation`: each cloud is matched with as many points of its surface,
    /// one to one, such that the mean squared distance is least. On all cores; a function of the set and `seed`. `made` is told
    /// of every cloud, and says whether to go on.
    ///
    /// # Errors
    /// As [`points`](Self::points); [`SurfaceError::Cloud`] where a cloud cannot be matched; [`SurfaceError::Interrupted`] where
    /// `made` says so.
    pub fn starts(
        &self,
        set: &CloudSet,
        conditions: &[Condition],
        normalisation: &Normalisation,
        seed: u64,
        made: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<f32>, SurfaceError> {
        let simulator = || Simulator::new(&self.robot, &self.recipe);
        let surfaces = conditions.par_iter().enumerate();
        let surfaces = surfaces.map_init(simulator, |simulator, (index, condition)| {
            if !made() {
                return Err(SurfaceError::Interrupted);
            }
            let rng = &mut rng(seed, Stream::Sample(index as u64));
            let condition = self.condition(&condition.to_vec())?;
            simulator.displace(rng);
            let cloud = simulator.cloud(&condition, set.points_per_cloud, rng)?;
            let mut surface = cloud.points;
            normalisation.normalise_points(surface.as_flattened_mut());
            let (targets, _) = set.cloud(index).as_chunks::<DIM>();
            let matched = emd_squared(targets, &surface)?.matching;
            Ok(matched.iter().flat_map(|&k| surface[k]).collect::<Vec<_>>())
        });
        Ok(surfaces.collect::<Result<Vec<_>, _>>()?.concat())
    }

    /// What tells its clouds from those of another prior.
    pub(crate) fn fingerprint(&self) -> String {
        Prior::Surface(Box::new(self.recipe.clone())).fingerprint()
    }

    /// Values as a condition of the robot.
    fn condition(&self, values: &[f64]) -> Result<Condition, SurfaceError> {
        // With those of obstacles that are moved.
        let tendons = self.robot.tendons().len() + self.recipe.subject.obstacle_numbers();
        let (motors, payload) = match values.len().checked_sub(tendons) {
            Some(0) => (values, None),
            Some(1) => (&values[..tendons], Some(values[tendons] as f32)),
            _ => {
                return Err(SurfaceError::Values {
                    tendons,
                    values: values.len(),
                });
            }
        };
        Ok(Condition {
            motors: motors.iter().map(|&motor| motor as f32).collect(),
            payload,
        })
    }
}

/// Adds points `which` of `surface`, row-major `(K, 3)`, one after another to the positions of `rows`, row-major `(N, C)`.
pub(crate) fn start_from(surface: &[f32], which: &[usize], channels: Channels, rows: &mut [f32]) {
    let (points, _) = surface.as_chunks::<DIM>();
    for (row, &from) in rows.chunks_exact_mut(channels.count()).zip(which) {
        for (x, start) in row.iter_mut().zip(points[from]) {
            *x += start;
        }
    }
}
