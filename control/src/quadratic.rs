//! Small convex quadratic programs: `min ½ x'H x + g'x` with `A x <= b`, where `x = 0` is allowed.
//!
//! A control step asks for a change of the command that is best and within bounds. No change at all is within them, so the primal
//! active-set method (Nocedal and Wright, Numerical Optimization, 2nd ed., algorithm 16.3) needs no first phase, and every
//! iterate keeps the bounds: one that is cut short is a worse step, never a forbidden one.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Multipliers above this share of the largest one count as not negative, steps below this share of the solution as none.
const ROUNDING: f64 = 1e-10;

/// A convex quadratic program of which `x = 0` is feasible.
#[derive(Clone, Debug)]
pub struct QuadraticProgram {
    /// `H`, positive definite.
    pub hessian: DMatrix<f64>,
    /// `g`.
    pub gradient: DVector<f64>,
    /// `A`, a row for each constraint.
    pub rows: DMatrix<f64>,
    /// `b`; entries below 0 count as 0.
    pub bounds: DVector<f64>,
}

/// What a program was solved to.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticSolution {
    /// `x`, within all bounds but for rounding.
    pub x: DVector<f64>,
    /// The rows that hold it.
    pub active: Vec<usize>,
    /// Their multipliers, none negative where it is the minimiser.
    pub multipliers: Vec<f64>,
    /// Whether it is the minimiser; else the best iterate.
    pub is_minimiser: bool,
}

impl QuadraticProgram {
    /// The minimiser; `None` where `H` is not positive definite or anything is not a finite number.
    ///
    /// # Panics
    /// If the sizes do not fit together.
    pub fn solve(&self) -> Option<QuadraticSolution> {
        let numbers = [self.gradient.as_slice(), self.bounds.as_slice()];
        if !(numbers.iter().copied().flatten())
            .chain(self.rows.iter())
            .all(|x| x.is_finite())
        {
            return None;
        }
        let factor = Cholesky::new(self.hessian.clone())?;
        let free = -factor.solve(&self.gradient);
        let mut search = Search {
            responses: factor.solve(&self.rows.transpose()),
            x: DVector::zeros(self.gradient.len()),
            active: Vec::new(),
            multipliers: Vec::new(),
            free,
            program: self,
        };
        let most = 10 * (self.rows.nrows() + self.gradient.len()) + 10;
        let is_minimiser = (0..most).any(|_| search.step() == Step::Minimal);
        Some(QuadraticSolution {
            x: search.x,
            active: search.active,
            multipliers: search.multipliers,
            is_minimiser,
        })
    }
}

/// State of the search.
struct Search<'p> {
    program: &'p QuadraticProgram,
    /// The minimiser without constraints.
    free: DVector<f64>,
    /// `H⁻¹ A'`.
    responses: DMatrix<f64>,
    x: DVector<f64>,
    active: Vec<usize>,
    multipliers: Vec<f64>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    Moved,
    Minimal,
}

impl Search<'_> {
    /// One step: towards the minimiser with the active rows as equations, or, from there, a row that pulls is let go.
    fn step(&mut self) -> Step {
        let Some((goal, multipliers)) = self.on_active() else {
            // Rows that depend on one another: the last one added nothing.
            self.active.pop();
            return Step::Moved;
        };
        self.multipliers = multipliers;
        let along = &goal - &self.x;
        match self.blocking(&along) {
            Some((row, part)) => {
                self.x += along * part;
                self.active.push(row);
                Step::Moved
            }
            None => {
                self.x = goal;
                let scale = (self.multipliers.iter()).fold(0.0, |most: f64, m| most.max(m.abs()));
                let worst = (self.multipliers.iter().enumerate())
                    .min_by(|a, b| a.1.total_cmp(b.1))
                    .filter(|(_, multiplier)| **multiplier < -ROUNDING * scale);
                match worst.map(|(place, _)| place) {
                    None => Step::Minimal,
                    Some(place) => {
                        self.active.remove(place);
                        self.multipliers.remove(place);
                        Step::Moved
                    }
                }
            }
        }
    }

    /// The minimiser on the active rows, with its multipliers (Schur complement of the KKT system).
    fn on_active(&self) -> Option<(DVector<f64>, Vec<f64>)> {
        if self.active.is_empty() {
            return Some((self.free.clone(), Vec::new()));
        }
        let rows = self.program.rows.select_rows(&self.active);
        let responses = self.responses.select_columns(&self.active);
        let bounds = DVector::from_fn(self.active.len(), |i, _| self.bound(self.active[i]));
        let schur: Cholesky<f64, Dyn> = Cholesky::new(&rows * &responses)?;
        let multipliers = schur.solve(&(&rows * &self.free - bounds));
        let goal = &self.free - responses * &multipliers;
        Some((goal, multipliers.as_slice().to_vec()))
    }

    /// The first row that the way `along` meets, and the part of the way up to it.
    fn blocking(&self, along: &DVector<f64>) -> Option<(usize, f64)> {
        let rows = &self.program.rows;
        let (slopes, here) = (rows * along, rows * &self.x);
        let scale = along.amax();
        let mut first: Option<(usize, f64)> = None;
        for row in 0..rows.nrows() {
            let least = ROUNDING * scale * rows.row(row).amax();
            if self.active.contains(&row) || slopes[row] <= least {
                continue;
            }
            let part = ((self.bound(row) - here[row]) / slopes[row]).max(0.0);
            if part < first.map_or(1.0, |(_, part)| part) {
                first = Some((row, part));
            }
        }
        first
    }

    fn bound(&self, row: usize) -> f64 {
        self.program.bounds[row].max(0.0)
    }
}
