//! Friction of the tendons in motion: it slows, it holds, and in the limit of slow motions it is that of paths.

use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{DynamicsError, Integrator, Lineariser, Rollout, State, Stepper};
use tdcr_sim::robot::{Command, Drive, Friction, Loads, PerDisc, Robot, RobotSpec};
use tdcr_sim::scene::{ContactLaw, Obstacle, Scene};
use tdcr_sim::tendon_friction::{ContactPath, FrictionPath, SlipState, TendonProfile};

use super::{CONTACT, assert_capstan, pull_first, rough, rough_robot, rough_spec, tip};
use crate::random_robot::{Kind, random_hinged_spec, random_spec};

const FIRST_ORDER: [Integrator; 2] = [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler];

/// The same robot with this damping (N m s/rad) and armature (kg m²) at each joint.
fn quick(coefficient: f64, [damping, armature]: [f64; 2]) -> Robot {
    let mut spec = rough_spec(coefficient);
    for module in &mut spec.modules {
        module.damping = PerDisc::Uniform(damping);
        module.armature = PerDisc::Uniform(armature);
    }
    Robot::new(spec).unwrap()
}

/// A wall across the robot's way.
fn wall(friction: f64) -> Scene {
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &-Vector3::x()).unwrap();
    let wall = Obstacle::half_space("wall").at([0.04, 0.0, 0.0]);
    let wall = wall.with_orientation([turn.w, turn.i, turn.j, turn.k]);
    let wall = wall.unwrap().with_compliance(1e-5).unwrap();
    Scene::new(vec![wall.with_friction(friction).unwrap()]).unwrap()
}

/// The command at a `part` of the way through these, straight from one to the next.
fn along(robot: &Robot, ways: &[[f64; 6]], part: f64) -> Command {
    let legs = (ways.len() - 1) as f64;
    let leg = f64::min((part * legs).floor(), legs - 1.0);
    let (from, to) = (&ways[leg as usize], &ways[leg as usize + 1]);
    let within = part * legs - leg;
    let between = from.iter().zip(to).map(|(a, b)| a + within * (b - a));
    robot.command(&between.collect::<Vec<_>>()).unwrap()
}

const WAYS: [[f64; 6]; 4] = [
    [0.03, 0.03, 0.03, 0.03, 0.03, 0.03],
    [0.0, 0.03, 0.03, 0.03, 0.01, 0.03],
    [0.02, 0.01, 0.03, 0.03, 0.03, 0.02],
    [0.02, 0.02, 0.02, 0.03, 0.03, 0.0],
];

/// Where the tip and the tendons come to along the ways in `duration` (s).
fn driven(
    robot: &Robot,
    (duration, h): (f64, f64),
    integrator: Integrator,
) -> (Vector3<f64>, Vec<TendonProfile>) {
    let mut stepper = Stepper::new(robot, h, integrator).unwrap();
    let start = robot.settle(&along(robot, &WAYS, 0.0), &Loads::default());
    let mut state = State::at_rest(start.configuration);
    let steps = (duration / h).round() as usize;
    for step in 1..=steps {
        let command = along(robot, &WAYS, step as f64 / steps as f64);
        stepper
            .step(&mut state, &command, &Loads::default())
            .unwrap();
        for profile in stepper.tendon_profiles() {
            assert_capstan(profile, robot.tendons()[0].friction.unwrap().coefficient);
        }
    }
    assert_eq!(stepper.fallbacks(), 0);
    (
        state.positions(robot)[9],
        stepper.tendon_profiles().to_vec(),
    )
}

#[test]
fn slow_motions_are_paths() {
    let robot = quick(0.2, [0.01, 1e-3]);
    let mut path = FrictionPath::new(&robot).with_resolution(0.002);
    for ways in WAYS {
        path.advance(&robot.command(&ways).unwrap(), &Loads::default());
    }
    for integrator in FIRST_ORDER {
        let [quick, slow] = [8.0, 32.0].map(|duration| {
            let (end, profiles) = driven(&robot, (duration, 2e-3), integrator);
            let pairs = profiles.iter().zip(&path.state().tendons);
            let tensions = pairs
                .flat_map(|(a, b)| a.tensions.iter().zip(&b.tensions))
                .map(|(a, b)| (a - b).abs());
            let off = (end - tip(path.state())).norm();
            (off, tensions.fold(0.0, f64::max))
        });
        // Damping delays the robot in proportion to its speed.
        assert!(
            slow.0 < 4e-4 && slow.0 < 0.3 * quick.0,
            "{quick:?} {slow:?}"
        );
        assert!(
            slow.1 < 0.03 && slow.1 < 0.3 * quick.1,
            "{quick:?} {slow:?}"
        );
    }
}

