//! Equilibria as arrays.

use std::f64::consts::TAU;

use nalgebra::UnitQuaternion;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use tdcr::sim::statics::{Equilibrium, Examined, Growth, Stability};

use crate::arrays::{array, write_points, write_quaternions};

/// Equilibria by rows: the first axis of each array.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct EquilibriumRows {
    positions: Py<PyArray3<f64>>,
    quaternions: Py<PyArray3<f64>>,
    configuration: Py<PyArray3<f64>>,
    lengths: Py<PyArray2<f64>>,
    tensions: Py<PyArray2<f64>>,
    residual: Py<PyArray1<f64>>,
    iterations: Py<PyArray1<u32>>,
    converged: Py<PyArray1<bool>>,
    stability: Py<PyArray1<u8>>,
    examined: Py<PyArray1<u8>>,
    growth: Py<PyArray2<f64>>,
}

/// The numbers of [`EquilibriumRows`], before they are arrays.
pub struct Numbers {
    discs: usize,
    tendons: usize,
    positions: Vec<f64>,
    quaternions: Vec<f64>,
    configuration: Vec<f64>,
    lengths: Vec<f64>,
    tensions: Vec<f64>,
    residual: Vec<f64>,
    iterations: Vec<u32>,
    converged: Vec<bool>,
    stability: Vec<u8>,
    examined: Vec<u8>,
    growth: Vec<f64>,
}

/// Where the numbers of one row go.
pub struct Row<'a> {
    positions: &'a mut [f64],
    quaternions: &'a mut [f64],
    configuration: &'a mut [f64],
    lengths: &'a mut [f64],
    tensions: &'a mut [f64],
    residual: &'a mut f64,
    iterations: &'a mut u32,
    converged: &'a mut bool,
    stability: &'a mut u8,
    examined: &'a mut u8,
    growth: &'a mut [f64; 2],
}

impl Numbers {
    pub fn new(rows: usize, discs: usize, tendons: usize) -> Self {
        Self {
            discs,
            tendons,
            positions: vec![0.0; 3 * discs * rows],
            quaternions: vec![0.0; 4 * discs * rows],
            configuration: vec![0.0; 4 * discs * rows],
            lengths: vec![0.0; tendons * rows],
            tensions: vec![0.0; tendons * rows],
            residual: vec![0.0; rows],
            iterations: vec![0; rows],
            converged: vec![false; rows],
            stability: vec![0; rows],
            examined: vec![0; rows],
            growth: vec![0.0; 2 * rows],
        }
    }

    /// Where each row goes.
    pub fn rows(&mut self) -> Vec<Row<'_>> {
        let (n, t) = (self.discs, self.tendons);
        let mut lengths = self.lengths.as_mut_slice();
        let mut tensions = self.tensions.as_mut_slice();
        let places = self.positions.chunks_exact_mut(3 * n);
        let turns = self.quaternions.chunks_exact_mut(4 * n);
        let joints = self.configuration.chunks_exact_mut(4 * n);
        let solved = self.residual.iter_mut().zip(&mut self.iterations);
        let state = self.converged.iter_mut().zip(&mut self.stability);
        let growth = self.growth.as_chunks_mut::<2>().0.iter_mut();
        let state = state.zip(self.examined.iter_mut().zip(growth));
        (places.zip(turns).zip(joints))
            .zip(solved.zip(state))
            .map(
                |(
                    ((positions, quaternions), configuration),
                    ((residual, iterations), ((converged, stability), (examined, growth))),
                )| {
                    let (length, rest) = std::mem::take(&mut lengths).split_at_mut(t);
                    lengths = rest;
                    let (tension, rest) = std::mem::take(&mut tensions).split_at_mut(t);
                    tensions = rest;
                    Row {
                        positions,
                        quaternions,
                        configuration,
                        lengths: length,
                        tensions: tension,
                        residual,
                        iterations,
                        converged,
                        stability,
                        examined,
                        growth,
                    }
                },
            )
            .collect()
    }

    pub fn into_arrays(self, py: Python<'_>) -> PyResult<EquilibriumRows> {
        let (rows, n, t) = (self.residual.len(), self.discs, self.tendons);
        Ok(EquilibriumRows {
            positions: array(py, self.positions, [rows, n, 3])?.unbind(),
            quaternions: array(py, self.quaternions, [rows, n, 4])?.unbind(),
            configuration: array(py, self.configuration, [rows, n, 4])?.unbind(),
            lengths: array(py, self.lengths, [rows, t])?.unbind(),
            tensions: array(py, self.tensions, [rows, t])?.unbind(),
            residual: array(py, self.residual, [rows])?.unbind(),
            iterations: array(py, self.iterations, [rows])?.unbind(),
            converged: array(py, self.converged, [rows])?.unbind(),
            stability: array(py, self.stability, [rows])?.unbind(),
            examined: array(py, self.examined, [rows])?.unbind(),
            growth: array(py, self.growth, [rows, 2])?.unbind(),
        })
    }
}

