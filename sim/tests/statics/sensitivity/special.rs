//! Poses and robots where derivatives are easily wrong.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{
    Backbone, Body, Drive, Holes, Loads, MassSpec, Parameter, PerDisc, Pull, Robot, RobotSpec,
    RodDamping, RodSpec, SolidMass, Waypoint,
};

use super::case::{Case, assert_derivatives_agree, derivatives_agree, own_routes};
use crate::random_robot::within;

/// The 3m robot, hanging or on a backbone, every tendon on its own route.
fn changed(change: impl Fn(&mut RobotSpec)) -> RobotSpec {
    let mut spec = RobotSpec::standard("3m").unwrap();
    spec.gravity[2] = 9.81;
    change(&mut spec);
    own_routes(&Robot::new(spec).unwrap())
}

#[test]
fn they_are_so_at_the_straight_pose() {
    let case = Case {
        spec: changed(|_| {}),
        command: vec![0.02; 9],
        loads: Loads::payload(0.01).unwrap(),
    };
    let robot = Robot::new(case.spec.clone()).unwrap();
    let settled = robot.settle(&robot.command(&case.command).unwrap(), &case.loads);
    assert!(
        settled.positions[14].xy().norm() < 1e-5,
        "the case is straight"
    );
    // A residual of 1e-13 N m over the softest mode's 1e-3 N m/rad, at an arm of 0.2 m.
    assert!(derivatives_agree(&case, "straight", 2e-11), "it settles");
}

#[test]
fn they_are_so_where_a_tendon_crosses_a_disc() {
    let mut spec = changed(|spec| {
        for module in &mut spec.modules {
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
        }
    });
    let across = [Waypoint(Body::Disc(4), 1), Waypoint(Body::Disc(4), 2)];
    spec.routes[0].through.extend(across);
    let case = Case {
        spec,
        command: vec![0.02, 0.01, 0.03, 0.005, 0.02, 0.02, 0.04, 0.01, 0.02],
        loads: Loads::payload(0.01).unwrap(),
    };
    assert_derivatives_agree(&case, "across");
}

#[test]
fn they_are_so_with_a_rod_and_centres_of_mass_off_the_origin() {
    let spec = changed(|spec| {
        spec.gravity = [3.0, -2.0, -9.0];
        for (m, module) in spec.modules.iter_mut().enumerate() {
            let off = [0.002, -0.001, 0.003];
            let centre_of_mass = if m == 2 { off } else { [0.0, 0.0, -0.002] };
            module.clocking = 0.3 * m as f64;
            module.mass = MassSpec::Solid(PerDisc::Uniform(SolidMass {
                density: 300.0,
                centre_of_mass,
            }));
            module.joint_below = 0.006;
            module.rod = (m < 2).then_some(RodSpec {
                youngs: 60e9,
                poisson: 0.3,
                radius: 6e-4,
                density: 7870.0,
                damping: RodDamping::default(),
            });
            module.backbone = (m == 2).then_some(PerDisc::Uniform(Backbone::isotropic(0.4)));
        }
    });
    let case = Case {
        spec,
        command: vec![0.02, 0.01, 0.03, 0.005, 0.02, 0.02, 0.04, 0.01, 0.02],
        loads: Loads::payload(0.01).unwrap(),
    };
    assert_derivatives_agree(&case, "rod");
    let robot = Robot::new(case.spec.clone()).unwrap();
    let error = case
        .spec
        .value(Parameter::Torsion(0))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("the module's rod, which has a Young's modulus"),
        "{error}"
    );
    let stiffer = case.spec.with(&[(Parameter::Youngs(1), 70e9)]).unwrap();
    assert_eq!(stiffer.modules[1].rod.unwrap().youngs, 70e9);
    assert_eq!(robot.spec().modules[1].rod.unwrap().youngs, 60e9);
}

#[test]
fn they_are_so_with_slack_tendons() {
    let spec = changed(|spec| {
        for module in &mut spec.modules {
            let tendons = module.tendons.as_mut().unwrap();
            tendons.pull = Pull::TensionOnly;
            tendons.range = [0.0, 0.2];
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.1)));
        }
    });
    let case = Case {
        spec,
        command: vec![0.03, 0.2, 0.2, 0.2, 0.02, 0.2, 0.2, 0.2, 0.04],
        loads: Loads::payload(0.01).unwrap(),
    };
    let robot = Robot::new(case.spec.clone()).unwrap();
    let command = robot.command(&case.command).unwrap();
    let settled = robot.settle(&command, &case.loads);
    let slack = settled
        .tendon_tensions
        .iter()
        .filter(|t| **t == 0.0)
        .count();
    assert_eq!(slack, 6);
    let sensitivity = robot.sensitivity(&command, &case.loads, &settled).unwrap();
    assert_eq!(sensitivity.command_jacobian().column(1).amax(), 0.0);
    assert_derivatives_agree(&case, "slack");
}

#[test]
fn they_are_so_with_coincident_holes() {
    // All three tendons of a module through one hole, and one more through the joints' centres, where
    // its segments never change.
    let spec = changed(|spec| {
        let holes = vec![[0.0125, 0.0], [0.0125, 0.0], [0.0125, 0.0], [0.0, 0.0]];
        spec.base.holes = Holes::At(holes.clone());
        for module in &mut spec.modules {
            module.holes = Holes::At(holes.clone());
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.3)));
        }
    });
    let case = Case {
        command: vec![0.02; 12],
        spec,
        loads: Loads::payload(0.01).unwrap(),
    };
    let robot = Robot::new(case.spec.clone()).unwrap();
    let command = robot.command(&case.command).unwrap();
    let settled = robot.settle(&command, &case.loads);
    let jacobian = robot
        .sensitivity(&command, &case.loads, &settled)
        .unwrap()
        .command_jacobian();
    assert!(jacobian.iter().all(|x| x.is_finite()));
    assert!((jacobian.column(0) - jacobian.column(1)).amax() < 1e-12);
    assert_derivatives_agree(&case, "coincident");
}

#[test]
fn they_are_so_where_lengths_are_commanded() {
    let mut rng = ChaCha8Rng::seed_from_u64(35);
    let spec = changed(|spec| {
        for module in &mut spec.modules {
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
        }
        // Two tendons a module hold their length, so that the third can give way.
        spec.gravity = [0.3, -0.2, 5.0];
    });
    let mut spec = spec;
    for (t, route) in spec.routes.iter_mut().enumerate() {
        if t % 3 < 2 {
            route.tendon.drive = Drive::Length;
            route.tendon.range = [0.0, 0.2];
        }
    }
    let command: Vec<f64> = (0..9)
        .map(|t| match t % 3 {
            0 | 1 => within(0.073, 0.085, &mut rng) + if t < 3 { 0.008 } else { 0.0 },
            _ => rng.random::<f64>() * 0.04,
        })
        .collect();
    let loads = Loads::payload(0.01).unwrap();
    let case = Case {
        spec,
        command,
        loads,
    };
    assert!(derivatives_agree(&case, "lengths", 1e-10), "it settles");
}
