//! Joints of hinges, universal joints among them, in MuJoCo.

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_mujoco::Model;
use tdcr_sim::chain::Configuration;
use tdcr_sim::dynamics::{Integrator, Lineariser, State, Stepper};
use tdcr_sim::formats::mjcf::{self, ExportOptions};
use tdcr_sim::robot::{Loads, Robot};

use crate::probe::{Probe, largest_difference};
use crate::random::random_robot::{Kind, random_hinged_robot, within};

/// A published form of tendon robot: ten universal joints of an x, then a y hinge.
const UNIVERSAL: &str = include_str!("../../../../sim/tests/data/by_hand/universal_joints.xml");

fn universal() -> Robot {
    Robot::new(mjcf::import_text(UNIVERSAL).unwrap().spec).unwrap()
}

fn exported(robot: &Robot, timestep: Option<f64>) -> Model {
    let options = ExportOptions {
        timestep,
        ..ExportOptions::default()
    };
    Model::from_xml(&mjcf::export(robot.spec(), &options).unwrap()).unwrap()
}

/// Those of our coordinates that are MuJoCo's.
fn present(robot: &Robot) -> Vec<usize> {
    let joints = robot.discs().iter().enumerate();
    joints
        .flat_map(|(joint, disc)| {
            let count = disc.hinges.as_ref().map_or(3, |hinges| hinges.count);
            3 * joint..3 * joint + count
        })
        .collect()
}

fn of<T: Copy>(values: &[T], present: &[usize]) -> Vec<T> {
    present.iter().map(|&index| values[index]).collect()
}

/// MuJoCo's coordinates of a configuration.
fn qpos(robot: &Robot, configuration: &Configuration) -> Vec<f64> {
    let joints = robot.discs().iter().zip(&configuration.0);
    joints
        .flat_map(|(disc, q)| match &disc.hinges {
            None => vec![q.w, q.i, q.j, q.k],
            Some(hinges) => hinges.angles(q).as_slice()[..hinges.count].to_vec(),
        })
        .collect()
}

fn random_state(robot: &Robot, rng: &mut ChaCha8Rng) -> State {
    let straight = Configuration::straight(robot);
    let mut state = State::straight(robot);
    let turns: Vec<f64> = (0..robot.dof()).map(|_| within(-0.4, 0.4, rng)).collect();
    straight.retract(robot, &turns, &mut state.configuration);
    for index in present(robot) {
        state.velocity[index] = within(-2.0, 2.0, rng);
    }
    state
}

fn robots(count: usize, rng: &mut ChaCha8Rng) -> Vec<Robot> {
    let random = (0..count).map(|_| random_hinged_robot(Kind::Mujoco, rng));
    [universal()].into_iter().chain(random).collect()
}

#[test]
fn kinematics_masses_and_bias_of_hinges_are_mujocos() {
    let mut rng = ChaCha8Rng::seed_from_u64(51);
    for robot in robots(30, &mut rng) {
        let model = exported(&robot, None);
        let command = robot.random_command(&mut rng);
        let state = random_state(&robot, &mut rng);
        let present = present(&robot);
        let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
        probe.place_at(&qpos(&robot, &state.configuration));
        probe.set_in_motion(&of(&state.velocity, &present));
        for (disc, position) in state.positions(&robot).iter().enumerate() {
            let apart = (probe.disc_pose(disc).0 - position).amax();
            assert!(apart <= 1e-12, "disc {disc}: {apart} m");
        }
        let (lengths, jacobian) = robot.tendon_kinematics(&state.configuration);
        assert!(largest_difference(probe.data().ten_length(), &lengths) <= 1e-12);
        let jacobian = jacobian.select_columns(&present);
        assert!((probe.data().ten_jacobian() - jacobian).amax() <= 1e-12);
        let terms = robot.motion_terms(&state, &Loads::default()).unwrap();
        let mass: DMatrix<f64> = terms.mass.select_columns(&present).select_rows(&present);
        let mass = (probe.data().mass_matrix() - mass).amax();
        assert!(mass <= 1e-12, "masses differ by {mass} kg m2");
        let bias = largest_difference(probe.data().qfrc_bias(), &of(&terms.bias, &present));
        assert!(bias <= 1e-12, "bias torques differ by {bias} N m");
    }
}