/// An equilibrium: positions, quaternions, configuration, lengths, tensions, residual, iterations, whether it converged,
/// the codes of its stability and of what was examined, and the fastest growth.
pub type One<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    f64,
    usize,
    bool,
    u8,
    u8,
    Bound<'py, PyArray1<f64>>,
);

/// One equilibrium as arrays, without the first axis of [`EquilibriumRows`].
pub fn one<'py>(py: Python<'py>, equilibrium: &Equilibrium) -> PyResult<One<'py>> {
    let n = equilibrium.positions.len();
    let turns = |quaternions: &[UnitQuaternion<f64>]| {
        let mut numbers = vec![0.0; 4 * n];
        write_quaternions(quaternions, &mut numbers);
        array(py, numbers, [n, 4])
    };
    let mut points = vec![0.0; 3 * n];
    write_points(&equilibrium.positions, &mut points);
    Ok((
        array(py, points, [n, 3])?,
        turns(&equilibrium.orientations)?,
        turns(&equilibrium.configuration.0)?,
        PyArray1::from_slice(py, &equilibrium.tendon_lengths),
        PyArray1::from_slice(py, &equilibrium.tendon_tensions),
        equilibrium.residual,
        equilibrium.iterations,
        equilibrium.converged,
        code(&STABILITY, equilibrium.stability),
        code(&EXAMINED, equilibrium.examined),
        PyArray1::from_slice(py, &growth_numbers(equilibrium.growth)),
    ))
}

/// Its rate (1/s) and frequency (Hz); zeros for none.
fn growth_numbers(growth: Option<Growth>) -> [f64; 2] {
    growth.map_or([0.0; 2], |growth| {
        [growth.rate, growth.angular_frequency / TAU]
    })
}

impl Row<'_> {
    pub fn write(&mut self, equilibrium: &Equilibrium) {
        write_points(&equilibrium.positions, self.positions);
        write_quaternions(&equilibrium.orientations, self.quaternions);
        write_quaternions(&equilibrium.configuration.0, self.configuration);
        self.lengths.copy_from_slice(&equilibrium.tendon_lengths);
        self.tensions.copy_from_slice(&equilibrium.tendon_tensions);
        *self.residual = equilibrium.residual;
        *self.iterations = u32::try_from(equilibrium.iterations).unwrap_or(u32::MAX);
        *self.converged = equilibrium.converged;
        *self.stability = code(&STABILITY, equilibrium.stability);
        *self.examined = code(&EXAMINED, equilibrium.examined);
        *self.growth = growth_numbers(equilibrium.growth);
    }
}

/// Kinds of stability, by their codes in arrays: the names are `STABILITY` of `tdcr.statics`.
pub const STABILITY: [Option<Stability>; 5] = [
    None,
    Some(Stability::Stable),
    Some(Stability::Neutral),
    Some(Stability::Unstable),
    Some(Stability::Flutter),
];

/// What is examined, by its codes: the names are `EXAMINED`.
pub const EXAMINED: [Option<Examined>; 4] = [
    None,
    Some(Examined::Energy),
    Some(Examined::Motion),
    Some(Examined::Statics),
];

pub fn code<T: PartialEq>(kinds: &[T], kind: T) -> u8 {
    let place = kinds.iter().position(|known| *known == kind);
    place
        .and_then(|place| u8::try_from(place).ok())
        .unwrap_or(0)
}
