//! Rods under moments and forces that follow, in motion: it grows, or dies out, at the rates that statics name.

use nalgebra::Vector3;
use tdcr_sim::dynamics::{Growth, Integrator, State, Stepper};
use tdcr_sim::robot::{Frame, Loads, PerDisc, Robot};
use tdcr_sim::statics::{Equilibrium, Examined, Stability};

use super::rod::{Rod, TipLoad};
use super::spatial::strip;

/// Time step (s).
const STEP: f64 = 1e-3;

/// A rod's chain with damping (N m s/rad) in its joints, and where it rests.
fn damped(rod: &Rod, discs: usize, tip: &TipLoad, damping: f64) -> (Robot, Loads, Equilibrium) {
    let mut spec = rod.chain(discs).spec().clone();
    spec.modules[0].damping = PerDisc::Uniform(damping);
    let robot = Robot::new(spec).unwrap();
    let loads = tip.on(&robot);
    let settled = robot.settle(&robot.command(&[]).unwrap(), &loads);
    assert_eq!(settled.examined, Some(Examined::Motion));
    (robot, loads, settled)
}

/// How far (m) the discs are from their equilibrium at most in each of some `windows` (s), after a small push.
fn distances((robot, loads, settled): &(Robot, Loads, Equilibrium), windows: &[f64]) -> Vec<f64> {
    let command = robot.command(&[]).unwrap();
    let push: Vec<f64> = (0..robot.dof())
        .map(|k| 1e-9 * ((k * 7919 % 13) as f64 - 6.0))
        .collect();
    let mut state = State::straight(robot);
    (settled.configuration).retract(robot, &push, &mut state.configuration);
    let mut stepper = Stepper::new(robot, STEP, Integrator::ImplicitMidpoint).unwrap();
    let mut farthest = |seconds: f64| {
        let mut most: f64 = 0.0;
        for _ in 0..(seconds / STEP).round() as usize {
            stepper.step(&mut state, &command, loads).unwrap();
            let positions = state.positions(robot);
            let distances = positions.iter().zip(&settled.positions);
            most = distances
                .map(|(p, rest)| (p - rest).norm())
                .fold(most, f64::max);
        }
        most
    };
    windows.iter().map(|&seconds| farthest(seconds)).collect()
}

/// Under these wrenches a bent, twisted strip of little damping flutters, in either frame.
#[test]
fn a_strip_under_wrenches_swings_ever_wider_at_the_rate_that_is_said() {
    for frame in [Frame::World, Frame::Disc] {
        let tip = TipLoad {
            force: Vector3::new(1.2, 0.8, -0.5),
            moment: Vector3::new(-0.9, 1.4, 0.4),
            frame,
        };
        for discs in [10, 20] {
            let moving = damped(&strip(), discs, &tip, 0.1);
            let settled = &moving.2;
            assert_eq!(settled.stability, Some(Stability::Flutter));
            assert!(!settled.converged);
            let Growth {
                rate,
                angular_frequency,
                ..
            } = settled.growth.unwrap();
            // Whole swings, after all that dies out has.
            let swings = 2.0 * std::f64::consts::TAU / angular_frequency;
            let seen = distances(&moving, &[3.0 / rate, swings, swings]);
            let found = (seen[2] / seen[1]).ln() / swings;
            assert!(seen[2] < 1e-3, "{seen:?}");
            assert!(
                (found / rate - 1.0).abs() < 2e-3,
                "{frame:?}, {discs}: {found}, not {rate} 1/s"
            );
        }
    }
}

/// A rod that a moment bends into half a circle is stable. Its modes are far from orthogonal, so that a push grows more than
/// tenfold before it dies out.
#[test]
fn a_rod_that_a_moment_bends_comes_to_rest_after_a_push() {
    for frame in [Frame::World, Frame::Disc] {
        let tip = TipLoad {
            frame,
            ..TipLoad::moment(0.0, std::f64::consts::PI, 0.0)
        };
        let moving = damped(&Rod::unit(), 10, &tip, 0.1);
        assert_eq!(moving.2.stability, Some(Stability::Stable));
        let seen = distances(&moving, &[0.1, 2.0, 6.0, 2.0, 0.1]);
        assert!(
            seen[1] > 10.0 * seen[0] && seen[4] < 1e-3 * seen[0],
            "{frame:?}: {seen:?}"
        );
    }
}