#[test]
fn mujoco_finds_no_force_where_robots_on_hinges_settle() {
    let mut rng = ChaCha8Rng::seed_from_u64(52);
    let mut settled_robots = 0;
    for robot in robots(60, &mut rng) {
        let command = robot.random_command(&mut rng);
        let settled = robot.settle(&command, &Loads::default());
        if !settled.converged {
            continue;
        }
        settled_robots += 1;
        let model = exported(&robot, None);
        let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
        probe.place_at(&qpos(&robot, &settled.configuration));
        let force = DVector::from_column_slice(probe.data().qfrc_smooth()).amax();
        assert!(force <= 1e-9, "{force} N m left");
    }
    assert!(
        settled_robots >= 50,
        "{settled_robots} of 61 robots settled"
    );
}

#[test]
fn trajectories_on_hinges_are_mujocos_for_five_hundred_steps() {
    let mut rng = ChaCha8Rng::seed_from_u64(53);
    for robot in robots(10, &mut rng) {
        let h = 0.001;
        let model = exported(&robot, Some(h));
        let command = robot.random_command(&mut rng);
        let mut stepper = Stepper::new(&robot, h, Integrator::SemiImplicitEuler).unwrap();
        let mut state = State::straight(&robot);
        let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
        for _ in 0..500 {
            stepper
                .step(&mut state, &command, &Loads::default())
                .unwrap();
            probe.step(1);
        }
        let rates = largest_difference(probe.data().qvel(), &of(&state.velocity, &present(&robot)));
        assert!(rates <= 1e-9, "{rates} rad/s");
        probe.look();
        for (disc, position) in state.positions(&robot).iter().enumerate() {
            let apart = (probe.disc_pose(disc).0 - position).norm();
            assert!(apart <= 1e-9, "disc {disc}: {apart} m");
        }
    }
}

/// By central differences of MuJoCo's own steps.
#[test]
fn linearised_steps_on_hinges_are_mujocos() {
    let mut rng = ChaCha8Rng::seed_from_u64(54);
    let h = 0.001;
    for robot in robots(4, &mut rng) {
        let present = present(&robot);
        if robot.discs().iter().any(|disc| disc.hinges.is_none()) {
            continue;
        }
        let model = exported(&robot, Some(h));
        let command = robot.random_command(&mut rng);
        let state = random_state(&robot, &mut rng);
        let mut lineariser = Lineariser::new(&robot, h).unwrap();
        let linear = lineariser
            .linearise(&state, &command, &Loads::default())
            .unwrap();
        let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
        let start = [
            qpos(&robot, &state.configuration),
            of(&state.velocity, &present),
        ];
        let count = present.len();
        let mut after = |index: usize, by: f64| {
            let mut moved = start.clone();
            moved[index / count][index % count] += by;
            probe.place_at(&moved[0]);
            probe.set_in_motion(&moved[1]);
            probe.step(1);
            [probe.data().qpos(), probe.data().qvel()].concat()
        };
        let rows: Vec<usize> = [0, robot.dof()]
            .iter()
            .flat_map(|first| present.iter().map(move |index| first + index))
            .collect();
        let size = 1e-5;
        for index in 0..2 * count {
            let (up, down) = (after(index, size), after(index, -size));
            for (row, (up, down)) in rows.iter().zip(up.iter().zip(&down)) {
                let expected = (up - down) / (2.0 * size);
                let found = linear.a[(*row, rows[index])];
                assert!(
                    (found - expected).abs() <= 1e-7 * (1.0 + expected.abs()),
                    "({row}, {index}): {found} {expected}"
                );
            }
        }
    }
}
