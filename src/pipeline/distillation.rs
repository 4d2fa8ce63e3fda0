//! Sampler and settings of a distillation.

use tdcr_learn::flow::{Method, Sampler, TimeGrid};
use tdcr_learn::train::{Optimizer, Target, TrainSettings};

/// Flow time of a student's last denoising: its steps come as near to the surface as points do about then.
const STUDENT_DENOISE: f32 = 0.99;

/// The sampler of a student that predicts by `evaluations` of its network: Euler's steps on a grid of exponent `power`, and where
/// there are several evaluations, the last one is a denoising.
pub fn student_sampler(evaluations: usize, power: f32) -> Sampler {
    let several = evaluations > 1;
    Sampler {
        method: Method::Euler,
        steps: evaluations - usize::from(several),
        grid: TimeGrid::Power(power),
        denoise: several.then_some(STUDENT_DENOISE),
        ..Sampler::DEFAULT
    }
}

/// Settings of the distillation of a network trained with `teacher`, to the steps of `sampler`: lower rates than those that
/// the teacher was trained at, as the student starts where it ended.
pub fn distillation(teacher: &TrainSettings, sampler: Sampler, steps: u64) -> TrainSettings {
    TrainSettings {
        steps,
        clouds: sampler.evaluations() * 64usize.div_ceil(sampler.evaluations()),
        optimizer: Optimizer::Muon {
            learning_rate: 5e-3,
        },
        learning_rate: 5e-3,
        warmup_steps: (steps / 10).min(100),
        path: teacher.path,
        symmetry: teacher.symmetry,
        color_weight: teacher.color_weight,
        sampler,
        target: Target::Steps,
        validate_every: 500,
        ..TrainSettings::default()
    }
}