/// Energy of motion and potential, of deflected contacts, and what holes and joints have turned to heat.
#[test]
fn energy_goes_to_heat_and_nowhere_else() {
    let damping = 2e-3;
    let robot = quick(0.3, [damping, 1e-3]);
    let start = robot.settle(&pull_first(&robot, 0.0), &Loads::default());
    let command = pull_first(&robot, 0.03);
    let missing = |h: f64, integrator: Integrator| {
        let mut stepper = Stepper::new(&robot, h, integrator).unwrap();
        let mut state = State::at_rest(start.configuration.clone());
        let total = |stepper: &Stepper, state: &State| {
            let own = Stepper::new(&robot, h, integrator).unwrap().energy(
                state,
                &command,
                &Loads::default(),
            );
            let deflections = stepper
                .tendon_profiles()
                .iter()
                .flat_map(|p| &p.deflections);
            let stored: f64 = deflections.map(|z| 0.5 * CONTACT * z * z).sum();
            own.unwrap().total() + stored
        };
        let before = total(&stepper, &state);
        let mut damped = 0.0;
        for _ in 0..(0.5 / h) as usize {
            let rates = state.velocity.clone();
            stepper
                .step(&mut state, &command, &Loads::default())
                .unwrap();
            let pairs = rates.iter().zip(&state.velocity);
            damped += pairs.map(|(a, b)| damping * h * a * b).sum::<f64>();
        }
        let lost = before - total(&stepper, &state);
        let heat = stepper.dissipated();
        assert!(heat > 0.1 * lost && damped > 0.05 * lost);
        (lost - heat - damped) / lost
    };
    for integrator in FIRST_ORDER {
        let off = [2e-4, 1e-4].map(|h| missing(h, integrator));
        assert!(off[1].abs() < 0.01, "{integrator:?}: {off:?}");
        assert!(
            (off[0] / off[1] - 2.0).abs() < 0.4,
            "{integrator:?}: {off:?}"
        );
    }
}

/// A swing dies where friction holds it, and elsewhere from the other side.
#[test]
fn robots_come_to_rest_where_friction_holds_them() {
    let robot = quick(0.3, [0.01, 1e-3]);
    let command = pull_first(&robot, 0.015);
    let rest = |first: f64| {
        let start = robot.settle(&pull_first(&robot, first), &Loads::default());
        let mut stepper = Stepper::new(&robot, 1e-3, Integrator::default()).unwrap();
        let mut state = State::at_rest(start.configuration);
        for _ in 0..5_000 {
            stepper
                .step(&mut state, &command, &Loads::default())
                .unwrap();
        }
        assert!(state.velocity.iter().all(|v| v.abs() < 1e-8));
        let sticks = |p: &TendonProfile| p.slip_states.iter().all(|&s| s == SlipState::Sticks);
        assert!(stepper.tendon_profiles().iter().any(sticks));
        let contacts = stepper
            .tendon_profiles()
            .iter()
            .flat_map(|p| &p.deflections);
        assert!(contacts.fold(0.0, |most: f64, z| most.max(z.abs())) > 1e-7);
        state.positions(&robot)[9]
    };
    let [above, below] = [0.0, 0.03].map(rest);
    let smooth = robot.settle(&command, &Loads::default()).positions[9];
    assert!((above - below).norm() > 1e-3);
    assert!((above - smooth).norm() > 1e-4 && (below - smooth).norm() > 1e-4);
}

#[test]
fn little_friction_changes_little_and_none_nothing() {
    let end = |coefficient: Option<f64>| {
        let mut spec = rough_spec(0.0);
        for tendon in spec.tendon_specs_mut() {
            tendon.friction = coefficient.map(|coefficient| Friction {
                coefficient,
                contact_stiffness: CONTACT,
            });
        }
        let robot = Robot::new(spec).unwrap();
        let mut stepper = Stepper::new(&robot, 1e-3, Integrator::default()).unwrap();
        let mut state = State::straight(&robot);
        for _ in 0..500 {
            stepper
                .step(&mut state, &pull_first(&robot, 0.0), &Loads::default())
                .unwrap();
        }
        let rubs = coefficient.is_some_and(|coefficient| coefficient > 0.0);
        assert_eq!(stepper.tendon_profiles().is_empty(), !rubs);
        (state.positions(&robot)[9], state)
    };
    let (smooth, state) = end(None);
    assert_eq!(end(Some(0.0)).1, state);
    let apart = [4e-3, 2e-3, 1e-3].map(|coefficient| (end(Some(coefficient)).0 - smooth).norm());
    assert!(apart[0] > 1e-6);
    for pair in apart.windows(2) {
        assert!((pair[0] / pair[1] - 2.0).abs() < 0.1, "{apart:?}");
    }
}

