//! Tendons whose length is commanded, whatever tension it takes.
//!
//! Such a tendon is a stiff spring, whose rest length is corrected after each solve until the tendon has its length: the
//! method of multipliers (augmented Lagrangian: Nocedal and Wright, Numerical Optimization, ch. 17.3), the tension being
//! the multiplier and the spring's stiffness the penalty.

use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::Vector3;

use crate::energy::Expansion;
use crate::robot::Robot;

/// Corrections of the rest lengths before a solve counts as failed.
pub(crate) const MAX_CORRECTIONS: usize = 60;

/// By how much each taut tendon whose length is commanded is longer than `goal` says (tendon, m); `None`
/// if that is within the `tolerance` for all. `state` is the length (m) and the tension (N) of a tendon.
/// Where one is slack, its rest length is set to the length commanded.
pub(crate) fn length_errors(
    robot: &Robot,
    goal: &[f64],
    tolerance: f64,
    rest: &mut [f64],
    state: impl Fn(usize) -> (f64, f64),
) -> Option<Vec<(usize, f64)>> {
    let mut errors = Vec::new();
    for (t, tendon) in robot.tendons().iter().enumerate() {
        if tendon.holds_length() {
            let (length, tension) = state(t);
            let error = length - goal[t];
            if error < 0.0 && tension == 0.0 {
                rest[t] = goal[t];
            } else {
                errors.push((t, error));
            }
        }
    }
    (errors.iter().any(|(_, error)| error.abs() > tolerance)).then_some(errors)
}

/// Moves the rest lengths of tendons that are longer than they should be by `errors` (tendon, m), such that to first order the errors
/// vanish at the equilibrium that follows: Newton's step on the dual problem, whose unknowns are the tensions (Nocedal and Wright,
/// Numerical Optimization, ch. 17). `solve` writes the turns that moments on the joints make.
pub(crate) fn correct_rest_lengths(
    expansion: &Expansion,
    errors: &[(usize, f64)],
    rest: &mut [f64],
    mut solve: impl FnMut(&[Vector3<f64>], &mut [Vector3<f64>]),
) {
    let columns = expansion.dense_columns();
    let mut turns = vec![Vector3::zeros(); expansion.joint_blocks.len()];
    // How much each length grows for each tendon's pull (m/N).
    let mut compliance = Mat::zeros(errors.len(), errors.len());
    for (j, (pulled, _)) in errors.iter().enumerate() {
        solve(&columns[*pulled].1, &mut turns);
        for (i, (tendon, _)) in errors.iter().enumerate() {
            let growth = columns[*tendon].1.iter().zip(&turns);
            compliance[(i, j)] = growth.map(|(a, w)| a.dot(w)).sum::<f64>();
        }
    }
    let wanted = Mat::from_fn(errors.len(), 1, |i, _| errors[i].1);
    let pulls = compliance.partial_piv_lu().solve(&wanted);
    for (i, (tendon, _)) in errors.iter().enumerate() {
        rest[*tendon] -= pulls[(i, 0)] / expansion.weights[*tendon];
    }
}
