//! Settings of a distillation.

use tdcr_learn::flow::{Method, Sampler, TimeGrid};
use tdcr_learn::train::{Model, Optimizer, Target, TrainSettings};

/// Flow time of a student's own denoising: its steps come as near to the surface as points do about then.
const STUDENT_DENOISE: f32 = 0.99;

/// Clouds of a batch, at least.
const CLOUDS: usize = 64;

/// Settings of the distillation of `teacher` to predictions by `evaluations` of a network: lower rates than those that it was
/// trained at, as the student starts where it ended.
///
/// A student's steps are Euler's, on a grid of exponent `power`. Where the teacher's last denoising has a network of its own, this and
/// its correction are the last two of three evaluations and more; else the last one of several is a denoising that the student learns.
pub fn distillation(teacher: &Model, evaluations: usize, power: f32, steps: u64) -> TrainSettings {
    let refined = (teacher.settings.sampler.denoise).filter(|_| teacher.refinement.is_some());
    let (own_steps, denoise, learned) = match (evaluations, refined) {
        (..=1, _) => (evaluations, None, evaluations),
        (3.., Some(_)) => (evaluations - 2, refined, evaluations - 2),
        _ => (evaluations - 1, Some(STUDENT_DENOISE), evaluations),
    };
    let teacher = &teacher.settings;
    TrainSettings {
        steps,
        clouds: learned * CLOUDS.div_ceil(learned.max(1)),
        optimizer: Optimizer::Muon {
            learning_rate: 5e-3,
        },
        learning_rate: 5e-3,
        warmup_steps: (steps / 10).min(100),
        path: teacher.path,
        symmetry: teacher.symmetry,
        color_weight: teacher.color_weight,
        sampler: Sampler {
            method: Method::Euler,
            steps: own_steps,
            grid: TimeGrid::Power(power),
            denoise,
            ..Sampler::DEFAULT
        },
        target: Target::Steps,
        validate_every: 500,
        ..TrainSettings::default()
    }
}