/// A robot that leans on a wall, slowly, is where a path leads it. The wall's own friction is that of bristles along a path, and of
/// velocities in motion.
#[test]
fn among_obstacles_slow_motions_are_paths() {
    let robot = quick(0.2, [0.01, 1e-3]);
    let ways = [
        [0.03; 6],
        [0.005, 0.03, 0.03, 0.03, 0.03, 0.03],
        [0.012, 0.03, 0.03, 0.03, 0.03, 0.03],
    ];
    let start = robot.settle(&along(&robot, &ways, 0.0), &Loads::default());
    for (friction, shrinks) in [(0.0, true), (0.2, false)] {
        let scene = wall(friction);
        let mut path = ContactPath::new(&robot, &scene).with_resolution(0.002);
        for ways in ways {
            let state = path.advance(&robot.command(&ways).unwrap(), &Loads::default());
            assert!(state.unwrap().equilibrium.converged);
        }
        let expected: Vector3<f64> = path.contacts().iter().map(|contact| contact.force).sum();
        assert!(expected.norm() > 0.1);
        for integrator in FIRST_ORDER {
            let [quick, slow] = [4.0, 16.0].map(|duration| {
                let stepper = Stepper::new(&robot, 2e-3, integrator).unwrap();
                let mut stepper = ContactStepper::new(stepper, &scene).unwrap();
                let mut state = State::at_rest(start.configuration.clone());
                let steps = (duration / 2e-3) as usize;
                for step in 1..=steps {
                    let command = along(&robot, &ways, step as f64 / steps as f64);
                    stepper
                        .step(&mut state, &command, &Loads::default())
                        .unwrap();
                }
                assert_eq!(stepper.unsolved(), 0);
                let forces = stepper.contacts().iter().map(|contact| contact.force);
                let force: Vector3<f64> = forces.sum();
                let off = (state.positions(&robot)[9] - tip(path.state())).norm();
                (off, (force - expected).norm() / expected.norm())
            });
            assert!(slow.0 < 2e-5, "{friction} {quick:?} {slow:?}");
            assert!(slow.1 < 0.02, "{friction} {quick:?} {slow:?}");
            if shrinks {
                assert!(slow.0 < 0.4 * quick.0, "{quick:?} {slow:?}");
                assert!(slow.1 < 0.4 * quick.1, "{quick:?} {slow:?}");
            }
        }
    }
}

#[test]
fn a_motion_goes_on_from_what_its_contacts_bear() {
    let robot = rough_robot(0.2);
    let command = pull_first(&robot, 0.0);
    let steps = |stepper: &mut Stepper, state: &mut State, steps: usize| {
        for _ in 0..steps {
            stepper.step(state, &command, &Loads::default()).unwrap();
        }
    };
    for integrator in FIRST_ORDER {
        let mut stepper = Stepper::new(&robot, 2e-3, integrator).unwrap();
        let mut state = State::straight(&robot);
        steps(&mut stepper, &mut state, 60);
        let (left, contacts) = (state.clone(), stepper.tendon_profiles().to_vec());
        let deflections: Vec<Vec<f64>> = contacts.into_iter().map(|p| p.deflections).collect();
        steps(&mut stepper, &mut state, 60);
        let mut other = Stepper::new(&robot, 2e-3, integrator).unwrap();
        let mut again = left.clone();
        other
            .set_deflections(&left.configuration, &command, &deflections)
            .unwrap();
        steps(&mut other, &mut again, 60);
        assert_eq!(again, state);
        // Without what they bore it goes elsewhere; a state that the stepper did not lead to begins with none loaded.
        let (mut fresh, mut reused) = (left.clone(), left.clone());
        steps(
            &mut Stepper::new(&robot, 2e-3, integrator).unwrap(),
            &mut fresh,
            60,
        );
        assert_ne!(fresh, state);
        steps(&mut stepper, &mut reused, 60);
        assert_eq!(reused, fresh);
        let rollout = Rollout {
            start: left.clone(),
            commands: vec![command.clone(); 60],
            loads: Loads::default(),
            wrenches: Vec::new(),
        };
        // The stepper has come to this state just now: a rollout begins anew all the same.
        let mut other = Stepper::new(&robot, 2e-3, integrator).unwrap();
        other
            .set_deflections(&left.configuration, &command, &deflections)
            .unwrap();
        assert_eq!(other.rollout(&rollout).unwrap().last().unwrap(), &fresh);
    }
}

