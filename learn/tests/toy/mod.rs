//! A toy run: clouds of a bar that the command moves, and a network that learns them in a second.

#![allow(dead_code, reason = "each test file uses its part")]

use rand::RngExt;
use tdcr_learn::data::{CloudSet, Normalisation, Subject};
use tdcr_learn::flow::{Method, Sampler, Stream, TimeGrid, rng};
use tdcr_learn::net::{Channels, MlpShape};
use tdcr_learn::train::{Provenance, TrainSettings, Trainer};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::RobotSpec;

pub const SHAPE: MlpShape = MlpShape {
    width: 16,
    depth: 2,
    embedding: 8,
    condition_dim: 2,
    channels: Channels::Xyz,
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
        },
        ..TrainSettings::default()
    }
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
        subject: RobotSpec::standard("2m").map(|robot| Subject {
            robot,
            base: BaseVisibility::Hidden,
            payload: None,
        }),
        normalisation: Normalisation {
            motor_min: vec![0.0, 0.01],
            motor_max: vec![0.04, 0.03],
            scale: 0.4,
        },
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
