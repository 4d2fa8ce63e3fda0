//! Gradients of motions by everything that they depend on, against differences of motions.

mod by_obstacles;
mod case;
mod surroundings;
mod tangents;
mod tendon_friction;

use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{
    DynamicsError, Integrator, Lineariser, Rollout, State, Stepper, rollout_gradient,
};
use tdcr_sim::pose::{PoseTangent, joint_cotangent, rotation_cotangent};
use tdcr_sim::robot::{
    Backbone, Loads, MassSpec, Parameter, PerDisc, Robot, RobotSpec, RodDamping, RodSpec, SolidMass,
};

use super::derivatives::{inner_command, nudged, nudged_command};
use super::{all_loads, random_robots, random_state, without_kinks};
use crate::random_robot::within;
use case::{Case, TIMESTEP, assert_near, assert_parameters, orientations};
use tangents::assert_adjoint;

#[test]
fn gradients_by_parameters_are_differences_of_motions() {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    for (index, robot) in random_robots(6, &mut rng).iter().enumerate() {
        let robot = without_kinks(robot);
        let case = Case::random(&robot, 12, &mut rng);
        assert_parameters(&case, &format!("robot {index}"));
    }
}

#[test]
fn the_tangent_is_what_the_gradient_is_the_adjoint_of() {
    let mut rng = ChaCha8Rng::seed_from_u64(47);
    for (index, robot) in random_robots(6, &mut rng).iter().enumerate() {
        let case = Case::random(&without_kinks(robot), 8, &mut rng);
        assert_adjoint(&case, &mut rng, &format!("robot {index}"));
    }
}

#[test]
fn they_are_so_with_rods_whose_mass_the_pitch_moves() {
    let mut rng = ChaCha8Rng::seed_from_u64(42);
    let mut spec = RobotSpec::standard("3m").unwrap();
    for (m, module) in spec.modules.iter_mut().enumerate() {
        module.clocking = 0.3 * m as f64;
        module.mass = MassSpec::Solid(PerDisc::Uniform(SolidMass {
            density: 300.0,
            centre_of_mass: [0.0, 0.0, -0.002],
        }));
        module.joint_below = 0.006;
        module.rod = (m < 2).then_some(RodSpec {
            youngs: 60e9,
            poisson: 0.3,
            radius: 6e-4,
            density: 7870.0,
            damping: RodDamping {
                bending: 3e-3,
                torsion: 2e-3,
            },
        });
        module.backbone = (m == 2).then_some(PerDisc::Uniform(Backbone::isotropic(0.4)));
    }
    let robot = Robot::new(spec).unwrap();
    let case = Case::random(&robot, 12, &mut rng);
    assert_parameters(&case, "rods");
}

#[test]
fn gradients_by_start_and_commands_are_differences_of_motions() {
    let mut rng = ChaCha8Rng::seed_from_u64(43);
    let robot = without_kinks(&random_robots(1, &mut rng)[0]);
    let case = Case::random(&robot, 12, &mut rng);
    let gradient = case.gradient(&[]);
    let other = |rollout: Rollout| Case {
        spec: case.spec.clone(),
        rollout,
        weights: Vec::new(),
        scene: None,
    };
    for (index, found) in gradient.start.iter().enumerate() {
        let expected = case.numeric(1e-4, |by| {
            let start = nudged(&robot, &case.rollout.start, index, by);
            other(Rollout {
                start,
                ..case.rollout.clone()
            })
        });
        assert_near(*found, expected, 1e-4, "start");
    }
    for step in [0, 5, 11] {
        for (tendon, found) in gradient.commands[step].iter().enumerate() {
            let expected = case.numeric(1e-3, |by| {
                let mut moved = case.rollout.clone();
                let command = &mut moved.commands[step];
                *command = nudged_command(&robot, command, tendon, by);
                other(moved)
            });
            assert_near(*found, expected, 1e-3, "command");
        }
    }
}

