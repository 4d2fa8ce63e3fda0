//! Gradients of motions in which tendons rub in their holes, against differences of motions that are so near that contacts stick and
//! slip in them alike.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{DynamicsError, Integrator, Lineariser, Stepper, rollout_gradient};
use tdcr_sim::robot::{Drive, Fluid, Friction, Parameter, Robot, RobotSpec, ServoSpec};
use tdcr_sim::tendon_friction::SlipState;

use super::super::derivatives::random_rollout;
use super::super::without_kinks;
use super::case::{Case, TIMESTEP, assert_near};
use super::surroundings::{STEPS, assert_gradient, leaning, post};
use super::tangents::assert_adjoint;
use crate::random_robot::{Kind, random_hinged_spec, random_spec};

/// Differences are of a share of the usual steps.
const NEAR: f64 = 1e-3;

/// The robot with friction in all holes, unlike from tendon to tendon.
fn rough(mut spec: RobotSpec) -> RobotSpec {
    let mut coefficient = 0.1;
    for tendon in spec.tendon_specs_mut() {
        coefficient += 0.02;
        tendon.friction = Some(Friction {
            coefficient,
            contact_stiffness: 2e3,
        });
        if tendon.drive == Drive::Length && !tendon.stretches() {
            tendon.drive = Drive::Tension;
            tendon.range = [0.0, 5.0];
        }
    }
    spec
}

fn rough_standard(name: &str) -> Robot {
    Robot::new(rough(RobotSpec::standard(name).unwrap())).unwrap()
}

/// Random robots, with hinges and without, whose tendons pass every disc on their way.
fn random_rough(count: usize, rng: &mut ChaCha8Rng) -> Vec<Robot> {
    let mut robots = Vec::new();
    while robots.len() < count {
        let mut spec = match robots.len() % 2 {
            0 => random_spec(Kind::Elastic, rng),
            _ => random_hinged_spec(Kind::Elastic, rng),
        };
        spec.routes.clear();
        let robot = without_kinks(&Robot::new(rough(spec)).unwrap());
        // Loads of random motions are on the fourth disc, too.
        let fits = robot.discs().len() > 3 && !robot.tendons().is_empty();
        if fits && Stepper::new(&robot, TIMESTEP, Integrator::SemiImplicitEuler).is_ok() {
            robots.push(robot);
        }
    }
    robots
}

/// How many contacts stick, slip to the servo and to the end after the steps of a motion.
fn contacts(case: &Case) -> [usize; 3] {
    let robot = Robot::new(case.spec.clone()).unwrap();
    let mut stepper = Stepper::new(&robot, TIMESTEP, Integrator::SemiImplicitEuler).unwrap();
    let mut state = case.rollout.start.clone();
    let mut counts = [0; 3];
    for command in &case.rollout.commands {
        (stepper.step(&mut state, command, &case.rollout.loads)).unwrap();
        for slip in stepper
            .tendon_profiles()
            .iter()
            .flat_map(|own| &own.slip_states)
        {
            counts[match slip {
                SlipState::Sticks => 0,
                SlipState::SlipsToServo => 1,
                SlipState::SlipsToEnd => 2,
            }] += 1;
        }
    }
    counts
}

#[test]
fn gradients_are_differences_of_motions_for_robots_of_all_kinds() {
    let mut rng = ChaCha8Rng::seed_from_u64(61);
    let mut counts = [0; 3];
    for (number, robot) in random_rough(6, &mut rng).iter().enumerate() {
        let case = Case::random(robot, STEPS, &mut rng);
        for (sum, own) in counts.iter_mut().zip(contacts(&case)) {
            *sum += own;
        }
        assert_gradient(&case, (1, NEAR), &format!("robot {number}"));
    }
    assert!(counts.iter().all(|count| *count > 100), "{counts:?}");
}

