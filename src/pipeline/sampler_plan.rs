//! How a prediction is asked to follow the flow.

use clap::Args;
use tdcr_learn::flow::{Method, Sampler, TimeGrid};
use tdcr_learn::options::cli::named;
use tdcr_learn::train::{Model, Target};

use super::{PipelineError, TrainRunError};

/// How the network's flow is integrated; what is `None` is the model's own. The one list of these options: the command line and
/// Python take their names and types from it, and the former its documentation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Args)]
pub struct SamplerPlan {
    /// Integration method: heun evaluates the network twice per step, the others once [default: the model's own]
    #[arg(long, value_parser = named(Method::ALL, Method::name))]
    pub sampler: Option<Method>,
    /// Number of steps; with a tolerance, the largest number of steps [default: the model's own; 200 with a tolerance]
    #[arg(long, value_name = "N")]
    pub sampler_steps: Option<usize>,
    /// Exponent p of the time grid 1 - (1 - k/n)^p; 1 is uniform, as in the paper [default: the model's own]
    #[arg(long, value_name = "P")]
    pub sampler_power: Option<f32>,
    /// Adaptive steps with this local error tolerance, relative to the data's extent (for adams-bashforth, exponential and
    /// exponential3)
    #[arg(long, value_name = "TOL", conflicts_with = "sampler_power")]
    pub sampler_tolerance: Option<f32>,
    /// Flow time T, below 1, of a last evaluation that takes the points to the data predicted there; 1: no such evaluation.
    /// A refined model makes it by a network of its own at its own time, and again to correct points, at others by the flow's network [default: the model's own]
    #[arg(long, value_name = "T")]
    pub sampler_denoise: Option<f32>,
    /// Points to draw beyond those asked for, as a share of these; isolated and crowded ones are left out, and the others moved
    /// apart along the surface [default: the model's own]
    #[arg(long, value_name = "SHARE")]
    pub sampler_spare: Option<f32>,
}

impl SamplerPlan {
    /// Most adaptive steps, where they are not said.
    pub const MOST_STEPS: usize = 200;

    /// The sampler for `model`.
    ///
    /// # Errors
    /// [`TrainRunError::Sampler`] for values that describe none, [`TrainRunError::OwnSampler`] where the model was distilled
    /// for another.
    pub fn resolve(&self, model: &Model) -> Result<Sampler, PipelineError> {
        let (settings, own) = (&model.settings, model.settings.sampler);
        let sampler = Sampler {
            method: self.sampler.unwrap_or(own.method),
            steps: match self.sampler_tolerance {
                None => self.sampler_steps.unwrap_or(own.steps),
                Some(_) => self.sampler_steps.unwrap_or(Self::MOST_STEPS),
            },
            grid: match (self.sampler_tolerance, self.sampler_power) {
                (Some(tolerance), _) => TimeGrid::Adaptive(tolerance),
                (None, Some(power)) => TimeGrid::Power(power),
                (None, None) => own.grid,
            },
            denoise: match self.sampler_denoise {
                None => own.denoise,
                Some(1.0) => None,
                denoise => denoise,
            },
            spare: self.sampler_spare.unwrap_or(own.spare),
            colors: own.colors,
        };
        sampler.check()?;
        match settings.target == Target::Velocity
            || (Sampler {
                spare: own.spare,
                ..sampler
            }) == own
        {
            true => Ok(sampler),
            false => Err(TrainRunError::OwnSampler {
                evaluations: model.evaluations(),
            }
            .into()),
        }
    }
}