/// Two ways to the same numbers, kinks included: each on the side where the state lies.
#[test]
fn the_adjoint_of_a_step_is_the_transpose_of_its_linearisation() {
    let mut rng = ChaCha8Rng::seed_from_u64(44);
    for robot in random_robots(30, &mut rng) {
        let rollout = Rollout {
            start: random_state(&robot, &mut rng),
            commands: vec![inner_command(&robot, &mut rng)],
            loads: all_loads(&robot, &mut rng),
            wrenches: Vec::new(),
        };
        let mut stepper = Stepper::new(&robot, TIMESTEP, Integrator::SemiImplicitEuler).unwrap();
        let states = stepper.rollout(&rollout).unwrap();
        let after: Vec<f64> = (0..2 * robot.dof())
            .map(|_| within(-1.0, 1.0, &mut rng))
            .collect();
        let gradient = rollout_gradient(
            &robot,
            TIMESTEP,
            &rollout,
            &states,
            &[],
            |k, _, cotangent| {
                if k == 1 {
                    cotangent.coordinates.copy_from_slice(&after);
                }
            },
        )
        .unwrap();
        let mut lineariser = Lineariser::new(&robot, TIMESTEP).unwrap();
        let linear = lineariser
            .linearise(&rollout.start, &rollout.commands[0], &rollout.loads)
            .unwrap();
        let after = nalgebra::DVector::from_vec(after);
        for (found, expected) in [
            (&gradient.start, linear.a.tr_mul(&after)),
            (&gradient.commands[0], linear.b.tr_mul(&after)),
        ] {
            let scale = expected.amax();
            for (found, expected) in found.iter().zip(&expected) {
                assert!(
                    (found - expected).abs() < 1e-10 * scale,
                    "{found} and {expected} of {scale}"
                );
            }
        }
    }
}

#[test]
fn derivatives_by_poses_become_those_by_joints() {
    let mut rng = ChaCha8Rng::seed_from_u64(45);
    for robot in random_robots(5, &mut rng) {
        let state = random_state(&robot, &mut rng);
        let n = robot.discs().len();
        // A cost of the origins and of the numbers of the discs' quaternions.
        let weights: Vec<[f64; 7]> = (0..n)
            .map(|_| std::array::from_fn(|_| within(-1.0, 1.0, &mut rng)))
            .collect();
        let cost = |state: &State| -> f64 {
            let places = state.positions(&robot);
            let poses = places.iter().zip(orientations(&robot, state));
            let of_disc = |(w, (p, q)): (&[f64; 7], (&Vector3<f64>, UnitQuaternion<f64>))| {
                let numbers = [p.x, p.y, p.z, q.w, q.i, q.j, q.k];
                w.iter().zip(numbers).map(|(w, x)| w * x).sum::<f64>()
            };
            weights.iter().zip(poses).map(of_disc).sum()
        };
        let cotangents: Vec<PoseTangent> = (weights.iter().zip(orientations(&robot, &state)))
            .map(|(&[x, y, z, a, b, c, d], q)| PoseTangent {
                position: Vector3::new(x, y, z),
                rotation: rotation_cotangent(&q, [a, b, c, d]),
            })
            .collect();
        let found = joint_cotangent(&robot, &state.configuration, &cotangents);
        assert_eq!(found.len(), robot.dof());
        for (index, found) in found.iter().enumerate() {
            let [up, down] = [1e-5, -1e-5].map(|by| cost(&nudged(&robot, &state, index, by)));
            let expected = (up - down) / 2e-5;
            assert!((found - expected).abs() < 1e-8, "{found} and {expected}");
        }
    }
}

#[test]
fn what_has_no_gradient_is_refused_with_the_reason() {
    let robot = Robot::load("2m").unwrap();
    let rollout = Rollout {
        start: State::straight(&robot),
        commands: vec![robot.mean_command(); 2],
        loads: Loads::default(),
        wrenches: Vec::new(),
    };
    let mut stepper = Stepper::new(&robot, TIMESTEP, Integrator::default()).unwrap();
    let states = stepper.rollout(&rollout).unwrap();
    let gradient = |rollout: &Rollout, states: &[State], parameters: &[Parameter]| {
        rollout_gradient(
            &robot,
            TIMESTEP,
            rollout,
            states,
            parameters,
            |_, _, cotangent| {
                cotangent.coordinates.fill(1.0);
            },
        )
    };
    let message = gradient(&rollout, &states, &[Parameter::Youngs(1)])
        .unwrap_err()
        .to_string();
    assert!(message.contains("the module has no rod"), "{message}");
    let message = gradient(&rollout, &states[1..], &[])
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "the list of states has 1 entries; robot `2m` needs 2"
    );
    let other = State::straight(&Robot::load("3m").unwrap());
    let elsewhere = [states[0].clone(), other];
    let message = gradient(&rollout, &elsewhere, &[]).unwrap_err().to_string();
    assert_eq!(
        message,
        "the configuration has 15 entries; robot `2m` needs 10"
    );
    let mut fast = rollout.clone();
    fast.start.velocity[4] = 1e200;
    assert_eq!(
        gradient(&fast, &states, &[]).unwrap_err(),
        DynamicsError::NotDifferentiable
    );
}
