//! How the coordinates of a joint after a step change with those before, and with the step.

use nalgebra::{Matrix3, Vector3};

use crate::robot::Hinges;

/// What a change of a joint's coordinates at the start of a `step` (rad) of them, and one of the step, are at its end: for a ball joint
/// [`turn_jacobians`].
pub(super) fn step_jacobians(
    hinges: Option<&Hinges>,
    step: &Vector3<f64>,
) -> (Matrix3<f64>, Matrix3<f64>) {
    match hinges {
        None => turn_jacobians(step),
        Some(hinges) => {
            let present = Matrix3::from_diagonal(&hinges.present());
            (present, present)
        }
    }
}

/// `exp(-turn)`, and the right Jacobian of the exponential map at `turn`: what a change of the
/// start, and of the turn, are in the frame at the end (Sola et al., A micro Lie theory, eq. 143).
pub(super) fn turn_jacobians(turn: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let squared = turn.norm_squared();
    // sin(t)/t, (1 - cos(t))/t², (t - sin(t))/t³.
    let [sine, versine, rest] = if squared < 1e-3 {
        [
            1.0 - squared / 6.0 * (1.0 - squared / 20.0 * (1.0 - squared / 42.0)),
            0.5 - squared / 24.0 * (1.0 - squared / 30.0 * (1.0 - squared / 56.0)),
            1.0 / 6.0 - squared / 120.0 * (1.0 - squared / 42.0 * (1.0 - squared / 72.0)),
        ]
    } else {
        let angle = squared.sqrt();
        let (sin, cos) = angle.sin_cos();
        [
            sin / angle,
            (1.0 - cos) / squared,
            (angle - sin) / (squared * angle),
        ]
    };
    let cross = turn.cross_matrix();
    let square = cross * cross;
    (
        Matrix3::identity() - cross * sine + square * versine,
        Matrix3::identity() - cross * versine + square * rest,
    )
}
