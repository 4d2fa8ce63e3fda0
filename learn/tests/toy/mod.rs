//! A toy run: clouds of a bar that the command moves, and a network that learns them in a second.

#![allow(dead_code, reason = "each test file uses its part")]

use rand::RngExt;
use tdcr_learn::data::{CloudSet, Normalisation, Subject};
use tdcr_learn::flow::{FlowPath, Method, Sampler, Stream, TimeGrid, rng};
use tdcr_learn::net::{Channels, MlpShape, TimeFeatures};
use tdcr_learn::symmetry::Reduction;
use tdcr_learn::train::{Provenance, TrainSettings, Trainer};

pub const SHAPE: MlpShape = MlpShape {
    width: 16,
    depth: 2,
    embedding: 8,
    condition_dim: 2,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

/// A shape that learns more.
pub const LARGER: MlpShape = MlpShape {
    width: 32,
    depth: 3,
    embedding: 16,
    ..SHAPE
};

/// [`SHAPE`] for points with colours.
pub const COLORED: MlpShape = MlpShape {
    channels: Channels::XyzRgb,
    ..SHAPE
};

pub fn settings() -> TrainSettings {
    TrainSettings {
        steps: 12,
        clouds: 3,
        points: 20,
        warmup_steps: 2,
        validate_every: 3,
        validation_clouds: 2,
        validation_points: 20,
        sampler: Sampler {
            method: Method::Heun,
            steps: 3,
            grid: TimeGrid::Power(2.0),
            ..Sampler::PAPER
        },
        path: FlowPath::PAPER,
        ..TrainSettings::default()
    }
}

/// [`settings`] of a run that learns something.
pub fn learning(steps: u64) -> TrainSettings {
    TrainSettings {
        steps,
        clouds: 8,
        learning_rate: 5e-3,
        warmup_steps: 20,
        validate_every: 100,
        validation_clouds: 8,
        ..settings()
    }
}

/// Mean of the first twenty losses of a run, and of the last twenty.
pub fn first_and_last(losses: &[f32]) -> (f32, f32) {
    let mean = |losses: &[f32]| losses.iter().sum::<f32>() / 20.0;
    (mean(&losses[..20]), mean(&losses[losses.len() - 20..]))
}

/// Clouds of a short bar whose centre the condition moves.
pub fn bars(clouds: usize, seed: u64) -> CloudSet {
    let rng = &mut rng(seed, Stream::Sample(0));
    let conditions: Vec<f32> = (0..2 * clouds)
        .map(|_| rng.random_range(0.0..1.0))
        .collect();
    let points = conditions.as_chunks::<2>().0.iter().flat_map(|c| {
        let at = |k: usize| [c[0] - 0.5, c[1] - 0.5, 0.01 * k as f32];
        (0..40).flat_map(at).collect::<Vec<f32>>()
    });
    CloudSet {
        condition_dim: 2,
        points_per_cloud: 40,
        points: points.collect(),
        conditions,
        colors: None,
        starts: None,
    }
}

/// [`bars`] whose colour, one for the whole bar, the condition says: red and green.
pub fn colored_bars(clouds: usize, seed: u64) -> CloudSet {
    let set = bars(clouds, seed);
    let byte = |c: f32| (255.0 * c).round() as u8;
    let colors = set.conditions.as_chunks::<2>().0.iter();
    let colors = colors.flat_map(|c| [byte(c[0]), byte(c[1]), 128].repeat(40));
    CloudSet {
        colors: Some(colors.collect()),
        ..set
    }
}

/// Chamfer distance by brute force.
fn chamfer(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let square = |p: &[f32; 3], q: &[f32; 3]| -> f64 {
        (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum()
    };
    let one_way = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        let nearest = a
            .iter()
            .map(|p| b.iter().map(|q| square(p, q)).fold(f64::INFINITY, f64::min));
        nearest.sum::<f64>() / a.len() as f64
    };
    one_way(a, b) + one_way(b, a)
}

pub fn provenance() -> Provenance {
    Provenance {
        subject: Some(Subject::default()),
        normalisation: Normalisation {
            motor_min: vec![0.0, 0.01],
            motor_max: vec![0.04, 0.03],
            scale: 0.4,
        },
        reduction: Reduction::default(),
    }
}

/// A run, its validations taken, after `steps` steps.
pub fn run<'a>(mut trainer: Trainer<'a>, steps: u64) -> Trainer<'a> {
    while trainer.steps_taken() < steps {
        trainer.step().unwrap();
        if trainer.validation_is_due() {
            trainer.validate(&chamfer).unwrap();
        }
    }
    trainer
}
