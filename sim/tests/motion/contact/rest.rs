//! Energy, forces and rest of robots that move among obstacles.

use nalgebra::{DMatrix, DVector, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{ContactSettler, ContactStepper};
use tdcr_sim::dynamics::{DynamicsError, Integrator, State, Stepper};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{ContactLaw, Impedance, Obstacle, Scene};

use super::{among, orientations, scene};
use crate::random_robot::within;

fn post() -> Scene {
    let post = Obstacle::cylinder("post", 0.01, 0.4).unwrap();
    Scene::new(vec![post.at([-0.06, 0.0, 0.25])]).unwrap()
}

const LEANING: [f64; 6] = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];

#[test]
fn without_obstacles_the_steps_are_the_same_to_the_last_bit() {
    let robot = Robot::load("3m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for integrator in [
        Integrator::SemiImplicitEuler,
        Integrator::RungeKutta4,
        Integrator::ImplicitEuler,
        Integrator::ImplicitMidpoint,
    ] {
        let mut free = Stepper::new(&robot, 2e-3, integrator).unwrap();
        let mut among = among(&robot, &Scene::default(), 2e-3, integrator);
        let mut states = [State::straight(&robot), State::straight(&robot)];
        for _ in 0..20 {
            let command = robot.random_command(&mut rng);
            let [own, other] = &mut states;
            free.step(own, &command, &Loads::default()).unwrap();
            among.step(other, &command, &Loads::default()).unwrap();
            assert_eq!(own, other);
        }
    }
}

#[test]
fn far_from_obstacles_the_steps_are_the_same_to_the_last_bit() {
    let robot = Robot::load("2m").unwrap();
    let far = Obstacle::sphere("far", 0.1).unwrap().at([3.0, 0.0, 0.0]);
    let far = Scene::new(vec![far]).unwrap();
    for integrator in [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler] {
        let mut free = Stepper::new(&robot, 2e-3, integrator).unwrap();
        let mut among = among(&robot, &far, 2e-3, integrator);
        let command = robot.command(&LEANING).unwrap();
        let mut states = [State::straight(&robot), State::straight(&robot)];
        for _ in 0..50 {
            let [own, other] = &mut states;
            free.step(own, &command, &Loads::default()).unwrap();
            among.step(other, &command, &Loads::default()).unwrap();
            assert_eq!(own, other);
        }
    }
}

#[test]
fn integrators_of_higher_order_are_refused_among_obstacles() {
    let robot = Robot::load("2m").unwrap();
    for integrator in [Integrator::RungeKutta4, Integrator::ImplicitMidpoint] {
        let stepper = Stepper::new(&robot, 2e-3, integrator).unwrap();
        let refused = ContactStepper::new(stepper, &post()).unwrap_err();
        assert_eq!(refused, DynamicsError::NotAmongObstacles { integrator });
    }
}

#[test]
fn a_robot_that_leans_on_an_obstacle_comes_to_rest_where_it_settles() {
    let mut rng = ChaCha8Rng::seed_from_u64(36);
    let (mut touching, mut farthest, mut force_error) = (0, 0.0_f64, 0.0_f64);
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).unwrap();
        for number in 0..5 {
            let scene = scene(&mut rng, &robot);
            let command = robot.random_command(&mut rng);
            let mut settler = ContactSettler::new(&robot, &scene);
            if settler.settle(&command, &Loads::default()).is_err() {
                continue;
            }
            // Long steps lead there soon: slow modes take minutes.
            let mut state = State::straight(&robot);
            let mut long = among(&robot, &scene, 0.02, Integrator::ImplicitEuler);
            let speed = |state: &State| {
                state
                    .velocity
                    .iter()
                    .fold(0.0_f64, |most, v| most.max(v.abs()))
            };
            for steps in 0..20_000 {
                long.step(&mut state, &command, &Loads::default()).unwrap();
                if steps > 100 && speed(&state) < 1e-10 {
                    break;
                }
            }
            // Some have joints that next to nothing holds.
            if speed(&state) > 1e-9 || long.contacts().is_empty() {
                continue;
            }
            let mut stepper = among(&robot, &scene, 2e-3, Integrator::SemiImplicitEuler);
            for _ in 0..100 {
                (stepper.step(&mut state, &command, &Loads::default())).unwrap();
            }
            assert!(speed(&state) < 1e-9, "{name} {number}: {}", speed(&state));
            let found =
                (settler.settle_from(&state.configuration, &command, &Loads::default())).unwrap();
            assert!(found.equilibrium.converged);
            let here = state.positions(&robot);
            let away = (here.iter().zip(&found.equilibrium.positions))
                .map(|(here, there)| (here - there).norm())
                .fold(0.0, f64::max);
            let sum = |contacts: &[tdcr_sim::contact::Contact]| {
                contacts
                    .iter()
                    .map(|contact| contact.force)
                    .sum::<Vector3<f64>>()
            };
            let error = (sum(stepper.contacts()) - sum(&found.contacts)).norm();
            eprintln!(
                "{name} {number}: {} contacts, {away:e} m, {error:e} N of {:e}",
                stepper.contacts().len(),
                sum(&found.contacts).norm()
            );
            touching += usize::from(!stepper.contacts().is_empty());
            farthest = farthest.max(away);
            force_error = force_error.max(error);
        }
    }
    assert!(touching >= 4, "{touching}");
    assert!(farthest < 1e-9, "{farthest:e} m");
    assert!(force_error < 1e-8, "{force_error:e} N");
}