/// Hinges, limits, tendons that only pull or hold a tension, and weak contacts.
#[test]
fn random_robots_keep_to_the_capstan_law_in_motion() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let (mut moved, mut unsettled, mut slips) = (0, 0, 0);
    for number in 0..60 {
        let mut spec = match number % 2 {
            0 => random_spec(Kind::Elastic, &mut rng),
            _ => random_hinged_spec(Kind::Elastic, &mut rng),
        };
        // Others are refused.
        spec.routes.clear();
        for tendon in spec.tendon_specs_mut() {
            tendon.friction = rough(0.1);
            if tendon.drive == Drive::Length && !tendon.stretches() {
                (tendon.drive, tendon.range) = (Drive::Tension, [0.0, 5.0]);
            }
        }
        let robot = Robot::new(spec).unwrap();
        let mut stepper = match Stepper::new(&robot, 1e-3, Integrator::ImplicitEuler) {
            Ok(stepper) => stepper,
            Err(DynamicsError::TendonFriction { .. } | DynamicsError::FrictionRoute { .. }) => {
                continue;
            }
            Err(other) => panic!("{other}"),
        };
        moved += 1;
        let mut state = State::straight(&robot);
        let ends = [0, 1].map(|_| robot.random_command(&mut rng));
        for step in 0..200 {
            // An unstable robot may fall over, and a fall is not resolved.
            let command = &ends[step / 100];
            if stepper
                .step(&mut state, command, &Loads::default())
                .is_err()
            {
                break;
            }
            assert!(state.is_finite());
            for profile in stepper.tendon_profiles() {
                assert_capstan(profile, 0.1);
                let slipping = profile
                    .slip_states
                    .iter()
                    .filter(|&&s| s != SlipState::Sticks);
                slips += slipping.count();
            }
        }
        unsettled += stepper.fallbacks();
    }
    assert!(
        moved >= 20 && slips > 1_000,
        "{moved} robots, {slips} slips"
    );
    assert!(unsettled < 20, "{unsettled}");
}

#[test]
fn what_friction_in_motion_cannot_do_is_refused() {
    let robot = rough_robot(0.2);
    for integrator in [Integrator::RungeKutta4, Integrator::ImplicitMidpoint] {
        let refused = Stepper::new(&robot, 1e-3, integrator).unwrap_err();
        assert_eq!(refused, DynamicsError::TendonFriction { tendon: 0 });
    }
    let message = Lineariser::new(&robot, 1e-3).unwrap_err().to_string();
    assert!(message.contains("friction of tendons"), "{message}");
    let stepper = Stepper::new(&robot, 1e-3, Integrator::default()).unwrap();
    let ball = Obstacle::sphere("ball", 0.01).unwrap().at([0.1, 0.0, 0.3]);
    let scene = Scene::new(vec![ball]).unwrap();
    let mujoco = scene
        .with_contact_law(ContactLaw::Impedance(Default::default()))
        .unwrap();
    let refused = ContactStepper::new(stepper, &mujoco).unwrap_err();
    assert_eq!(refused, DynamicsError::TendonFriction { tendon: 0 });
    let mut held: RobotSpec = rough_spec(0.1);
    for tendon in held.tendon_specs_mut() {
        (tendon.drive, tendon.axial_stiffness) = (Drive::Length, None);
    }
    let held = Robot::new(held).unwrap();
    let refused = Stepper::new(&held, 1e-3, Integrator::default()).unwrap_err();
    assert_eq!(refused, DynamicsError::TendonFriction { tendon: 0 });
    let mut stepper = Stepper::new(&robot, 1e-3, Integrator::default()).unwrap();
    let straight = State::straight(&robot).configuration;
    for deflections in [
        vec![vec![0.0; 4]; 5],
        vec![vec![0.0; 3]; 6],
        vec![vec![f64::NAN; 4]; 6],
    ] {
        let loaded = stepper.set_deflections(&straight, &robot.mean_command(), &deflections);
        assert_eq!(
            loaded.unwrap_err(),
            DynamicsError::Deflections,
            "{deflections:?}"
        );
    }
}
