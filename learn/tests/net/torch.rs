//! Both networks against PyTorch: velocities, loss and gradients of the modules of `tdcr.torch`.

use serde_json::from_value;
use tdcr_learn::flow::VelocityField;
use tdcr_learn::net::{Batch, Network, NetworkShape, Workspace};

use crate::fixture::Fixture;

/// Relative tolerance, in the Euclidean norm of a tensor.
const TOLERANCE: f64 = 1e-5;

/// The paper's weight of the colours' error.
const COLOR_WEIGHT: f32 = 0.05;

/// `|found - expected| / |expected|`.
fn error(found: &[f32], expected: &[f32]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let pairs = found.iter().zip(expected);
    norm(&mut pairs.map(|(f, e)| f64::from(*f) - f64::from(*e)))
        / norm(&mut expected.iter().map(|e| f64::from(*e)))
}

fn assert_torchs(name: &str) {
    let fixture = Fixture::read("networks_torch");
    let tensor = |kind: &str| fixture.tensor(&format!("{name}.{kind}"));
    let shape: NetworkShape = from_value(fixture.json("shapes")[name].clone()).unwrap();
    let mut params = Vec::new();
    for spec in shape.tensors() {
        params.extend(tensor(&format!("weight.{}", spec.name)));
        assert_eq!(params.len(), spec.range.end, "{}", spec.name);
    }
    let network = Network::from_params(shape, params).unwrap();

    let (times, conditions) = (tensor("batch.times"), tensor("batch.conditions"));
    let (points, targets) = (tensor("batch.points"), tensor("batch.targets"));
    let expected = tensor("velocities");
    let stride = points.len() / times.len();
    let clouds = points.chunks(stride).zip(expected.chunks(stride));
    for ((time, condition), (points, expected)) in
        times.iter().zip(conditions.chunks(2)).zip(clouds)
    {
        let mut velocities = vec![f32::NAN; points.len()];
        network.velocity(*time, condition, points, &mut velocities);
        let error = error(&velocities, expected);
        assert!(error < TOLERANCE, "velocities at {time}: {error}");
    }

    let batch = Batch {
        times: &times,
        conditions: &conditions,
        points: &points,
        targets: &targets,
        color_weight: COLOR_WEIGHT,
        huber: None,
    };
    let mut gradient = vec![f32::NAN; network.params().len()];
    let loss = network.loss_and_gradient(&batch, &mut Workspace::default(), &mut gradient);
    let expected = f64::from(tensor("loss")[0]);
    assert!(
        (loss / expected - 1.0).abs() < TOLERANCE,
        "loss {loss} for {expected}"
    );
    for spec in shape.tensors() {
        let expected = tensor(&format!("gradient.{}", spec.name));
        let error = error(&gradient[spec.range], &expected);
        assert!(error < TOLERANCE, "gradient by {}: {error}", spec.name);
    }
}

#[test]
fn the_mlp_is_torchs() {
    assert_torchs("mlp");
}

#[test]
fn the_hybrid_is_torchs() {
    assert_torchs("hybrid");
}
