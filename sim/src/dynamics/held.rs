//! Inextensible tendons whose lengths are commanded, in motion.
//!
//! Of a step by `h` from the lengths `L`, with the Jacobian `J` of these by the joints, tensions `t` make the rates at its end
//! `v+ = v* - h A^-1 J' t` of those without them, `A` what the integrator solves with. The tensions are those at which each tendon has
//! its commanded length `c` at the end of the step to first order, `L + h J v+ = c + t / K`, or, if it only pulls, none where it is
//! shorter: a convex quadratic problem in the tensions, which Lawson and Hanson's active set method solves (Solving Least Squares
//! Problems, 1974, ch. 23). `K` is far above the stiffness of any tendon; it shares the load where commands contradict each other.
//! What is of second order in a step's turns is made up for by the next.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::robot::{Command, Drive, Pull, Robot};
use crate::tendon::Posture;

/// Stiffness that stands for that of an inextensible tendon (N/m).
const STIFFNESS: f64 = 1e9;
/// By how much a slack tendon may be longer than commanded (m): rounding.
const ROUNDING: f64 = 1e-14;

/// A tendon in a step, as what else acts in it takes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeldLength<'a> {
    /// Gradient of its length by the joints (m/rad), world axes.
    pub slopes: &'a [Vector3<f64>],
    /// `K` (N/m).
    pub stiffness: f64,
    /// Its tension in the step (N), and by what it is longer than commanded at the end (m), below 0 where it is slack.
    pub tension: f64,
    pub excess: f64,
    /// Whether it only pulls.
    pub only_pulls: bool,
}

/// The tendons of one robot whose lengths are commanded, and workspace.
#[derive(Clone, Debug)]
pub(super) struct HeldLengths {
    /// The robot as it was given.
    pub robot: Robot,
    tendons: Vec<usize>,
    /// What the robot with tensions in place of lengths is commanded.
    acting: Command,
    /// Gradient of each length by the joints (m/rad), and what it changes the rates by; world axes.
    pub slopes: Vec<Vec<Vector3<f64>>>,
    pub responses: Vec<Vec<Vector3<f64>>>,
    /// Tensions that act in the step as it was begun, and those found (N).
    pub begun: DVector<f64>,
    pub tensions: DVector<f64>,
    /// By what each is longer than commanded at the end of the step (m), below 0 for one that is slack.
    pub excess: DVector<f64>,
    /// Rates at the end of the step that was begun, at its begin, and the change of the former (rad/s).
    pub free: Vec<Vector3<f64>>,
    pub start: Vec<Vector3<f64>>,
    pub change: Vec<Vector3<f64>>,
}

impl HeldLengths {
    /// Those of a robot that has any.
    pub fn new(robot: &Robot) -> Option<Box<Self>> {
        let all = robot.tendons().iter().enumerate();
        let held = all.filter(|(_, tendon)| tendon.holds_length());
        let tendons: Vec<usize> = held.map(|(tendon, _)| tendon).collect();
        let zeros = vec![Vector3::zeros(); robot.discs().len()];
        let count = tendons.len();
        (count > 0).then(|| {
            Box::new(Self {
                robot: robot.clone(),
                acting: robot.mean_command(),
                slopes: vec![zeros.clone(); count],
                responses: vec![zeros.clone(); count],
                begun: DVector::zeros(count),
                tensions: DVector::zeros(count),
                excess: DVector::zeros(count),
                free: zeros.clone(),
                start: zeros.clone(),
                change: zeros,
                tendons,
            })
        })
    }

    /// The robot whose tendons of commanded length take tensions instead.
    pub fn by_tension(robot: &Robot) -> Robot {
        let mut spec = robot.spec().clone();
        for tendon in spec.tendon_specs_mut() {
            if tendon.drive == Drive::Length && !tendon.stretches() {
                tendon.drive = Drive::Tension;
            }
        }
        Robot::new(spec).expect("another drive keeps a robot valid")
    }

    /// Tendons and their tensions in the last step (N).
    pub fn tensions(&self) -> impl Iterator<Item = (usize, f64)> {
        let tensions = self.tensions.iter().copied();
        self.tendons.iter().copied().zip(tensions)
    }

