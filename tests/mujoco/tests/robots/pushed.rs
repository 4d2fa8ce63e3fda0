//! A box that a robot pushes over a table, beside MuJoCo's own.

use nalgebra::Vector3;
use tdcr_mujoco::Model;
use tdcr_sim::contact::{ContactLaw, ContactStepper};
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::formats::mjcf::{ExportOptions, export};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{HingeSpec, JointSpec, Obstacle, Scene};

const STEP: f64 = 2e-3;
const STEPS: usize = 1_000;

/// Where the one object is at each step, ours and MuJoCo's, from the straight robot to a command within a second.
fn paths(scene: &Scene, command: &[f64]) -> [Vec<[f64; 7]>; 2] {
    let robot = Robot::load("2m").unwrap();
    let options = ExportOptions {
        scene: scene.clone(),
        timestep: Some(STEP),
        ..ExportOptions::default()
    };
    let model = Model::from_xml(&export(robot.spec(), &options).unwrap()).unwrap();
    let mut theirs = model.data().unwrap();
    let stepper = Stepper::new(&robot, STEP, Integrator::SemiImplicitEuler).unwrap();
    let mut ours = ContactStepper::new(stepper, scene, ContactLaw::default()).unwrap();
    let mut state = State::straight(&robot);
    let mean = robot.mean_command();
    let mut paths = [Vec::new(), Vec::new()];
    let joints = 4 * robot.discs().len();
    for step in 0..STEPS {
        let share = (STEP * step as f64).min(1.0);
        let between = mean.as_slice().iter().zip(command);
        let values: Vec<f64> = between.map(|(a, b)| a + (b - a) * share).collect();
        theirs.ctrl_mut()[..values.len()].copy_from_slice(&values);
        theirs.step();
        let command = robot.command(&values).unwrap();
        ours.step(&mut state, &command, &Loads::default()).unwrap();
        let pose = ours.objects()[0].pose;
        let (at, turn) = (pose.translation.vector, pose.rotation);
        paths[0].push([at.x, at.y, at.z, turn.w, turn.i, turn.j, turn.k]);
        let own = &theirs.qpos()[joints..];
        let mut there = [0.0; 7];
        let count = own.len().min(7);
        there[..count].copy_from_slice(&own[..count]);
        paths[1].push(there);
    }
    paths
}

const LEFT: [f64; 6] = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];

fn place(path: &[f64; 7]) -> Vector3<f64> {
    Vector3::new(path[0], path[1], path[2])
}

#[test]
fn a_pushed_box_goes_where_mujocos_goes_within_a_tenth_of_its_way() {
    let mut worst = 0.0_f64;
    for (mass, friction, long, high, off) in
        [(0.02, 0.3, 0.03, 0.05, 0.0), (0.05, 0.3, 0.08, 0.05, 0.0)]
    {
        let table = Obstacle::cuboid("table", [0.4, 0.4, 0.02]).unwrap();
        let table = table
            .at([-0.25, 0.0, 0.23])
            .with_friction(friction)
            .unwrap();
        let parcel = Obstacle::cuboid("box", [long, 0.08, high]).unwrap();
        let middle = [-0.05 - long / 2.0, off, 0.24 + high / 2.0];
        let parcel = parcel
            .with_mass(mass)
            .unwrap()
            .at(middle)
            .with_friction(friction)
            .unwrap();
        let scene = Scene::new(vec![table, parcel]).unwrap();
        let [ours, theirs] = paths(&scene, &LEFT);
        let way: f64 = (theirs.windows(2))
            .map(|two| (place(&two[1]) - place(&two[0])).norm())
            .sum();
        let apart = ours
            .iter()
            .zip(&theirs)
            .map(|(a, b)| (place(a) - place(b)).norm());
        let apart = apart.fold(0.0, f64::max);
        let end = [&ours, &theirs].map(|path| place(&path[STEPS - 1]));
        eprintln!(
            "{mass} kg, friction {friction}, {long} m, off {off}: {apart:e} m of {way} m ({:.2} %), ends {end:?}",
            100.0 * apart / way
        );
        worst = worst.max(apart / way);
    }
    assert!(worst < 0.1, "{worst}");
}

#[test]
fn a_pushed_door_turns_as_mujocos() {
    let door = Obstacle::cuboid("door", [0.006, 0.2, 0.2]).unwrap();
    let hinge = HingeSpec {
        axis: [0.0, 0.0, 1.0],
        anchor: [0.0, 0.1, 0.0],
        limits: None,
        damping: 0.05,
    };
    let door = door.with_mass(0.05).unwrap().at([-0.04, 0.1, 0.28]);
    let scene = Scene::new(vec![door.with_joint(JointSpec::Hinge(hinge)).unwrap()]).unwrap();
    let [ours, theirs] = paths(&scene, &LEFT);
    // MuJoCo's one coordinate is the angle.
    let angle = |pose: &[f64; 7]| 2.0 * pose[6].atan2(pose[3]);
    let apart = ours
        .iter()
        .zip(&theirs)
        .map(|(a, b)| (angle(a) - b[0]).abs());
    let (apart, end) = (apart.fold(0.0, f64::max), theirs[STEPS - 1][0]);
    eprintln!("door at {end} rad, within {apart:e} rad");
    assert!(end.abs() > 0.1 && apart < 0.02 * end.abs(), "{apart} {end}");
}
