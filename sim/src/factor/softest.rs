//! The smallest eigenvalue of the Hessian, and the smallest real part of the Jacobian's under loads without a potential: by
//! the inverse, at O(n) a step. Of the symmetric one Lanczos iteration, of the other one Arnoldi's (Golub and Van Loan, Matrix
//! Computations, ch. 10).

use nalgebra::{DMatrix, SymmetricEigen, Vector3};

use super::held::HeldLengths;
use super::krylov::{Arnoldi, Ritz, dot, norm, probe, subtract};
use super::loaded::LoadedMatrix;
use super::unsymmetric::{ChainLu, Side};
use super::{Curvature, Factor};
use crate::energy::Expansion;

/// Pivots below this share of the largest are too small to divide by: the Hessian is shifted first.
const SMALL: f64 = 1e-8;
/// Growth of the shift until the Hessian is positive definite.
const GROWTH: f64 = 10.0;
/// Residual of an eigenvector, as a share of its eigenvalue, at which the eigenvalue has converged: its own error is of the
/// second order in that where the matrix is symmetric.
const CONVERGED: f64 = 1e-9;
/// Eigenvalues of the inverse below this share of the largest are not told from zero.
const ZERO: f64 = 1e-11;
/// Dimensions of Arnoldi's spaces whose eigenvalues are computed.
const DIMENSIONS: [usize; 10] = [6, 12, 18, 24, 36, 48, 72, 96, 144, 192];

/// The smallest eigenvalue of the Hessian of `expansion` on the turns that keep the lengths `held` (N m/rad); infinite where
/// none do, `None` for numbers that are not finite.
pub(crate) fn smallest_eigenvalue(expansion: &Expansion, held: &HeldLengths) -> Option<f64> {
    let joints = expansion.joint_blocks.len();
    let freedom = 3 * joints - held.rank();
    if freedom == 0 {
        return Some(f64::INFINITY);
    }
    // Without springs and loads nothing resists a turn, and no shift has a size.
    if expansion.scale() == 0.0 {
        return Some(0.0);
    }
    let mut factor = Factor::new(expansion);
    let shift = factorise_shifted(&mut factor, expansion)?;
    let none = vec![Vector3::zeros(); joints];
    let mut solver = held.solver(|rhs, solution| factor.solve(rhs, &none, solution));
    let largest = largest_of_inverse(first(joints, held), freedom, |rhs, solution| {
        solver.solve(rhs, solution);
    })?;
    Some(1.0 / largest - shift)
}

/// The smallest eigenvalue of a positive definite matrix of so many joints, given how to solve with it, on the turns that keep
/// the lengths `held` (N m/rad); infinite where none do, `None` for numbers that are not finite.
pub(crate) fn smallest_by_solving(
    joints: usize,
    held: &HeldLengths,
    solve: impl FnMut(&[Vector3<f64>], &mut [Vector3<f64>]),
) -> Option<f64> {
    let freedom = 3 * joints - held.rank();
    if freedom == 0 {
        return Some(f64::INFINITY);
    }
    let mut solver = held.solver(solve);
    let largest = largest_of_inverse(first(joints, held), freedom, |rhs, solution| {
        solver.solve(rhs, solution);
    })?;
    Some(1.0 / largest)
}

/// The smallest real part of the eigenvalues of a Jacobian under loads without a potential, on the turns that keep the lengths
/// `held` (N m/rad); infinite where none do, `None` if it cannot be computed.
///
/// Its error is 1e-9 of the Jacobian's size or less where the eigenvalue is well conditioned. Under large loads the Jacobian is
/// far from normal: changes of its entries in the last place then change its eigenvalues by as much as a percent.
pub(crate) fn smallest_real_part(matrix: &LoadedMatrix, held: &HeldLengths) -> Option<f64> {
    let joints = matrix.joints();
    if held.rank() == 3 * joints {
        return Some(f64::INFINITY);
    }
    if matrix.scale() == 0.0 {
        return Some(0.0);
    }
    let (lu, shift) = positive_shift(matrix)?;
    let none = vec![Vector3::zeros(); joints];
    let mut solver = held.solver(|rhs, solution| lu.solve(rhs, &none, Side::Matrix, solution));
    let mut space = Arnoldi::of(first(joints, held));
    let mut last = f64::NAN;
    for dimension in DIMENSIONS {
        space.extend(dimension, |rhs, solution| solver.solve(rhs, solution));
        let (least, converged) = leftmost(&space.ritz()?, shift)?;
        let same = (last - least).abs() <= CONVERGED * matrix.scale();
        last = least;
        if space.is_closed() || (converged && same) {
            break;
        }
    }
    Some(last)
}

