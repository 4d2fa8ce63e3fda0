//! A lever on a spring that a force presses over to the other side and back, beside the closed form of its branches.

use nalgebra::Vector3;
use tdcr_sim::contact::BranchPath;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;

use super::rod::{Rod, TipLoad};

/// Stiffness of the spring (N m/rad), length of the lever (m) and weight on its tip (N), under which it leans over.
const STIFFNESS: f64 = 1.0;
const LENGTH: f64 = 0.5;
const WEIGHT: f64 = 3.0;

/// The lever: one joint in the middle of a rod of 1 m that bends about y alone.
fn lever() -> Robot {
    let rod = Rod {
        stiffness: Vector3::new(1e3, STIFFNESS, 1e3),
        ..Rod::unit()
    };
    rod.chain(1)
}

/// Force across (N) under which the lever rests at an angle (rad): `c a = L (W sin a + F cos a)`.
fn force(angle: f64) -> f64 {
    (STIFFNESS * angle / LENGTH - WEIGHT * angle.sin()) / angle.cos()
}

/// Where that is least: the end of the branch of levers that lean to the one side (rad), by bisection of its derivative.
fn end_of_branch() -> f64 {
    let slope = |angle: f64| force(angle + 1e-5) - force(angle - 1e-5);
    let (mut low, mut high) = (0.6, 1.5);
    assert!(slope(low) < 0.0 && slope(high) > 0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match slope(middle) < 0.0 {
            true => low = middle,
            false => high = middle,
        }
    }
    0.5 * (low + high)
}

/// The angle of the branch that leans to the side of `side` under a force (rad), by bisection.
fn angle_under(across: f64, side: f64) -> f64 {
    let (mut low, mut high) = (end_of_branch(), 1.57);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match force(middle) < side * across {
            true => low = middle,
            false => high = middle,
        }
    }
    side * 0.5 * (low + high)
}

/// Leads a lever along forces across; under each, its angle (rad) and the snaps so far.
fn follow(forces: impl IntoIterator<Item = f64>) -> Vec<[f64; 2]> {
    let robot = lever();
    let mut path = BranchPath::new(&robot, &Scene::default());
    let command = robot.command(&[]).unwrap();
    let at = |across: f64| {
        let loads = TipLoad::force(across, 0.0, -WEIGHT).on(&robot);
        let found = path.advance(&command, &loads).unwrap();
        assert!(found.equilibrium.converged);
        let tip = found.equilibrium.positions[0];
        assert!(tip.y.abs() < 1e-9);
        let angle = (tip.x / LENGTH).atan2((tip.z - LENGTH) / LENGTH);
        [angle, path.snaps() as f64]
    };
    forces.into_iter().map(at).collect()
}

#[test]
fn a_lever_snaps_over_where_its_branch_ends_and_stays_until_the_other_does() {
    let least = force(end_of_branch());
    assert!(least < -1.0);
    let out = (-15..=10).rev().map(|part| 0.1 * f64::from(part));
    let back = (-14..=15).map(|part| 0.1 * f64::from(part));
    let forces: Vec<f64> = out.chain(back).collect();
    let (mut side, mut snaps) = (1.0, 0.0);
    for (across, [angle, counted]) in forces.iter().zip(follow(forces.clone())) {
        if side * across < least {
            side = -side;
            snaps += 1.0;
        }
        assert_eq!(counted, snaps, "{across} N");
        let expected = angle_under(*across, side);
        assert!(
            (angle - expected).abs() < 1e-8,
            "{across} N: {angle} {expected}"
        );
    }
    assert_eq!(snaps, 2.0);
}

/// To a thousandth of the force at which the branch ends, from however far.
#[test]
fn a_snap_is_found_where_the_branch_ends_in_steps_however_long() {
    let least = force(end_of_branch());
    let [[_, before], [_, beyond]] = [0.999, 1.001].map(|part| follow([1.0, part * least])[1]);
    assert_eq!((before, beyond), (0.0, 1.0));
}