#[test]
fn tangents_are_what_gradients_are_the_adjoints_of() {
    let mut rng = ChaCha8Rng::seed_from_u64(62);
    for (number, robot) in random_rough(4, &mut rng).iter().enumerate() {
        let case = Case::random(robot, 8, &mut rng);
        assert_adjoint(&case, &mut rng, &format!("robot {number}"));
    }
}

#[test]
fn they_are_so_among_obstacles_and_in_a_fluid() {
    let mut rng = ChaCha8Rng::seed_from_u64(63);
    let case = leaning(&rough_standard("2m"), &post(0.3), (80, TIMESTEP));
    assert_gradient(&case, (4, NEAR), "post");
    assert_adjoint(&case, &mut rng, "post");
    let mut spec = rough(RobotSpec::standard("2m").unwrap());
    spec.fluid = Some(Fluid {
        density: 998.0,
        drag_coefficient: 1.1,
    });
    let case = leaning(&Robot::new(spec).unwrap(), &post(0.3), (80, TIMESTEP));
    assert_gradient(&case, (5, NEAR), "post in a fluid");
}

#[test]
fn they_are_so_behind_late_servos() {
    let mut spec = rough(RobotSpec::standard("2m").unwrap());
    for tendon in spec.tendon_specs_mut() {
        tendon.servo = Some(ServoSpec {
            lag: 0.01,
            ..ServoSpec::default()
        });
    }
    let mut rng = ChaCha8Rng::seed_from_u64(64);
    let case = Case::random(&without_kinks(&Robot::new(spec).unwrap()), STEPS, &mut rng);
    assert_gradient(&case, (4, NEAR), "late");
}

/// Friction that is all but none changes nothing.
#[test]
fn the_gradient_tends_to_that_without_friction() {
    let mut rng = ChaCha8Rng::seed_from_u64(65);
    let smooth = without_kinks(&Robot::new(RobotSpec::standard("2m").unwrap()).unwrap());
    let mut case = Case::random(&smooth, STEPS, &mut rng);
    let without = case.gradient(&[]);
    case.spec = smooth.spec().clone();
    for tendon in case.spec.tendon_specs_mut() {
        tendon.friction = Some(Friction {
            coefficient: 1e-9,
            contact_stiffness: 1e4,
        });
    }
    let with = case.gradient(&[]);
    for (found, expected) in with.start.iter().zip(&without.start) {
        assert_near(*found, *expected, 1e-4, "start");
    }
    for (found, expected) in with.commands.concat().iter().zip(without.commands.concat()) {
        assert_near(*found, expected, 1e-4, "commands");
    }
}

#[test]
fn a_step_alone_is_not_linearised_as_its_state_has_no_deflections() {
    match Lineariser::new(&rough_standard("2m"), TIMESTEP).err() {
        Some(DynamicsError::Underivable { what, .. }) => {
            assert!(what.contains("friction of tendons"), "{what}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_coefficient_of_0_has_no_derivative() {
    let mut spec = rough(RobotSpec::standard("2m").unwrap());
    if let Some(friction) = spec.modules[0]
        .tendons
        .as_mut()
        .and_then(|own| own.friction.as_mut())
    {
        friction.coefficient = 0.0;
    }
    let robot = Robot::new(spec).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(66);
    let rollout = random_rollout(&robot, 2, &mut rng);
    let mut stepper = Stepper::new(&robot, TIMESTEP, Integrator::SemiImplicitEuler).unwrap();
    let states = stepper.rollout(&rollout).unwrap();
    let by = |tendon: usize| {
        let parameters = [Parameter::Friction(tendon)];
        rollout_gradient(
            &robot,
            TIMESTEP,
            &rollout,
            &states,
            &parameters,
            |_, _, _| {},
        )
    };
    let refused = by(0).unwrap_err().to_string();
    assert!(
        refused.contains("`friction[0]`") && refused.contains("coefficient is 0"),
        "{refused}"
    );
    assert!(by(3).is_ok());
}
