//! Networks whose products are of bfloat16 numbers, beside the same networks in floats.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_learn::flow::VelocityField;
use tdcr_learn::net::{
    Batch, Channels, MlpShape, Network, NetworkShape, NetworkShapeError, Precision, TimeFeatures,
    Workspace,
};
use tdcr_learn::train::{TrainError, TrainSettings, Trainer};

use crate::toy;

/// Relative error of bfloat16: half a unit in the last of 8 digits. What many products and a handful of layers make of it
/// was 0.2 % in the gradients.
const TOLERANCE: f64 = 0.005;

const SHAPE: MlpShape = MlpShape {
    width: 96,
    depth: 4,
    embedding: 24,
    condition_dim: 3,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

/// The paper's weight of the colours' error.
const COLOR_WEIGHT: f32 = 0.05;

fn uniform(rng: &mut ChaCha8Rng, len: usize) -> Vec<f32> {
    (0..len).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// A network with no parameter at a special value.
fn network(shape: impl Into<NetworkShape>, precision: Precision) -> Network {
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    let mut network = Network::new(shape, rng).unwrap();
    let params = network.params_mut();
    params
        .iter_mut()
        .for_each(|p| *p += rng.random_range(-0.05..0.05));
    network.with_precision(precision).unwrap()
}

/// Loss and gradient of two clouds of `points` points.
fn gradient(network: &Network, points: usize) -> (f64, Vec<f32>) {
    let rng = &mut ChaCha8Rng::seed_from_u64(2);
    let len = 2 * points * network.shape().channels().count();
    let conditions = uniform(rng, 2 * network.shape().condition_dim());
    let (points, targets) = (uniform(rng, len), uniform(rng, len));
    let batch = Batch {
        times: &[0.2, 0.7],
        conditions: &conditions,
        points: &points,
        targets: &targets,
        color_weight: COLOR_WEIGHT,
        huber: None,
    };
    let mut gradient = vec![0.0; network.params().len()];
    let loss = network.loss_and_gradient(&batch, &mut Workspace::default(), &mut gradient);
    (loss, gradient)
}

/// Distance of `found` from `exact`, in parts of its size.
fn relative(found: &[f32], exact: &[f32]) -> f64 {
    let square = |x: f64| x * x;
    let (mut error, mut size) = (0.0, 0.0);
    for (found, exact) in found.iter().zip(exact) {
        error += square(f64::from(found - exact));
        size += square(f64::from(*exact));
    }
    assert!(size > 0.0, "a comparison with nothing");
    (error / size).sqrt()
}

#[test]
fn gradients_are_those_in_floats_to_the_rounding_of_operands() {
    let colored = MlpShape {
        channels: Channels::XyzRgb,
        width: 32,
        ..SHAPE
    };
    let one_layer = MlpShape { depth: 1, ..SHAPE };
    // Points that fill no tile of the kernels, and more than one of the largest.
    for (shape, points) in [
        (SHAPE, 700),
        (SHAPE, 33),
        (SHAPE, 1),
        (colored, 50),
        (one_layer, 40),
    ] {
        let (loss, exact) = gradient(&network(shape, Precision::Float32), points);
        let (rounded, found) = gradient(&network(shape, Precision::Bfloat16), points);
        assert!(
            (rounded / loss - 1.0).abs() < TOLERANCE,
            "{rounded} for {loss}"
        );
        for tensor in shape.tensors() {
            let error = relative(&found[tensor.range.clone()], &exact[tensor.range]);
            assert!(
                error < TOLERANCE,
                "{} of {points} points: {error}",
                tensor.name
            );
        }
        assert!(found != exact, "nothing was rounded");
    }
}

#[test]
fn velocities_are_those_in_floats_to_the_rounding_of_operands() {
    let points = uniform(&mut ChaCha8Rng::seed_from_u64(3), 1200 * 3);
    let velocities = |precision| {
        let mut velocities = vec![0.0; points.len()];
        let condition = [0.1, 0.5, 0.9];
        network(SHAPE, precision).velocity(0.4, &condition, &points, &mut velocities);
        velocities
    };
    let error = relative(
        &velocities(Precision::Bfloat16),
        &velocities(Precision::Float32),
    );
    assert!(error < TOLERANCE, "{error}");
    assert!(error > 1e-6, "{error}: nothing was rounded");
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let network = network(SHAPE, Precision::Bfloat16);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| gradient(&network, 1300))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn training_learns_along_the_curve_of_floats() {
    let set = toy::bars(12, 1);
    let shape = MlpShape {
        width: 32,
        ..toy::SHAPE
    };
    let losses = |precision| {
        let settings = TrainSettings {
            steps: 80,
            clouds: 8,
            precision,
            ..toy::settings()
        };
        let mut trainer = Trainer::new(shape, settings, &set, &set).unwrap();
        while !trainer.is_finished() {
            trainer.step().unwrap();
        }
        trainer.losses().to_vec()
    };
    let (rounded, exact) = (losses(Precision::Bfloat16), losses(Precision::Float32));
    let mean = |losses: &[f32]| losses.iter().sum::<f32>() / losses.len() as f32;
    assert!(
        mean(&exact[70..]) < 0.7 * mean(&exact[..10]),
        "nothing was learned"
    );
    for (step, (rounded, exact)) in rounded.iter().zip(&exact).enumerate() {
        assert!(
            (rounded / exact - 1.0).abs() < 0.03,
            "step {step}: {rounded} for {exact}"
        );
    }
}

#[test]
fn a_width_that_does_not_suit_is_refused_by_its_number() {
    let narrow = MlpShape { width: 40, ..SHAPE };
    let plain = network(narrow, Precision::Float32);
    let error = plain.with_precision(Precision::Bfloat16).unwrap_err();
    assert_eq!(error, NetworkShapeError::Precision { width: 40 });
    assert!(error.to_string().contains("width is 40"), "{error}");

    let set = toy::bars(4, 1);
    let settings = TrainSettings {
        precision: Precision::Bfloat16,
        ..toy::settings()
    };
    let error = Trainer::new(toy::SHAPE, settings, &set, &set).unwrap_err();
    assert!(
        matches!(
            error,
            TrainError::Shape(NetworkShapeError::Precision { width: 16 })
        ),
        "{error}"
    );
    assert_eq!(Precision::fastest(40), Precision::Float32);
}
