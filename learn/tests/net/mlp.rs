//! The velocity network against a plain f64 version of the paper's equations.

use proptest::prelude::*;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_learn::flow::VelocityField;
use tdcr_learn::net::{
    Batch, Channels, InitialWeights, MlpShape, Network, NetworkShapeError, TimeFeatures, Workspace,
};

use crate::reference::{Cloud, Reference, loss_gradient};

/// The paper's weight of the colours' error.
const COLOR_WEIGHT: f32 = 0.05;

/// A width that no vector unit divides.
const SHAPE: MlpShape = MlpShape {
    width: 19,
    depth: 3,
    embedding: 8,
    condition_dim: 3,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

fn uniform(rng: &mut impl Rng, len: usize) -> Vec<f32> {
    (0..len).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn to_f64(values: &[f32]) -> Vec<f64> {
    values.iter().copied().map(f64::from).collect()
}

/// A network with no parameter at a special value.
fn network(shape: MlpShape) -> Network {
    let params = uniform(&mut rng(1), shape.parameter_count());
    Network::from_params(shape, params.iter().map(|p| 0.5 * p).collect()).unwrap()
}

/// Random `times`, `conditions`, `points` and `targets`.
struct Samples {
    times: Vec<f32>,
    conditions: Vec<f32>,
    points: Vec<f32>,
    targets: Vec<f32>,
}

impl Samples {
    fn new(shape: MlpShape, clouds: usize, points: usize) -> Self {
        let MlpShape {
            condition_dim,
            channels,
            ..
        } = shape;
        let rng = &mut rng(2);
        Self {
            times: (0..clouds).map(|_| rng.random_range(0.0..1.0)).collect(),
            conditions: uniform(rng, clouds * condition_dim),
            points: uniform(rng, clouds * points * channels.count()),
            targets: uniform(rng, clouds * points * channels.count()),
        }
    }

    fn batch(&self) -> Batch<'_> {
        Batch {
            times: &self.times,
            conditions: &self.conditions,
            points: &self.points,
            targets: &self.targets,
            color_weight: COLOR_WEIGHT,
            huber: None,
        }
    }

    fn clouds(&self, channels: Channels) -> Vec<Cloud> {
        let clouds = self.times.len();
        let rows = |values: &[f32], cloud: usize| {
            let cloud = values.chunks(values.len() / clouds).nth(cloud).unwrap();
            cloud.chunks(channels.count()).map(to_f64).collect()
        };
        let condition_dim = self.conditions.len() / clouds;
        (0..clouds)
            .map(|cloud| Cloud {
                time: self.times[cloud].into(),
                condition: to_f64(&self.conditions[cloud * condition_dim..][..condition_dim]),
                points: rows(&self.points, cloud),
                targets: rows(&self.targets, cloud),
            })
            .collect()
    }
}

fn loss_and_gradient(network: &Network, batch: &Batch) -> (f64, Vec<f32>) {
    let mut gradient = vec![f32::NAN; network.params().len()];
    let loss = network.loss_and_gradient(batch, &mut Workspace::default(), &mut gradient);
    (loss, gradient)
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|v| v * v).sum::<f64>().sqrt()
}

#[test]
fn velocity_is_the_equations() {
    let network = network(SHAPE);
    let reference = Reference::new(SHAPE, &to_f64(network.params()));
    let points = uniform(&mut rng(3), 300 * 3);
    let condition = [0.1, 0.7, 0.4];
    let mut velocities = vec![0.0; points.len()];
    network.velocity(0.3, &condition, &points, &mut velocities);
    for (point, velocity) in points.chunks(3).zip(velocities.chunks(3)) {
        let exact = reference.velocity(0.3f32.into(), &to_f64(&condition), &to_f64(point));
        for (v, exact) in velocity.iter().zip(exact) {
            assert!((f64::from(*v) - exact).abs() < 1e-5, "{v} for {exact}");
        }
    }
}

/// Compares a network's loss and gradient with the reference's, tensor by tensor.
fn assert_gradient_is_the_finite_difference(shape: MlpShape) {
    let network = network(shape);
    let samples = Samples::new(shape, 2, 5);
    let (loss, gradient) = loss_and_gradient(&network, &samples.batch());
    let (params, clouds) = (to_f64(network.params()), samples.clouds(shape.channels));
    assert!((loss - Reference::new(shape, &params).loss(&clouds)).abs() < 1e-6 * loss);
    let exact = loss_gradient(shape, &params, &clouds);
    for tensor in shape.tensors() {
        let pairs = gradient[tensor.range.clone()]
            .iter()
            .zip(&exact[tensor.range.clone()]);
        let error = norm(pairs.map(|(g, exact)| f64::from(*g) - exact));
        let size = norm(exact[tensor.range.clone()].iter().copied());
        assert!(
            error < 1e-4 * size,
            "{}: error {error} of {size}",
            tensor.name
        );
    }
}

