//! A tendon parallel to the rod bends it into an arc of a circle.

use nalgebra::Vector3;

use super::convergence::{assert_order, errors};
use super::rod::{Parallel, Rod, TipLoad};

fn pulled() -> Rod {
    Rod {
        length: 0.4,
        stiffness: Vector3::new(0.01, 0.01, 0.01 / 1.3),
        tendons: vec![Parallel {
            hole: [0.01, 0.0],
            end: 0.4,
            tension: 3.0,
        }],
        ..Rod::unit()
    }
}

#[test]
fn a_parallel_tendon_bends_a_rod_with_constant_curvature() {
    let rod = pulled();
    // kappa = T r / (E I).
    let curvature = 3.0;
    let (sin, cos) = (curvature * rod.length).sin_cos();
    let arc = Vector3::new(1.0 - cos, 0.0, sin) / curvature;
    assert!((rod.continuous_tip(&TipLoad::none()) - arc).norm() < 1e-9);
    let error = |n| (rod.tip(n, &TipLoad::none()) - arc).norm();
    assert_order(2.0, errors(20, error), 5e-4);
}

/// The tendon's straight piece over a joint turned by `theta` is `h cos(theta/2) - 2 r sin(theta/2)`
/// long, so `E I / h theta = T (h/2 sin(theta/2) + r cos(theta/2))`.
#[test]
fn a_parallel_tendon_turns_every_joint_of_a_chain_alike() {
    let rod = pulled();
    for discs in [3, 10, 40] {
        let robot = rod.chain(discs);
        let settled = rod.settle(&robot, &TipLoad::none().on(&robot));
        let pitch = rod.length / discs as f64;
        for q in &settled.configuration.0 {
            let turn = q.scaled_axis();
            let theta = turn.y;
            let (sin, cos) = (0.5 * theta).sin_cos();
            let pull = 3.0 * (0.5 * pitch * sin + 0.01 * cos);
            assert!(
                (0.01 / pitch * theta - pull).abs() < 1e-9,
                "{discs} discs: {turn}"
            );
            assert!(turn.xz().norm() < 1e-9);
        }
        let length = discs as f64 * {
            let (sin, cos) = (0.5 * settled.configuration.0[0].angle()).sin_cos();
            pitch * cos - 0.02 * sin
        };
        assert!((settled.tendon_lengths[0] - length).abs() < 1e-9);
    }
}
