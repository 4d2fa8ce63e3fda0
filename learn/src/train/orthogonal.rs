//! Approximation of the nearest matrix with orthonormal rows or columns.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// Coefficients of an odd quintic whose iteration drives all singular values in (0, 1] to about 1, small ones fast
/// (Jordan et al. 2024, *Muon: an optimizer for hidden layers in neural networks*).
const QUINTIC: [f32; 3] = [3.4445, -4.7750, 2.0315];

/// Iterations: enough for singular values above about 0.01.
const ITERATIONS: usize = 5;

/// Keeps the quotient finite where the matrix is zero.
const EPSILON: f32 = 1e-7;

/// Workspace of [`Orthogonaliser::run`], kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Orthogonaliser {
    x: Vec<f32>,
    next: Vec<f32>,
    gram: Vec<f32>,
    polynomial: Vec<f32>,
}

impl Orthogonaliser {
    /// The `matrix` `(rows, columns)`, row-major, with singular values near 1 (0.7 to 1.2), those below about a hundredth
    /// of its Frobenius norm with smaller ones; the singular vectors stay.
    pub fn run(
        &mut self,
        matrix: impl Iterator<Item = f32>,
        [rows, columns]: [usize; 2],
    ) -> &[f32] {
        self.x.clear();
        self.x.extend(matrix);
        let square = |x: &f32| f64::from(*x) * f64::from(*x);
        let norm = self.x.iter().map(square).sum::<f64>().sqrt() as f32;
        let scale = 1.0 / (norm + EPSILON);
        self.x.iter_mut().for_each(|x| *x *= scale);
        self.next.resize(self.x.len(), 0.0);
        let side = rows.min(columns);
        self.gram.resize(side * side, 0.0);
        self.polynomial.resize(side * side, 0.0);
        for _ in 0..ITERATIONS {
            self.iterate([rows, columns]);
            std::mem::swap(&mut self.x, &mut self.next);
        }
        &self.x
    }

    /// `next = a X + (b A + c A^2) X` with `A = X X^T`, of `X` or of its transpose, whichever is wide.
    fn iterate(&mut self, [rows, columns]: [usize; 2]) {
        let [a, b, c] = QUINTIC;
        let side = rows.min(columns);
        // The Gram matrix is taken over the shorter side: of a tall matrix, the transposed view is iterated.
        let x = MatRef::from_row_major_slice(&self.x, rows, columns);
        let next = MatMut::from_row_major_slice_mut(&mut self.next, rows, columns);
        let (x, next) = match rows > columns {
            true => (x.transpose(), next.transpose_mut()),
            false => (x, next),
        };
        let mut gram = MatMut::from_row_major_slice_mut(&mut self.gram, side, side);
        product(gram.as_mut(), x, x.transpose(), 1.0);
        let mut polynomial = MatMut::from_row_major_slice_mut(&mut self.polynomial, side, side);
        let gram = gram.as_ref();
        product(polynomial.as_mut(), gram, gram, c);
        for (p, g) in self.polynomial.iter_mut().zip(&self.gram) {
            *p += b * g;
        }
        for k in 0..side {
            self.polynomial[k * (side + 1)] += a;
        }
        let polynomial = MatRef::from_row_major_slice(&self.polynomial, side, side);
        product(next, polynomial, x, 1.0);
    }
}

/// `Y = factor A B`.
fn product(y: MatMut<f32>, a: MatRef<f32>, b: MatRef<f32>, factor: f32) {
    matmul(y, Accum::Replace, a, b, factor, Par::Seq);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Singular values of a row-major matrix, by a library.
    fn singular_values(matrix: &[f32], [rows, columns]: [usize; 2]) -> Vec<f32> {
        let matrix = MatRef::from_row_major_slice(matrix, rows, columns);
        matrix.singular_values().expect("it converges")
    }

    proptest! {
        #[test]
        fn singular_values_come_near_one_and_vectors_stay(
            shape in prop::array::uniform2(2usize..12),
            values in prop::collection::vec(-1.0f32..1.0, 144),
        ) {
            let [rows, columns] = shape;
            let given = &values[..rows * columns];
            let before = singular_values(given, shape);
            let norm = before.iter().map(|s| s * s).sum::<f32>().sqrt();
            prop_assume!(before.iter().all(|s| *s > 0.02 * norm));
            let mut orthogonaliser = Orthogonaliser::default();
            let matrix = orthogonaliser.run(given.iter().copied(), shape);
            for s in singular_values(matrix, shape) {
                prop_assert!((0.6..1.3).contains(&s), "{s}");
            }
            // Of an odd polynomial of the matrix, the product with its transpose is symmetric and positive.
            let given = MatRef::from_row_major_slice(given, rows, columns);
            let matrix = MatRef::from_row_major_slice(matrix, rows, columns);
            let product = given * matrix.transpose();
            let asymmetry = (&product - product.transpose()).norm_l2();
            prop_assert!(asymmetry < 1e-4 * product.norm_l2(), "{asymmetry}");
            let trace: f32 = (0..rows).map(|k| product[(k, k)]).sum();
            let nuclear: f32 = before.iter().sum();
            prop_assert!(trace > 0.6 * nuclear, "{trace} of {nuclear}");
        }
    }

    #[test]
    fn nothing_stays_nothing() {
        let mut orthogonaliser = Orthogonaliser::default();
        assert_eq!(orthogonaliser.run([0.0; 6].into_iter(), [2, 3]), [0.0; 6]);
    }
}
