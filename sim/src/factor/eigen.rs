//! Eigenvalues and eigenvectors of symmetric 3 x 3 matrices.

use nalgebra::{Matrix3, Vector3};

/// Sweeps over the three pairs of axes: they converge quadratically, in four or so.
const SWEEPS: usize = 20;
/// Of the largest entry, what another one may be that couples two axes.
const ROUNDING: f64 = 0.5 * f64::EPSILON;

/// Eigenvalues, in no order, and the eigenvectors as columns, by Jacobi's rotations (Golub and Van Loan, Matrix Computations, ch. 8.5).
/// Takes half of the time of `nalgebra`'s iteration for matrices of any size, which was a fifth of settling a robot.
pub(super) fn eigen(m: &Matrix3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    let size = m.amax();
    if size == 0.0 {
        return (Vector3::zeros(), Matrix3::identity());
    }
    // Squares of entries neither overflow nor vanish.
    let (mut a, mut vectors) = (m / size, Matrix3::identity());
    for _ in 0..SWEEPS {
        let mut turned = false;
        for (p, q, other) in [(0, 1, 2), (0, 2, 1), (1, 2, 0)] {
            let coupling = a[(p, q)];
            if coupling.abs() > ROUNDING {
                turned = true;
                rotate(&mut a, &mut vectors, [p, q, other]);
            }
        }
        if !turned {
            break;
        }
    }
    (a.diagonal() * size, vectors)
}

/// Turns the axes `p` and `q` such that `a` does not couple them.
#[inline(always)]
fn rotate(a: &mut Matrix3<f64>, vectors: &mut Matrix3<f64>, [p, q, other]: [usize; 3]) {
    let coupling = a[(p, q)];
    let half = 0.5 * (a[(q, q)] - a[(p, p)]);
    // The smaller of the two angles.
    let tangent = coupling / (half + (half * half + coupling * coupling).sqrt().copysign(half));
    let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
    let sine = tangent * cosine;
    let turned = |x: f64, y: f64| [cosine * x - sine * y, sine * x + cosine * y];
    a[(p, p)] -= tangent * coupling;
    a[(q, q)] += tangent * coupling;
    (a[(p, q)], a[(q, p)]) = (0.0, 0.0);
    let [by_p, by_q] = turned(a[(p, other)], a[(q, other)]);
    (a[(p, other)], a[(other, p)]) = (by_p, by_p);
    (a[(q, other)], a[(other, q)]) = (by_q, by_q);
    for row in 0..3 {
        let [x, y] = turned(vectors[(row, p)], vectors[(row, q)]);
        (vectors[(row, p)], vectors[(row, q)]) = (x, y);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{SymmetricEigen, UnitQuaternion};
    use proptest::prelude::*;

    use super::*;

    fn entry() -> impl Strategy<Value = f64> {
        prop_oneof![
            Just(0.0),
            -1.0..1.0_f64,
            -1e-9..1e-9_f64,
            -1e9..1e9_f64,
            Just(1.0)
        ]
    }

    proptest! {
        #[test]
        fn eigenvalues_are_those_of_the_library_and_vectors_diagonalise(
            values in prop::array::uniform3(entry()),
            axis in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::from(axis));
            let turn = turn.to_rotation_matrix().into_inner();
            let m = turn * Matrix3::from_diagonal(&Vector3::from(values)) * turn.transpose();
            let m = (m + m.transpose()) * 0.5;
            let (found, vectors) = eigen(&m);
            let rounding = 1e-14 * m.amax();
            let again = vectors * Matrix3::from_diagonal(&found) * vectors.transpose();
            prop_assert!((again - m).amax() <= rounding);
            prop_assert!((vectors.tr_mul(&vectors) - Matrix3::identity()).amax() < 1e-14);
            let sorted = |values: &Vector3<f64>| {
                let mut values = [values.x, values.y, values.z];
                values.sort_by(f64::total_cmp);
                values
            };
            let library = sorted(&SymmetricEigen::new(m).eigenvalues);
            for (found, library) in sorted(&found).into_iter().zip(library) {
                prop_assert!((found - library).abs() <= rounding);
            }
        }
    }

    #[test]
    fn numbers_that_are_not_finite_end() {
        let (values, _) = eigen(&Matrix3::from_element(f64::NAN));
        assert!(values.iter().all(|value| value.is_nan()));
        eigen(&Matrix3::from_element(f64::INFINITY));
    }
}
