//! Fast robots, thin walls, and starts that are none.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{DynamicsError, Integrator, State};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};

use super::{among, beads, scene};
use crate::random_robot::within;

#[test]
fn nothing_tunnels_through_a_thin_wall_at_high_speed() {
    let robot = Robot::load("2m").unwrap();
    let wall = Obstacle::cuboid("wall", [1e-3, 2.0, 2.0]).unwrap();
    let wall = Scene::new(vec![wall.at([0.06, 0.0, 0.5])]).unwrap();
    for integrator in [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler] {
        for speed in [1.0, 10.0, 30.0, 100.0] {
            let mut stepper = among(&robot, &wall, 2e-3, integrator);
            let mut state = State::straight(&robot);
            // Every joint turns towards the wall.
            for rate in state.velocity.as_chunks_mut::<3>().0 {
                *rate = [0.0, speed, 0.0];
            }
            let command = robot.mean_command();
            let mut touched = false;
            for step in 0..300 {
                if stepper
                    .step(&mut state, &command, &Loads::default())
                    .is_err()
                {
                    panic!("{integrator:?} {speed} rad/s: step {step}");
                }
                touched |= !stepper.contacts().is_empty();
                let farthest =
                    (beads(&stepper, &state).iter()).fold(0.0_f64, |most, bead| most.max(bead.x));
                assert!(
                    farthest < 0.06,
                    "{integrator:?} {speed} rad/s: {farthest} m"
                );
            }
            assert!(touched);
        }
    }
}

#[test]
fn ten_thousand_random_steps_stay_finite_and_outside() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let (mut deepest, mut touched, mut unsolved) = (0.0_f64, 0, 0);
    for number in 0..50 {
        let robot = Robot::load(["2m", "3m"][number % 2]).unwrap();
        let scene = scene(&mut rng, &robot);
        let rough = scene.obstacles().iter().map(|obstacle| {
            let friction = [0.0, 0.5][number / 2 % 2];
            obstacle.clone().with_friction(friction).unwrap()
        });
        let scene = Scene::new(rough.collect()).unwrap();
        let integrator = [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler][number / 4 % 2];
        let mut stepper = among(&robot, &scene, 2e-3, integrator);
        let mut state = State::straight(&robot);
        let mut command = robot.random_command(&mut rng);
        for step in 0..200 {
            if step % 20 == 0 {
                command = robot.random_command(&mut rng);
                (state.velocity.iter_mut()).for_each(|v| *v += within(-1.0, 1.0, &mut rng));
            }
            stepper
                .step(&mut state, &command, &Loads::default())
                .unwrap();
            assert!(state.is_finite());
            for contact in stepper.contacts() {
                assert!(contact.force.iter().all(|f| f.is_finite()));
                touched += 1;
                // A few start in an obstacle, and come out.
                if step > 20 {
                    deepest = deepest.max(-contact.gap);
                }
            }
        }
        unsolved += stepper.unsolved();
    }
    eprintln!("{touched} contacts, deepest {deepest:e} m, {unsolved} steps not to full precision");
    assert!(touched > 1000);
    assert!(deepest < 1e-3, "{deepest:e} m");
    assert!(unsolved < 10, "{unsolved}");
}

#[test]
fn a_state_that_is_no_state_ends_with_an_error() {
    let robot = Robot::load("2m").unwrap();
    let ball = Obstacle::sphere("ball", 0.05).unwrap().at([0.0, 0.0, 0.3]);
    let scene = Scene::new(vec![ball]).unwrap();
    // Of finite ones all beads of all discs would come near each other within the step.
    for speed in [f64::NAN, f64::INFINITY, 1e200, 1e35, 1e9] {
        let mut stepper = among(&robot, &scene, 2e-3, Integrator::SemiImplicitEuler);
        let mut state = State::straight(&robot);
        state.velocity[4] = speed;
        let moved = stepper.step(&mut state, &robot.mean_command(), &Loads::default());
        assert!(
            matches!(moved, Err(DynamicsError::Diverged { .. })),
            "{speed}: {moved:?}"
        );
    }
    // Inside the ball, a robot is pushed out and goes on.
    let mut stepper = among(&robot, &scene, 2e-3, Integrator::SemiImplicitEuler);
    let mut state = State::straight(&robot);
    let moved = (0..500)
        .try_for_each(|_| stepper.step(&mut state, &robot.mean_command(), &Loads::default()));
    if moved.is_ok() {
        let away = |bead: &Vector3<f64>| (bead - Vector3::new(0.0, 0.0, 0.3)).norm();
        let nearest = beads(&stepper, &state).iter().map(away).fold(1.0, f64::min);
        eprintln!("nearest bead {nearest} m");
    }
}
