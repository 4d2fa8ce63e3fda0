//! Rods that lean on something, beside the closed forms of beams.

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_sim::contact::{ContactEquilibrium, ContactSettler};
use tdcr_sim::geometry::{Bead, Beads};
use tdcr_sim::robot::{Loads, Robot, RobotSpec};
use tdcr_sim::scene::{Obstacle, Scene};

use super::rod::{Rod, TipLoad};

/// Radius of the beads, one on each disc (m).
const BEAD: f64 = 0.002;

/// A rod of 1 N m² and 1 m along x, whose weight is `q` (N/m).
fn lying(weight: f64, discs: usize) -> Robot {
    let rod = Rod {
        line_density: weight / 9.81,
        gravity: [0.0, 0.0, -9.81],
        ..Rod::unit()
    };
    let mut spec: RobotSpec = rod.chain(discs).spec().clone();
    let turned = UnitQuaternion::rotation_between(&Vector3::z(), &Vector3::x()).unwrap();
    spec.base.orientation = [turned.w, turned.i, turned.j, turned.k];
    Robot::new(spec).unwrap()
}

fn settle(robot: &Robot, loads: &Loads, obstacles: Vec<Obstacle>) -> ContactEquilibrium {
    let beads = (0..robot.discs().len()).map(|disc| Bead {
        disc,
        centre: Vector3::zeros(),
        radius: BEAD,
        along_rod: 0.0,
    });
    let scene = Scene::new(obstacles).unwrap();
    let mut settler = ContactSettler::with_beads(robot, &scene, Beads::of(robot, beads));
    let found = settler.settle(&robot.command(&[]).unwrap(), loads).unwrap();
    assert!(
        found.equilibrium.converged,
        "{:e} N m",
        found.equilibrium.residual
    );
    found.clone()
}

/// Sum of the contacts' forces along an axis (N).
fn support(found: &ContactEquilibrium, axis: usize) -> f64 {
    found
        .contacts
        .iter()
        .map(|contact| contact.force[axis])
        .sum()
}

/// A clamped beam of weight `q` whose tip is propped at the height of the clamp: the prop bears `3 q L / 8`.
#[test]
fn a_prop_bears_three_eighths_of_a_cantilever() {
    let weight = 0.05;
    let error = |discs: usize| {
        let robot = lying(weight, discs);
        let prop = Obstacle::sphere("prop", 0.01).unwrap();
        let prop = prop
            .at([1.0, 0.0, -0.01 - BEAD])
            .with_compliance(1e-8)
            .unwrap();
        let found = settle(&robot, &Loads::default(), vec![prop]);
        assert!(
            found
                .contacts
                .iter()
                .all(|contact| contact.disc + 1 == discs)
        );
        (support(&found, 2) / (3.0 * weight / 8.0) - 1.0).abs()
    };
    let errors = [25, 50, 100].map(error);
    assert!(
        errors[0] < 2e-3 && errors[2] < 2e-4 && errors[2] < errors[0] / 8.0,
        "{errors:?}"
    );
}

/// A clamped beam of weight `q` sags onto a floor that is `h` below: it leaves the floor at a distance `a` from the clamp where its
/// curvature is 0, `a⁴ = 72 EI h / q`, and there the floor bears `q a / 3` at once. So it bears `q (L - 2 a / 3)` in all.
#[test]
fn a_heavy_cantilever_lies_down_on_a_floor() {
    let (weight, drop) = (4.0, 0.003);
    let free = (72.0_f64 * drop / weight).powf(0.25);
    let error = |discs: usize| {
        let robot = lying(weight, discs);
        let floor = Obstacle::half_space("floor").at([0.0, 0.0, -drop - BEAD]);
        let found = settle(&robot, &Loads::default(), vec![floor]);
        (support(&found, 2) / (weight * (1.0 - 2.0 * free / 3.0)) - 1.0).abs()
    };
    let errors = [25, 50, 100].map(error);
    assert!(
        errors[0] < 2e-3 && errors[2] < 2e-4 && errors[2] < errors[0] / 8.0,
        "{errors:?}"
    );
}

/// A column above Euler's load leans with its tip against the tube around it: with `k² = P / EI`, clearance `d` and the tip free to
/// turn, the wall bears `d P k / (k L - tan k L)`.
#[test]
fn a_buckled_column_leans_on_the_tube_around_it() {
    let clearance = 0.002;
    let critical = std::f64::consts::PI.powi(2) / 4.0;
    let load: f64 = 1.5 * critical;
    let k = load.sqrt();
    let wall = clearance * load * k / (k - k.tan());
    let error = |discs: usize| {
        let robot = Rod::unit().chain(discs);
        let tube = Obstacle::pipe("tube", BEAD + clearance, 3.0).unwrap();
        // A side force that is small beside the wall's, so that the column does not stand on.
        let loads = TipLoad::force(1e-7, 0.0, -load).on(&robot);
        let found = settle(&robot, &loads, vec![tube]);
        let bears = support(&found, 0).hypot(support(&found, 1));
        (bears / wall - 1.0).abs()
    };
    let errors = [25, 50, 100].map(error);
    assert!(
        errors[0] < 2e-3 && errors[2] < 2e-4 && errors[2] < errors[0] / 8.0,
        "{errors:?}"
    );
}
