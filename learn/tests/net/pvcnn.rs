//! The authors' Hybrid against a module in plain PyTorch that is written from its description (`data/paper_hybrid.py`).

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::{from_value, json, to_value};
use tdcr_learn::flow::VelocityField;
use tdcr_learn::net::{
    Channels, ContextLayers, ContextShape, HybridShape, InitialWeights, MlpShape, Network,
    NetworkShape, Precision, TensorRole, TimeFeatures,
};
use tdcr_learn::train::{TrainError, Trainer};

use crate::fixture::Fixture;
use crate::toy;

/// Largest difference of a velocity, relative to the largest velocity.
const TOLERANCE: f32 = 1e-5;

/// The published sizes, for a robot with 6 motors.
fn paper() -> HybridShape {
    HybridShape {
        head: MlpShape {
            width: 512,
            depth: 6,
            embedding: 256,
            condition_dim: 6,
            condition_blocks: 0,
            octaves: 0,
            time_features: TimeFeatures::Plain,
            channels: Channels::Xyz,
        },
        context: ContextShape::of(ContextLayers::Pvcnn),
    }
}

fn stored(fixture: &Fixture) -> (NetworkShape, Vec<f32>) {
    let shape: NetworkShape = from_value(fixture.json("shape")).unwrap();
    let mut params = Vec::new();
    for spec in shape.tensors() {
        params.extend(fixture.tensor(&format!("weight.{}", spec.name)));
        assert_eq!(params.len(), spec.range.end, "{}", spec.name);
    }
    (shape, params)
}

/// The stored clouds' velocities, one cloud after the other.
fn velocities(network: &Network, fixture: &Fixture) -> Vec<f32> {
    let [times, conditions, points] =
        ["times", "conditions", "points"].map(|name| fixture.tensor(&format!("batch.{name}")));
    let mut found = vec![f32::NAN; points.len()];
    let (stride, dimension) = (points.len() / times.len(), conditions.len() / times.len());
    let clouds = points.chunks(stride).zip(found.chunks_mut(stride));
    let clouds = clouds.zip(times).zip(conditions.chunks(dimension));
    for (((points, found), time), condition) in clouds {
        network.velocity(time, condition, points, found);
    }
    found
}

/// Largest difference, relative to the largest expected value.
fn error(found: &[f32], expected: &[f32]) -> f32 {
    let largest = expected.iter().fold(0.0, |most: f32, v| most.max(v.abs()));
    let differences = found.iter().zip(expected).map(|(f, e)| (f - e).abs());
    differences.fold(0.0, f32::max) / largest
}

#[test]
fn velocities_are_those_of_the_reference_on_any_number_of_threads() {
    let fixture = Fixture::read("paper_hybrid");
    let (shape, params) = stored(&fixture);
    let network = Network::from_params(shape, params).unwrap();
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| velocities(&network, &fixture))
    };
    let found = on(1);
    assert_eq!(found, on(3));
    let error = error(&found, &fixture.tensor("velocities"));
    assert!(error < TOLERANCE, "{error}");
}

#[test]
fn every_tensor_tells_in_the_velocities() {
    let fixture = Fixture::read("paper_hybrid");
    let (shape, params) = stored(&fixture);
    let expected = fixture.tensor("velocities");
    for spec in shape.tensors() {
        let mut changed = params.clone();
        for value in &mut changed[spec.range.clone()] {
            *value *= 1.5;
        }
        let network = Network::from_params(shape, changed).unwrap();
        let error = error(&velocities(&network, &fixture), &expected);
        assert!(error > 10.0 * TOLERANCE, "{}: {error}", spec.name);
    }
}

#[test]
fn points_in_another_order_have_the_same_velocities() {
    let fixture = Fixture::read("paper_hybrid");
    let (shape, params) = stored(&fixture);
    let network = Network::from_params(shape, params).unwrap();
    let points = fixture.tensor("batch.points");
    let velocity = |points: &[f32]| {
        let mut found = vec![0.0; points.len()];
        network.velocity(0.8, &[0.1, 0.7], points, &mut found);
        found
    };
    let mut turned = points.clone();
    turned.rotate_left(6 * 17);
    let mut expected = velocity(&points);
    expected.rotate_left(6 * 17);
    assert!(error(&velocity(&turned), &expected) < TOLERANCE);
}