#[test]
fn energy_never_grows_without_input() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut worst, mut touched) = (0.0_f64, 0);
    for name in ["2m", "3m"] {
        let robot = Robot::load(name).unwrap();
        let command = robot.mean_command();
        for _ in 0..20 {
            let scene = scene(&mut rng, &robot);
            if ContactSettler::new(&robot, &scene)
                .settle(&command, &Loads::default())
                .is_err()
            {
                continue;
            }
            let mut stepper = among(&robot, &scene, 1e-3, Integrator::ImplicitEuler);
            let mut state = State::straight(&robot);
            (state.velocity.iter_mut()).for_each(|v| *v = within(-4.0, 4.0, &mut rng));
            let start = stepper.energy(&state, &command, &Loads::default()).unwrap();
            let mut before = start.total();
            for _ in 0..500 {
                stepper
                    .step(&mut state, &command, &Loads::default())
                    .unwrap();
                touched += stepper.contacts().len();
                let now = stepper.energy(&state, &command, &Loads::default()).unwrap();
                worst = worst.max((now.total() - before) / start.kinetic);
                before = now.total();
            }
        }
    }
    eprintln!("{touched} contacts, largest growth {worst:e} of the kinetic energy");
    assert!(touched > 300);
    assert!(worst < 1e-3, "{worst:e}");
}

/// `J' p`: impulses of the contacts of the last step by the joints' coordinates.
pub fn impulses(stepper: &ContactStepper, state: &State) -> DVector<f64> {
    let robot = stepper.robot();
    let h = stepper.stepper().timestep();
    let size = 1e-6;
    let mut out = DVector::zeros(robot.dof());
    for coordinate in 0..robot.dof() {
        let moved = |sign: f64| {
            let mut turn = vec![0.0; robot.dof()];
            turn[coordinate] = sign * size;
            let mut moved = state.clone();
            (state.configuration).retract(robot, &turn, &mut moved.configuration);
            (moved.positions(robot), orientations(robot, &moved))
        };
        let (ahead, behind) = (moved(1.0), moved(-1.0));
        let (positions, turned) = (state.positions(robot), orientations(robot, state));
        for contact in stepper.contacts() {
            let disc = contact.disc;
            let own = turned[disc].inverse() * (contact.point - positions[disc]);
            let there = ahead.0[disc] + ahead.1[disc] * own;
            let here = behind.0[disc] + behind.1[disc] * own;
            let mut moved = there - here;
            // The opposite force is at the same point of the other disc.
            if let Some(disc) = contact.partner.disc() {
                let own = turned[disc].inverse() * (contact.point - positions[disc]);
                moved -= ahead.0[disc] + ahead.1[disc] * own;
                moved += behind.0[disc] + behind.1[disc] * own;
            }
            out[coordinate] += h * contact.force.dot(&(moved / (2.0 * size)));
        }
    }
    out
}

/// What a step from `before` gives the joints of momentum (N m s) beyond the one `without` contacts: `(M + h D) dv`, their
/// damping the same about all axes.
pub fn momentum_gained(
    robot: &Robot,
    before: &State,
    [with, without]: [&State; 2],
    damped: f64,
) -> DVector<f64> {
    let terms = robot.motion_terms(before, &Loads::default()).unwrap();
    let damping = DMatrix::identity(robot.dof(), robot.dof()) * damped;
    let pairs = with.velocity.iter().zip(&without.velocity);
    let change = pairs.map(|(with, without)| with - without);
    (terms.mass + damping) * DVector::from_iterator(robot.dof(), change)
}

#[test]
fn contact_forces_are_the_change_of_momentum() {
    let robot = Robot::load("2m").unwrap();
    let command = robot.command(&LEANING).unwrap();
    let (h, loads) = (2e-3, Loads::default());
    let rough = post().obstacles()[0].clone().with_friction(0.4).unwrap();
    let rough = Scene::new(vec![rough]).unwrap();
    for law in [
        ContactLaw::default(),
        ContactLaw::Impedance(Impedance::default()),
    ] {
        let scene = rough.clone().with_contact_law(law).unwrap();
        let new = || Stepper::new(&robot, h, Integrator::SemiImplicitEuler).unwrap();
        let (mut free, mut stepper) = (new(), ContactStepper::new(new(), &scene).unwrap());
        let mut state = State::straight(&robot);
        let mut compared = 0;
        for _ in 0..400 {
            let before = state.clone();
            let mut without = state.clone();
            stepper.step(&mut state, &command, &loads).unwrap();
            free.step(&mut without, &command, &loads).unwrap();
            if stepper.contacts().is_empty() {
                assert_eq!(state, without);
                continue;
            }
            compared += 1;
            let gained = momentum_gained(&robot, &before, [&state, &without], h * 0.1);
            let impulse = impulses(&stepper, &before);
            let error = (&gained - &impulse).amax();
            assert!(
                error <= 1e-8 * impulse.amax() + 1e-14,
                "{error:e} of {:e}",
                impulse.amax()
            );
        }
        assert!(compared > 50, "{compared}");
    }
}
