//! The smallest stiffness against dense matrices.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use faer::{Mat, Side};
use nalgebra::{UnitQuaternion, Vector3};

use super::*;
use crate::chain::Configuration;
use crate::energy::following::jacobian;
use crate::robot::{Drive, Frame, RobotSpec, Wrench};

/// A standard robot with so many modules, under a command some way from its mean.
fn bent_robot(name: &str, modules: usize, share: f64, held: bool) -> (Robot, Command) {
    let mut spec = RobotSpec::standard(name).unwrap();
    let last = spec.modules[spec.modules.len() - 1].clone();
    spec.modules.resize(modules, last);
    let free = Robot::new(spec.clone()).unwrap();
    let values: Vec<f64> = (free.tendons().iter().enumerate())
        .map(|(t, tendon)| {
            let [low, high] = tendon.range;
            let part = 0.5 + share * (1.7 * t as f64 + share).sin();
            low + (high - low) * part.clamp(0.0, 1.0)
        })
        .collect();
    let command = free.command(&values).unwrap();
    if !held {
        return (free, command);
    }
    let lengths = free.settle(&command, &Loads::default()).tendon_lengths;
    for tendons in spec.modules.iter_mut().flat_map(|m| &mut m.tendons) {
        (tendons.drive, tendons.range) = (Drive::Length, [0.0, 10.0]);
    }
    let robot = Robot::new(spec).unwrap();
    let command = robot.command(&lengths).unwrap();
    (robot, command)
}

/// The Jacobian, dense, on an orthonormal basis of the turns that keep the lengths of the tendons that hold them.
fn reduced(robot: &Robot, loads: &Loads, posture: &Posture, expansion: &Expansion) -> Mat<f64> {
    let dense = jacobian(loads, 1.0, posture, expansion);
    let held: Vec<usize> = (0..robot.tendons().len())
        .filter(|t| robot.tendons()[*t].holds_length())
        .collect();
    if held.is_empty() {
        return dense;
    }
    let columns = expansion.dense_columns();
    let gradients = Mat::from_fn(dense.nrows(), held.len(), |row, column| {
        columns[held[column]].1[row / 3][row % 3]
    });
    let svd = gradients.svd().unwrap();
    // Of a straight module the lengths depend on each other.
    let sizes = svd.S().column_vector();
    let count = held.len().min(dense.nrows());
    let rank = (0..count).filter(|&i| sizes[i] > 1e-10 * sizes[0]).count();
    let free = svd.U().subcols(rank, dense.nrows() - rank);
    free.transpose() * &dense * free
}

/// Poses from straight to strongly bent, in equilibrium or not: the Hessian is positive definite in some and not in others.
#[test]
fn the_smallest_stiffness_in_o_n_is_that_of_the_dense_hessian() {
    let mut signs = [0; 2];
    for (name, modules) in [("2m", 1), ("2m", 2), ("5m", 5), ("5m", 12)] {
        for (place, payload) in [0.0, 0.03, 0.5, 20.0].into_iter().enumerate() {
            let share = 0.2 * place as f64;
            for held in [false, true] {
                let (robot, command) = bent_robot(name, modules, share, held);
                let loads = Loads::payload(payload).unwrap();
                let settled = robot.settle(&command, &loads);
                // Tendons that hold lengths which cannot be held pull without bounds.
                if held && !settled.converged {
                    continue;
                }
                let bent = (0..robot.discs().len()).map(|disc| {
                    let turn = Vector3::new(0.3, -0.2, 0.1) * (share * (disc as f64).cos());
                    UnitQuaternion::from_scaled_axis(turn)
                });
                let thrown = Equilibrium {
                    configuration: Configuration(bent.collect()),
                    ..settled.clone()
                };
                for pose in [&settled, &thrown] {
                    let (posture, expansion) = robot.expanded(&command, &loads, pose);
                    let dense = reduced(&robot, &loads, &posture, &expansion);
                    let expected = dense.self_adjoint_eigenvalues(Side::Lower).unwrap()[0];
                    let found = robot.smallest_stiffness(&command, &loads, pose);
                    // Tensions of held tendons are known to what their springs resolve.
                    let share = if held { 1e-6 } else { 1e-9 };
                    let rounding = 1e-12 * expansion.scale();
                    assert!(
                        (found - expected).abs() <= share * expected.abs() + rounding,
                        "{name}, {modules} modules, {payload} kg, {held}: {found:e}, not {expected:e}"
                    );
                    signs[usize::from(expected > 0.0)] += 1;
                }
            }
        }
    }
    assert!(signs.iter().all(|count| *count > 3), "{signs:?}");
}

/// The same under moments and forces that turn with their disc, from weak to strong.
#[test]
fn the_smallest_stiffness_under_following_loads_is_that_of_the_dense_jacobian() {
    let mut signs = [0; 2];
    for (name, modules) in [("2m", 1), ("2m", 2), ("5m", 5), ("5m", 12)] {
        for (place, size) in [1e-3, 0.05, 0.5].into_iter().enumerate() {
            for (frame, held) in [
                (Frame::World, false),
                (Frame::Disc, false),
                (Frame::Disc, true),
            ] {
                let share = 0.2 * place as f64;
                let (robot, command) = bent_robot(name, modules, share, held);
                let n = robot.discs().len();
                let tip = Wrench {
                    force: [0.3 * size, size, -4.0 * size],
                    moment: [0.02 * size, 0.1 * size, 0.05 * size],
                    ..Wrench::none(n - 1, frame)
                };
                let middle = Wrench {
                    moment: [0.1 * size, 0.0, 0.0],
                    ..Wrench::none(n / 2, Frame::World)
                };
                let loads = Loads::default().with_wrench(tip).unwrap();
                let loads = loads.with_wrench(middle).unwrap();
                let settled = robot.settle(&command, &loads);
                let (posture, expansion) = robot.expanded(&command, &loads, &settled);
                let dense = reduced(&robot, &loads, &posture, &expansion);
                let values = dense.eigenvalues().unwrap();
                let expected = values
                    .iter()
                    .fold(f64::INFINITY, |least, value| least.min(value.re));
                let found = robot.smallest_stiffness(&command, &loads, &settled);
                let rounding = 1e-9 * expansion.scale();
                assert!(
                    (found - expected).abs() <= 1e-6 * expected.abs() + rounding,
                    "{name}, {modules} modules, {size}, {frame:?}, {held}: {found:e}, not {expected:e}"
                );
                signs[usize::from(expected > 0.0)] += 1;
            }
        }
    }
    assert!(signs[1] > 10, "{signs:?}");
}