/// The factors of a Jacobian with its eigenvalues shifted so far that its symmetric part is positive definite, and their real
/// parts above zero (Bendixson; Horn and Johnson, Topics in Matrix Analysis, 1991, ch. 1.2); and the shift (N m/rad).
fn positive_shift(matrix: &LoadedMatrix) -> Option<(ChainLu, f64)> {
    let scale = matrix.scale();
    let most = 10.0 * scale * matrix.joints() as f64;
    if matrix.has_positive_part(SMALL * scale)
        && let Some(lu) = matrix.chain_lu(0.0)
    {
        return Some((lu, 0.0));
    }
    let mut shift = SMALL * scale;
    while shift <= most {
        if matrix.has_positive_part(-shift)
            && let Some(lu) = matrix.chain_lu(shift)
        {
            return Some((lu, shift));
        }
        shift *= GROWTH;
    }
    None
}

/// The smallest real part among the eigenvalues whose shifted reciprocals are given, and whether it and all nearer to the
/// shift have converged. Eigenvalues of the inverse have positive real parts; those of what it takes to zero are rounding.
fn leftmost(inverse: &[Ritz], shift: f64) -> Option<(f64, bool)> {
    let real = |ritz: &Ritz| ritz.value.inv().re - shift;
    let converged = |ritz: &Ritz, share: f64| ritz.residual <= share * ritz.value.norm();
    let largest = (inverse.iter().map(|ritz| ritz.value.norm())).fold(0.0, f64::max);
    let counts = |ritz: &&Ritz| ritz.value.re > ZERO * largest;
    let found = (inverse.iter().filter(counts))
        .filter(|ritz| converged(ritz, CONVERGED))
        .min_by(|a, b| real(a).total_cmp(&real(b)));
    let Some(found) = found else {
        let nearest = (inverse.iter()).max_by(|a, b| a.value.re.total_cmp(&b.value.re));
        return nearest.map(|ritz| (real(ritz), false));
    };
    let mut nearer = (inverse.iter()).filter(|ritz| ritz.value.norm() >= found.value.norm());
    let all = nearer.all(|ritz| converged(ritz, CONVERGED.sqrt()));
    Some((real(found), all))
}

/// A first vector, of turns that keep the lengths.
fn first(joints: usize, held: &HeldLengths) -> Vec<Vector3<f64>> {
    let mut first = probe(joints);
    held.project(&mut first);
    first
}

/// Factorises the Hessian with its eigenvalues shifted so far that they are positive; returns the shift (N m/rad).
fn factorise_shifted(factor: &mut Factor, expansion: &Expansion) -> Option<f64> {
    let positive = factor.factorise(expansion, 0.0) == Curvature::Positive;
    if positive && factor.smallest() > SMALL * factor.largest {
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

/// The largest eigenvalue of a symmetric inverse in so many dimensions, given the solver and the `first` vector.
fn largest_of_inverse(
    first: Vec<Vector3<f64>>,
    freedom: usize,
    mut solve: impl FnMut(&[Vector3<f64>], &mut [Vector3<f64>]),
) -> Option<f64> {
    let mut next = first;
    let mut length = norm(&next);
    let mut basis: Vec<Vec<Vector3<f64>>> = Vec::new();
    let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
    loop {
        next.iter_mut().for_each(|entry| *entry /= length);
        let mut product = vec![Vector3::zeros(); next.len()];
        solve(&next, &mut product);
        diagonal.push(dot(&next, &product));
        basis.push(next);
        // Twice is enough to be orthogonal to working precision (Parlett, The Symmetric Eigenvalue Problem, 1998, ch. 6.9).
        for _ in 0..2 {
            for vector in &basis {
                let part = dot(vector, &product);
                subtract(&mut product, vector, part);
            }
        }
        length = norm(&product);
        let (largest, last) = largest_pair(&diagonal, &beside)?;
        let residual = length * last.abs();
        if residual <= CONVERGED * largest || basis.len() == freedom {
            return (largest > 0.0).then_some(largest);
        }
        beside.push(length);
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
