//! Eigenvalues of linear maps known by their products: Arnoldi's iteration (Golub and Van Loan, Matrix Computations,
//! ch. 10.5; Saad, Numerical Methods for Large Eigenvalue Problems, 2011, ch. 6).

use faer::Mat;
use nalgebra::{Complex, Vector3};

/// Part of a turn by which the entries of the first vector follow one another: they have no pattern that a mode could have.
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// What a product leaves outside the space, as a share of it, from which on it is rounding.
const ROUNDING: f64 = 1e-14;

/// An orthonormal basis of a Krylov space, and the map on it.
#[derive(Clone, Debug)]
pub(crate) struct Arnoldi {
    basis: Vec<Vec<Vector3<f64>>>,
    /// Column `k`: the product of basis vector `k`, in the basis.
    columns: Vec<Vec<f64>>,
    /// What the last product leaves outside the space, and its size.
    next: Vec<Vector3<f64>>,
    beside: f64,
}

/// An eigenvalue of the map on the space, nearly one of the map.
#[derive(Clone, Debug)]
pub(crate) struct Ritz {
    pub value: Complex<f64>,
    /// Norm of `A x - value x` for the unit vector `x` that it comes with.
    pub residual: f64,
    /// That vector in the basis.
    entries: Vec<Complex<f64>>,
}

impl Arnoldi {
    /// The space of a first vector of so many `parts`, which a mode is not at right angles to but by chance.
    pub fn new(parts: usize) -> Self {
        let next = probe(parts);
        Self {
            basis: Vec::new(),
            columns: Vec::new(),
            beside: norm(&next),
            next,
        }
    }

    /// The same of `first`.
    pub fn of(first: Vec<Vector3<f64>>) -> Self {
        Self {
            basis: Vec::new(),
            columns: Vec::new(),
            beside: norm(&first),
            next: first,
        }
    }

    pub fn dimension(&self) -> usize {
        self.basis.len()
    }

    /// Whether the map does not lead out of the space: it is then all that the first vector reaches.
    pub fn is_closed(&self) -> bool {
        let largest = self
            .columns
            .iter()
            .flatten()
            .fold(0.0, |a: f64, b| a.max(b.abs()));
        self.beside <= ROUNDING * largest || self.dimension() == 3 * self.next.len()
    }

    /// Adds products until the space has `dimension` dimensions or is closed.
    pub fn extend(
        &mut self,
        dimension: usize,
        mut product: impl FnMut(&[Vector3<f64>], &mut [Vector3<f64>]),
    ) {
        while self.dimension() < dimension && !(self.dimension() > 0 && self.is_closed()) {
            let mut unit = std::mem::take(&mut self.next);
            unit.iter_mut().for_each(|entry| *entry /= self.beside);
            let mut image = vec![Vector3::zeros(); unit.len()];
            product(&unit, &mut image);
            self.basis.push(unit);
            let mut column = vec![0.0; self.basis.len()];
            // Twice is enough to be orthogonal to working precision (Parlett, The Symmetric Eigenvalue Problem, 1998, ch. 6.9).
            for _ in 0..2 {
                for (vector, entry) in self.basis.iter().zip(&mut column) {
                    let part = dot(vector, &image);
                    *entry += part;
                    subtract(&mut image, vector, part);
                }
            }
            if let Some(last) = self.columns.last_mut() {
                last.push(self.beside);
            }
            self.columns.push(column);
            self.beside = norm(&image);
            self.next = image;
        }
    }

    /// The eigenvalues of the map on the space; `None` for numbers that are not finite.
    pub fn ritz(&self) -> Option<Vec<Ritz>> {
        let size = self.dimension();
        let entries = self.columns.iter().flatten().chain([&self.beside]);
        if !entries.into_iter().all(|entry| entry.is_finite()) {
            return None;
        }
        let matrix = Mat::from_fn(size, size, |row, column| {
            self.columns[column].get(row).copied().unwrap_or(0.0)
        });
        let eigen = matrix.eigen().ok()?;
        let (vectors, values) = (eigen.U(), eigen.S().column_vector());
        let pair = |k: usize| {
            let length = vectors.col(k).norm_l2();
            let entries: Vec<_> = (0..size).map(|row| vectors[(row, k)] / length).collect();
            Ritz {
                value: values[k],
                residual: self.beside * entries[size - 1].norm(),
                entries,
            }
        };
        Some((0..size).map(pair).collect())
    }

    /// Real and imaginary part of the vector that belongs to an eigenvalue.
    pub fn vector(&self, ritz: &Ritz) -> [Vec<Vector3<f64>>; 2] {
        let parts = self.basis.first().map_or(0, Vec::len);
        let mut vector = [0, 1].map(|_| vec![Vector3::zeros(); parts]);
        for (basis, entry) in self.basis.iter().zip(&ritz.entries) {
            subtract(&mut vector[0], basis, -entry.re);
            subtract(&mut vector[1], basis, -entry.im);
        }
        vector
    }
}

/// A vector of so many parts without a pattern.
pub(crate) fn probe(parts: usize) -> Vec<Vector3<f64>> {
    let entry = |k: usize| ((k + 1) as f64 * GOLDEN).fract() - 0.5;
    (0..parts)
        .map(|part| Vector3::from_fn(|axis, _| entry(3 * part + axis)))
        .collect()
}

pub(crate) fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

pub(crate) fn norm(a: &[Vector3<f64>]) -> f64 {
    dot(a, a).sqrt()
}

/// `a - part b`.
pub(crate) fn subtract(a: &mut [Vector3<f64>], b: &[Vector3<f64>], part: f64) {
    for (a, b) in a.iter_mut().zip(b) {
        *a -= b * part;
    }
}