#[test]
fn every_tensors_gradient_is_the_finite_difference() {
    assert_gradient_is_the_finite_difference(SHAPE);
}

#[test]
fn fourier_features_have_gradients_too() {
    assert_gradient_is_the_finite_difference(MlpShape {
        condition_blocks: 0,
        octaves: 3,
        time_features: TimeFeatures::Late,
        channels: Channels::XyzRgb,
        ..SHAPE
    });
}

#[test]
fn blocks_of_the_condition_have_gradients_too() {
    assert_gradient_is_the_finite_difference(MlpShape {
        condition_blocks: 2,
        ..SHAPE
    });
}

#[test]
fn colours_have_velocities_and_a_weight_of_their_own() {
    assert_gradient_is_the_finite_difference(MlpShape {
        channels: Channels::XyzRgb,
        ..SHAPE
    });
}

#[test]
fn gradient_of_many_tiles_and_shares_is_the_finite_difference() {
    let shape = MlpShape {
        width: 16,
        depth: 2,
        embedding: 4,
        condition_dim: 2,
        condition_blocks: 0,
        octaves: 0,
        time_features: TimeFeatures::Plain,
        channels: Channels::Xyz,
    };
    let network = network(shape);
    let samples = Samples::new(shape, 2, 1100);
    let (loss, gradient) = loss_and_gradient(&network, &samples.batch());
    let (params, clouds) = (to_f64(network.params()), samples.clouds(shape.channels));
    let moved = |step: f64| {
        let params: Vec<f64> = params
            .iter()
            .zip(&gradient)
            .map(|(p, g)| p + step * f64::from(*g))
            .collect();
        Reference::new(shape, &params).loss(&clouds)
    };
    assert!((loss - moved(0.0)).abs() < 1e-6 * loss);
    let slope = (moved(1e-4) - moved(-1e-4)) / 2e-4;
    let exact: f64 = gradient.iter().map(|g| f64::from(*g).powi(2)).sum();
    assert!((slope - exact).abs() < 1e-4 * exact, "{slope} for {exact}");
}

#[test]
fn a_network_of_depth_one_has_a_gradient_too() {
    let shape = MlpShape { depth: 1, ..SHAPE };
    let network = network(shape);
    let samples = Samples::new(shape, 1, 4);
    let (_, gradient) = loss_and_gradient(&network, &samples.batch());
    let exact = loss_gradient(
        shape,
        &to_f64(network.params()),
        &samples.clouds(shape.channels),
    );
    let error = norm(
        gradient
            .iter()
            .zip(&exact)
            .map(|(g, exact)| f64::from(*g) - exact),
    );
    assert!(error < 1e-4 * norm(exact.into_iter()));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let shape = MlpShape { width: 32, ..SHAPE };
    let network = network(shape);
    let samples = Samples::new(shape, 3, 1500);
    let results = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut velocities = vec![0.0; samples.points.len()];
            network.velocity(0.5, &[0.2, 0.3, 0.4], &samples.points, &mut velocities);
            (loss_and_gradient(&network, &samples.batch()), velocities)
        })
    });
    assert_eq!(results[0], results[1]);
}

#[test]
fn a_workspace_can_be_used_again_with_another_batch() {
    let network = network(SHAPE);
    let (large, small) = (Samples::new(SHAPE, 3, 1100), Samples::new(SHAPE, 1, 7));
    let (mut workspace, mut gradient) = (Workspace::default(), vec![0.0; SHAPE.parameter_count()]);
    network.loss_and_gradient(&large.batch(), &mut workspace, &mut gradient);
    let loss = network.loss_and_gradient(&small.batch(), &mut workspace, &mut gradient);
    assert_eq!(
        (loss, gradient),
        loss_and_gradient(&network, &small.batch())
    );
}

#[test]
fn a_workspace_can_be_used_again_with_a_network_of_more_blocks() {
    let mut workspace = Workspace::default();
    for condition_blocks in [1, 3] {
        let shape = MlpShape {
            condition_blocks,
            ..SHAPE
        };
        let (network, samples) = (network(shape), Samples::new(shape, 2, 5));
        let mut gradient = vec![0.0; shape.parameter_count()];
        let loss = network.loss_and_gradient(&samples.batch(), &mut workspace, &mut gradient);
        let fresh = loss_and_gradient(&network, &samples.batch());
        assert_eq!((loss, gradient), fresh);
    }
}

