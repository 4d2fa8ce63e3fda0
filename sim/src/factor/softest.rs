//! The smallest eigenvalue of the Hessian in O(n): Lanczos iteration with the inverse, whose largest eigenvalue it is the
//! reciprocal of (Golub and Van Loan, Matrix Computations, ch. 10.1 and 10.3).

use nalgebra::{DMatrix, SymmetricEigen, Vector3};

use super::{Curvature, Factor};
use crate::energy::Expansion;

/// Pivots below this share of the largest are too small to divide by: the Hessian is shifted first.
const SMALL: f64 = 1e-8;
/// Growth of the shift until the Hessian is positive definite.
const GROWTH: f64 = 10.0;
/// Residual of an eigenvector, as a share of its eigenvalue, at which the eigenvalue has converged: its own error is of the
/// second order in that.
const CONVERGED: f64 = 1e-9;
/// Part of a turn by which the entries of the first vector follow one another: they have no pattern that a mode could have.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The smallest eigenvalue of the Hessian of `expansion` (N m/rad); `None` for numbers that are not finite.
pub(crate) fn smallest_eigenvalue(expansion: &Expansion) -> Option<f64> {
    // Without springs and loads nothing resists a turn, and no shift has a size.
    if expansion.scale() == 0.0 {
        return Some(0.0);
    }
    let mut factor = Factor::new(expansion);
    let shift = factorise_shifted(&mut factor, expansion)?;
    let largest = largest_of_inverse(&factor, expansion.joint_blocks.len())?;
    Some(1.0 / largest - shift)
}

/// Factorises the Hessian with its eigenvalues shifted so far that they are positive; returns the shift (N m/rad).
fn factorise_shifted(factor: &mut Factor, expansion: &Expansion) -> Option<f64> {
    let positive = factor.factorise(expansion, 0.0) == Curvature::Positive;
    if positive && factor.smallest > SMALL * factor.largest {
        return Some(0.0);
    }
    let scale = expansion.scale();
    // No eigenvalue is below minus three times as many blocks as there are joints, each of this size.
    let most = 10.0 * scale * expansion.joint_blocks.len() as f64;
    let mut shift = SMALL * scale;
    while shift > 0.0 && shift <= most {
        if factor.factorise(expansion, shift) == Curvature::Positive {
            return Some(shift);
        }
        shift *= GROWTH;
    }
    None
}

/// The largest eigenvalue of the inverse of what was factorised, of `joints` joints.
fn largest_of_inverse(factor: &Factor, joints: usize) -> Option<f64> {
    let none = vec![Vector3::zeros(); joints];
    let start = |k: usize| ((k + 1) as f64 * GOLDEN).fract() - 0.5;
    let mut next: Vec<Vector3<f64>> = (0..joints)
        .map(|joint| Vector3::from_fn(|axis, _| start(3 * joint + axis)))
        .collect();
    let mut norm = dot(&next, &next).sqrt();
    let mut basis: Vec<Vec<Vector3<f64>>> = Vec::new();
    let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
    loop {
        next.iter_mut().for_each(|entry| *entry /= norm);
        let mut product = none.clone();
        factor.solve(&next, &none, &mut product);
        diagonal.push(dot(&next, &product));
        basis.push(next);
        // Twice is enough to be orthogonal to working precision (Parlett, The Symmetric Eigenvalue Problem, 1998, ch. 6.9).
        for _ in 0..2 {
            for vector in &basis {
                let part = dot(vector, &product);
                for (entry, along) in product.iter_mut().zip(vector) {
                    *entry -= along * part;
                }
            }
        }
        norm = dot(&product, &product).sqrt();
        let (largest, last) = largest_pair(&diagonal, &beside)?;
        let residual = norm * last.abs();
        if residual <= CONVERGED * largest || basis.len() == 3 * joints {
            return (largest > 0.0).then_some(largest);
        }
        beside.push(norm);
        next = product;
    }
}

/// The largest eigenvalue of a tridiagonal matrix, and the last entry of its eigenvector; `None` for numbers that are not finite.
fn largest_pair(diagonal: &[f64], beside: &[f64]) -> Option<(f64, f64)> {
    if !diagonal.iter().chain(beside).all(|entry| entry.is_finite()) {
        return None;
    }
    let matrix = DMatrix::from_fn(diagonal.len(), diagonal.len(), |row, column| {
        match row.abs_diff(column) {
            0 => diagonal[row],
            1 => beside[row.min(column)],
            _ => 0.0,
        }
    });
    let eigen = SymmetricEigen::new(matrix);
    let place = eigen.eigenvalues.imax();
    let last = eigen.eigenvectors[(diagonal.len() - 1, place)];
    Some((eigen.eigenvalues[place], last))
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