#[test]
fn the_published_sizes_have_the_published_number_of_parameters() {
    let shape = NetworkShape::from(paper());
    assert_eq!(shape.learned_parameters(), 6_939_315);
    let tensors = shape.tensors().into_iter();
    let statistics = tensors.filter(|tensor| tensor.role == TensorRole::Statistic);
    assert!(
        statistics
            .clone()
            .all(|tensor| tensor.name.contains("_norm"))
    );
    // Mean and variance of the channels of 3 projections, and of 4 norms in each of two blocks a stage.
    let expected = 2 * (80 + 2 * 112) * (1 + 4 * 2);
    assert_eq!(
        statistics.map(|tensor| tensor.range.len()).sum::<usize>(),
        expected
    );
}

#[test]
fn the_head_rounds_to_bfloat16_and_the_context_does_not() {
    let shape = HybridShape {
        head: MlpShape {
            width: 32,
            depth: 2,
            embedding: 8,
            condition_dim: 3,
            condition_blocks: 0,
            octaves: 0,
            time_features: TimeFeatures::Plain,
            channels: Channels::Xyz,
        },
        context: ContextShape {
            stages: paper().context.stages.map(|mut stage| {
                (stage.channels, stage.resolution) = (8, 4);
                stage
            }),
            ..paper().context
        },
    };
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    let network = Network::starting(shape, InitialWeights::Authors, rng).unwrap();
    let points: Vec<f32> = (0..900).map(|k| (k as f32).sin()).collect();
    let [exact, rounded] = Precision::ALL.map(|precision| {
        let network = network.clone().with_precision(precision).unwrap();
        let mut found = vec![0.0; points.len()];
        network.velocity(0.9, &[0.1, 0.5, 0.9], &points, &mut found);
        found
    });
    let error = error(&rounded, &exact);
    assert!((1e-6..2e-2).contains(&error), "{error}");
}

#[test]
fn the_authors_network_has_no_blocks_of_the_condition() {
    let mut shape = paper();
    shape.head.condition_blocks = 1;
    let refused = shape.check().unwrap_err().to_string();
    assert!(
        refused.contains("condition_blocks is 1, expected 0 with pvcnn layers"),
        "{refused}"
    );
    shape.context.layers = ContextLayers::Residual;
    assert_eq!(shape.check(), Ok(()));
}

#[test]
fn files_that_do_not_say_have_residual_layers() {
    let shape = NetworkShape::from(paper());
    let mut value = to_value(shape).unwrap();
    assert_eq!(value["context"]["layers"], json!("pvcnn"));
    assert_eq!(from_value::<NetworkShape>(value.clone()).unwrap(), shape);
    value["context"].as_object_mut().unwrap().remove("layers");
    let NetworkShape::Hybrid(old) = from_value(value.clone()).unwrap() else {
        panic!("a hybrid")
    };
    assert_eq!(old.context.layers, ContextLayers::Residual);
    assert_eq!(to_value(NetworkShape::from(old)).unwrap(), value);
}

#[test]
fn negative_variances_and_training_are_refused() {
    let fixture = Fixture::read("paper_hybrid");
    let (shape, mut params) = stored(&fixture);
    let set = toy::bars(2, 1);
    let network = Network::from_params(shape, params.clone()).unwrap();
    assert!(!shape.has_gradient());
    let refused = Trainer::new(&network, toy::settings(), &set, &set).unwrap_err();
    assert_eq!(refused, TrainError::BatchNorm);
    assert!(refused.to_string().contains("expected layers `residual`"));

    let tensors = shape.tensors();
    let variance = tensors
        .iter()
        .find(|tensor| tensor.name.ends_with("running_var"));
    params[variance.unwrap().range.start + 3] = -0.25;
    let said = Network::from_params(shape, params).unwrap_err().to_string();
    let expected = "`context.stages.0.project_norm.running_var` holds the variance -0.25, expected none below 0";
    assert_eq!(said, expected);
}