#[test]
fn a_fresh_network_starts_as_documented() {
    let shape = MlpShape {
        width: 64,
        depth: 3,
        embedding: 32,
        condition_dim: 4,
        condition_blocks: 0,
        octaves: 0,
        time_features: TimeFeatures::Plain,
        channels: Channels::Xyz,
    };
    let network = Network::new(shape, &mut rng(0)).unwrap();
    for tensor in shape.tensors() {
        let values = &network.params()[tensor.range.clone()];
        let largest = values.iter().fold(0.0f32, |max, v| max.max(v.abs()));
        match tensor.name.as_str() {
            name if name.contains("film") || name.ends_with("norm.bias") => {
                assert_eq!(largest, 0.0)
            }
            name if name.ends_with("norm.weight") => assert!(values.iter().all(|v| *v == 1.0)),
            "input.weight" | "shift.weight" => {
                assert!(largest <= 35f32.sqrt().recip() && largest > 0.16)
            }
            name if name.ends_with("linear.weight") => assert!(largest <= 0.125 && largest > 0.12),
            _ => assert!(largest > 0.0 && largest <= 0.5),
        }
    }
}

#[test]
fn a_network_by_the_authors_starts_as_documented() {
    let shape = MlpShape {
        width: 128,
        depth: 3,
        embedding: 64,
        condition_dim: 6,
        condition_blocks: 0,
        octaves: 0,
        time_features: TimeFeatures::Plain,
        channels: Channels::Xyz,
    };
    let network = Network::starting(shape, InitialWeights::Authors, &mut rng(0)).unwrap();
    for tensor in shape.tensors() {
        let values = &network.params()[tensor.range.clone()];
        let largest = values.iter().fold(0.0f32, |max, v| max.max(v.abs()));
        let squares = values.iter().map(|v| f64::from(*v).powi(2));
        let deviation = (squares.sum::<f64>() / values.len() as f64).sqrt();
        // Normal: its deviation, to 4 standard errors of 1/sqrt(2 n) each, and a tail.
        let normal = |expected: f64| {
            let error = 4.0 / (2.0 * values.len() as f64).sqrt();
            assert!(
                (deviation / expected - 1.0).abs() < error,
                "{}: {deviation}",
                tensor.name
            );
            assert!(f64::from(largest) > 1.9 * expected);
        };
        match tensor.name.as_str() {
            "time.weight" | "condition.weight" => normal(0.02),
            "input.weight" | "shift.weight" => normal((2.0f64 / 67.0).sqrt()),
            name if name.ends_with("linear.weight") => normal((2.0f64 / 128.0).sqrt()),
            name if name.ends_with("film.weight") => assert!(largest <= 0.125 && largest > 0.12),
            name if name.ends_with("norm.weight") => assert!(values.iter().all(|v| *v == 1.0)),
            "output.weight" | "output.bias" => assert!(largest > 0.0 && largest <= 0.0884),
            _ => assert_eq!(largest, 0.0, "{}", tensor.name),
        }
    }
}

#[test]
fn tensors_tile_the_parameter_vector() {
    let mut end = 0;
    for tensor in SHAPE.tensors() {
        assert_eq!(tensor.range.start, end);
        assert_eq!(tensor.range.len(), tensor.shape.iter().product::<usize>());
        end = tensor.range.end;
    }
    assert_eq!(end, SHAPE.parameter_count());
}

#[test]
fn impossible_shapes_are_refused_by_name() {
    let error = |shape: MlpShape| shape.check().unwrap_err().to_string();
    assert_eq!(
        error(MlpShape { width: 0, ..SHAPE }),
        "network width is 0, expected 1 to 8192"
    );
    assert_eq!(
        error(MlpShape { depth: 0, ..SHAPE }),
        "network depth is 0, expected 1 to 64"
    );
    assert!(
        error(MlpShape {
            embedding: 7,
            ..SHAPE
        })
        .contains("embedding is 7")
    );
    assert!(
        error(MlpShape {
            condition_dim: 0,
            ..SHAPE
        })
        .contains("condition_dim is 0")
    );
    let wide = error(MlpShape {
        width: 8192,
        depth: 64,
        ..SHAPE
    });
    assert!(
        wide.ends_with("parameters, expected at most 134217728: choose smaller ones"),
        "{wide}"
    );
    let short = Network::from_params(SHAPE, vec![0.0; 3]).unwrap_err();
    assert_eq!(
        short,
        NetworkShapeError::ParameterCount {
            found: 3,
            expected: SHAPE.parameter_count()
        }
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// The paper's Sec. Method: permutation equivariance.
    #[test]
    fn permuted_points_have_permuted_velocities(count in 1usize..400, by in 0usize..400, time in 0f32..1.0) {
        let network = network(SHAPE);
        let points = uniform(&mut rng(4), count * 3);
        let velocities = |points: &[f32]| {
            let mut velocities = vec![0.0; points.len()];
            network.velocity(time, &[0.5, 0.1, 0.9], points, &mut velocities);
            velocities
        };
        let mut rotated = points.clone();
        rotated.rotate_left(by % count * 3);
        let mut expected = velocities(&points);
        expected.rotate_left(by % count * 3);
        for (v, expected) in velocities(&rotated).iter().zip(expected) {
            prop_assert!((v - expected).abs() < 1e-5);
        }
    }
}