    /// The tendons in the step that was begun.
    pub fn all(&self) -> impl Iterator<Item = HeldLength<'_>> {
        self.tendons
            .iter()
            .enumerate()
            .map(|(i, &tendon)| HeldLength {
                slopes: &self.slopes[i],
                stiffness: STIFFNESS,
                tension: self.tensions[i],
                excess: self.excess[i],
                only_pulls: self.robot.tendons()[tendon].pull == Pull::TensionOnly,
            })
    }

    /// `command` with the tensions of the step that is begun in place of lengths.
    pub fn acting(&mut self, command: &Command) -> &Command {
        self.acting.clone_from(command);
        for (&tendon, &tension) in self.tendons.iter().zip(self.begun.iter()) {
            self.acting.as_mut_slice()[tendon] = tension;
        }
        &self.acting
    }

    /// `command` without tensions in place of lengths.
    pub fn without_tensions(&mut self, command: &Command) -> &Command {
        self.begun.fill(0.0);
        self.acting(command)
    }

    /// Sets the lengths' gradients in a posture.
    pub fn set_slopes(&mut self, posture: &Posture) {
        let chain = &posture.chain;
        let place = |tendon: usize| self.tendons.iter().position(|&held| held == tendon);
        for slopes in &mut self.slopes {
            slopes.fill(Vector3::zeros());
        }
        for (segment, stretch) in self.robot.segments().iter().zip(&posture.stretches) {
            if let Some(place) = place(segment.tendon) {
                self.slopes[place][segment.joint] += stretch.gradient();
            }
        }
        for span in self.robot.spans() {
            let Some(place) = place(span.tendon) else {
                continue;
            };
            let (_, upper, stretch) = span.stretch(&self.robot, chain);
            for joint in span.lower.map_or(0, |disc| disc + 1)..=span.upper {
                let arm = upper - chain.centres[joint];
                self.slopes[place][joint] += arm.cross(&stretch.direction);
            }
        }
    }

    /// Finds the tensions of a step by `h` (s) that was begun, from the `lengths` at its begin (m), and what they change of its rates.
    pub fn solve(&mut self, h: f64, lengths: &[f64], command: &Command) {
        let count = self.tendons.len();
        let along = |slopes: &[Vector3<f64>], rates: &[Vector3<f64>]| -> f64 {
            slopes.iter().zip(rates).map(|(a, b)| a.dot(b)).sum()
        };
        let mobility = DMatrix::from_fn(count, count, |i, j| {
            h * h * along(&self.slopes[i], &self.responses[j])
        });
        // What each length would be too long by without the tensions.
        let mut excess = &mobility * &self.begun;
        for (i, &tendon) in self.tendons.iter().enumerate() {
            let grown = h * along(&self.slopes[i], &self.free);
            excess[i] += lengths[tendon] + grown - command.as_slice()[tendon];
        }
        let matrix = &mobility + DMatrix::identity(count, count) / STIFFNESS;
        let models = self.robot.tendons();
        let only_pulls = self
            .tendons
            .iter()
            .map(|&t| models[t].pull == Pull::TensionOnly);
        self.tensions = bounded(&matrix, &excess, &only_pulls.collect::<Vec<_>>());
        self.excess = excess - &mobility * &self.tensions;
        for (excess, tension) in self.excess.iter_mut().zip(self.tensions.iter()) {
            // To the last bit, what its tension stretches it by.
            *excess = if *tension == 0.0 {
                excess.min(0.0)
            } else {
                tension / STIFFNESS
            };
        }
        self.change.fill(Vector3::zeros());
        let pulls = (&self.tensions - &self.begun) * h;
        for (response, pull) in self.responses.iter().zip(pulls.iter()) {
            for (change, response) in self.change.iter_mut().zip(response) {
                *change -= response * *pull;
            }
        }
    }
}

/// The `x` that minimises `x' A x / 2 - b' x`, `A` positive definite, with those entries not negative that are `bounded`.
fn bounded(a: &DMatrix<f64>, b: &DVector<f64>, bounded: &[bool]) -> DVector<f64> {
    let count = b.len();
    let mut x = DVector::zeros(count);
    let mut free: Vec<bool> = bounded.iter().map(|bounded| !bounded).collect();
    for _ in 0..=3 * count {
        loop {
            let solved = solved_among(a, b, &free);
            let below = |i: &usize| bounded[*i] && free[*i] && solved[*i] <= 0.0;
            let Some(share) = (0..count)
                .filter(below)
                .map(|i| x[i] / (x[i] - solved[i]))
                .min_by(f64::total_cmp)
            else {
                x = solved;
                break;
            };
            let blocked: Vec<usize> = (0..count).filter(below).collect();
            x += (&solved - &x) * share.max(0.0);
            // At least the one that the step ends at.
            for i in blocked {
                let ends = x[i] <= f64::EPSILON * solved[i].abs();
                if ends {
                    (x[i], free[i]) = (0.0, false);
                }
            }
        }
        let slope = b - a * &x;
        let next = (0..count).filter(|&i| !free[i] && slope[i] > ROUNDING);
        match next.max_by(|&i, &j| slope[i].total_cmp(&slope[j])) {
            Some(next) => free[next] = true,
            None => break,
        }
    }
    x
}

/// The solution of `A x = b` among the entries that are `free`, the others 0; not a number where there is none.
fn solved_among(a: &DMatrix<f64>, b: &DVector<f64>, free: &[bool]) -> DVector<f64> {
    let places: Vec<usize> = (0..b.len()).filter(|&i| free[i]).collect();
    let matrix = DMatrix::from_fn(places.len(), places.len(), |i, j| a[(places[i], places[j])]);
    let right = DVector::from_fn(places.len(), |i, _| b[places[i]]);
    let solved = matrix.cholesky().map(|factor| factor.solve(&right));
    let mut x = DVector::zeros(b.len());
    for (k, &i) in places.iter().enumerate() {
        x[i] = solved.as_ref().map_or(f64::NAN, |solved| solved[k]);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bounded_minimum_has_no_slope_that_leads_on() {
        let a = DMatrix::from_row_slice(3, 3, &[4.0, 1.0, 0.5, 1.0, 3.0, -1.0, 0.5, -1.0, 2.0]);
        for (b, limits) in [
            ([1.0, -2.0, 3.0], [true; 3]),
            ([-1.0, 2.0, -3.0], [true, false, true]),
            ([-1.0, -2.0, -3.0], [true; 3]),
            ([1.0, 5.0, -1.5], [true, true, false]),
        ] {
            let b = DVector::from_column_slice(&b);
            let x = bounded(&a, &b, &limits);
            let slope = &b - &a * &x;
            for i in 0..3 {
                match limits[i] && x[i] == 0.0 {
                    true => assert!(slope[i] <= 1e-12, "{b} {x} {slope}"),
                    false => assert!(slope[i].abs() < 1e-12, "{b} {x} {slope}"),
                }
                assert!(!limits[i] || x[i] >= 0.0, "{x}");
            }
        }
        assert!(bounded(&(&a * f64::NAN), &DVector::zeros(3), &[true; 3]).len() == 3);
    }
}
