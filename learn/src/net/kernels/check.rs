//! What the layers' tests share: comparisons with plain f64 functions and their central differences.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Relative tolerance of f32 against f64, in the Euclidean norm.
const TOLERANCE: f64 = 2e-6;

/// `len` numbers in [-1, 1) that f32 holds exactly.
pub fn numbers(seed: u64, len: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..len)
        .map(|_| f64::from(rng.random_range(-1.0f32..1.0)))
        .collect()
}

/// The numbers as f32.
pub fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|value| *value as f32).collect()
}

/// Compares a layer's result with the exact one.
pub fn assert_close(found: &[f32], exact: &[f64]) {
    assert_eq!(found.len(), exact.len());
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
    let mut errors = found.iter().zip(exact).map(|(f, e)| f64::from(*f) - e);
    let (error, size) = (square(&mut errors), square(&mut exact.iter().copied()));
    assert!(size > 0.0, "a comparison with nothing");
    let relative = (error / size).sqrt();
    assert!(relative < TOLERANCE, "relative error {relative}");
}

/// Compares a layer's gradient with central differences of `weights . function(x)`.
pub fn assert_is_gradient(
    found: &[f32],
    x: &[f64],
    weights: &[f64],
    function: impl Fn(&[f64]) -> Vec<f64>,
) {
    const STEP: f64 = 1e-6;
    let value = |index: usize, step: f64| -> f64 {
        let mut x = x.to_vec();
        x[index] += step;
        let y = function(&x);
        y.iter().zip(weights).map(|(y, w)| y * w).sum()
    };
    let slope = |index| (value(index, STEP) - value(index, -STEP)) / (2.0 * STEP);
    let exact: Vec<f64> = (0..x.len()).map(slope).collect();
    assert_close(found, &exact);
}
