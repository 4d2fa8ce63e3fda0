//! Tendons whose length is commanded, whatever tension it takes.
//!
//! Such a tendon is a stiff spring, whose rest length is corrected after each solve until the tendon has its length: the
//! method of multipliers (augmented Lagrangian: Nocedal and Wright, Numerical Optimization, ch. 17.3), the tension being
//! the multiplier and the spring's stiffness the penalty.

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
