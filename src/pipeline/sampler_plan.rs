//! How a prediction is asked to follow the flow.

use tdcr_learn::flow::{Method, Sampler, TimeGrid};
use tdcr_learn::train::{Target, TrainSettings};

use super::{PipelineError, TrainRunError};

/// How a prediction is asked to follow the flow; what is `None` is the model's own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SamplerPlan {
    /// Integration method.
    pub method: Option<Method>,
    /// Number of steps; with a tolerance, the most.
    pub steps: Option<usize>,
    /// Exponent of the time grid.
    pub power: Option<f32>,
    /// Adaptive steps of this tolerance, in place of a grid.
    pub tolerance: Option<f32>,
    /// Flow time of the last denoising; 1 for none.
    pub denoise: Option<f32>,
    /// Share of points that are drawn beyond those asked for.
    pub spare: Option<f32>,
}

impl SamplerPlan {
    /// Most adaptive steps, where they are not said.
    pub const MOST_STEPS: usize = 200;

    /// The sampler for a model trained with `settings`.
    ///
    /// # Errors
    /// [`TrainRunError::Sampler`] for values that describe none, [`TrainRunError::OwnSampler`] where the model was distilled
    /// for another.
    pub fn settle(&self, settings: &TrainSettings) -> Result<Sampler, PipelineError> {
        let own = settings.sampler;
        let sampler = Sampler {
            method: self.method.unwrap_or(own.method),
            steps: match self.tolerance {
                None => self.steps.unwrap_or(own.steps),
                Some(_) => self.steps.unwrap_or(Self::MOST_STEPS),
            },
            grid: match (self.tolerance, self.power) {
                (Some(tolerance), _) => TimeGrid::Adaptive(tolerance),
                (None, Some(power)) => TimeGrid::Power(power),
                (None, None) => own.grid,
            },
            denoise: match self.denoise {
                None => own.denoise,
                Some(1.0) => None,
                denoise => denoise,
            },
            spare: self.spare.unwrap_or(own.spare),
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
                evaluations: own.evaluations(),
            }
            .into()),
        }
    }
}
