//! What a cloud tells of the unknowns, in as few numbers as there are.
//!
//! A point at distance `d` from the nearest place of the surface, outward normal `n`, measures that place's motion along `n`:
//! `d = n' (dp/dx) dx + noise` (point to plane: Chen and Medioni, Image and Vision Computing 10, 1992). Points count less the further
//! away they are, as those do that fly at edges or are of something else (Cauchy's weights; Huber and Ronchetti, Robust Statistics,
//! ch. 7). The `m` weighted rows are reduced to their normal equations, and these to independent numbers of unit variance along
//! their principal directions, which tell the same of the unknowns.

use nalgebra::{DMatrix, DVector, SymmetricEigen, Vector3};
use tdcr_sim::inverse::recording::{Shown, Surface};

use crate::belief::{BeliefError, Linear};

/// Points whose errors are one and the same in the mean: depth cameras err alike on neighbouring pixels, and at edges.
const ALIKE: f64 = 20.0;
/// Deviations from the surface at which a point counts half.
const HALF: f64 = 4.0;
/// Part of an unknown's prior that is less than this counts as nothing told.
const NOTHING: f64 = 1e-6;

/// Numbers with normal noise of unit variance, and their derivatives by the unknowns.
pub(super) struct Reduced {
    pub off: Vec<f64>,
    pub slopes: DMatrix<f64>,
}

/// What `points` (m, world frame) tell beside a model that rests at `linear`, each of them by this standard deviation (m) from the
/// surface. `spans` are what each unknown is thought to vary by, in its unit.
pub(super) fn reduce(
    linear: &Linear,
    robot: &tdcr_sim::robot::Robot,
    shown: &Shown,
    points: &[Vector3<f64>],
    deviation: f64,
    spans: &DVector<f64>,
) -> Result<Reduced, BeliefError> {
    let settled = &linear.equilibrium;
    let touches = Surface::new(robot, shown, settled).touches(robot, settled, points);
    let mut slopes = linear.approaches(&touches)?;
    // Rows in units of their noise, unknowns in units of what they vary by.
    let mut off = DVector::zeros(touches.len());
    for (row, touch) in touches.iter().enumerate() {
        let far = touch.distance / (HALF * deviation);
        let weight = 1.0 / (deviation * (ALIKE * (1.0 + far * far)).sqrt());
        off[row] = weight * touch.distance;
        slopes.row_mut(row).scale_mut(weight);
    }
    for (mut column, span) in slopes.column_iter_mut().zip(spans) {
        column.scale_mut(*span);
    }
    let normal = SymmetricEigen::new(slopes.tr_mul(&slopes));
    let right = slopes.tr_mul(&off);
    let told = (0..spans.len()).filter(|&k| normal.eigenvalues[k] > NOTHING);
    let told: Vec<usize> = told.collect();
    let mut reduced = Reduced {
        off: Vec::with_capacity(told.len()),
        slopes: DMatrix::zeros(told.len(), spans.len()),
    };
    for (row, &k) in told.iter().enumerate() {
        let (scale, way) = (normal.eigenvalues[k].sqrt(), normal.eigenvectors.column(k));
        reduced.off.push(way.dot(&right) / scale);
        let slope = way.component_div(spans) * scale;
        reduced.slopes.set_row(row, &slope.transpose());
    }
    Ok(reduced)
}
