//! A box that a robot pushes over a table, beside MuJoCo's own.

use nalgebra::Vector3;
use tdcr_mujoco::Model;
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::formats::mjcf::{ExportOptions, export};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{HingeSpec, JointSpec, Obstacle, Scene};

const STEP: f64 = 2e-3;
const STEPS: usize = 1_000;
/// MuJoCo's steps in one of ours. Its box still goes 3 % farther or less far from one of 1 ms to one of 0.25 ms; ours is the same
/// within 0.03 mm from 2 ms to 0.25 ms.
const FINER: usize = 8;

/// What makes contacts of MuJoCo like ours: friction as strong in all directions, that does not creep, and surfaces that come back
/// slowly enough that nothing bounces. (Under its pyramids the box goes a tenth of its way farther.)
fn as_coulomb(xml: &str) -> String {
    let friction = "<option cone=\"elliptic\" impratio=\"100\"";
    let xml = xml.replacen("<option", friction, 1);
    assert!(xml.contains("solref=\"0.001 1\""), "no time constant");
    xml.replace("solref=\"0.001 1\"", "solref=\"0.002 2\"")
}

/// Where the one object is at each step, ours and MuJoCo's, from the straight robot to a command within a second.
fn paths(scene: &Scene, command: &[f64]) -> [Vec<[f64; 7]>; 2] {
    let robot = Robot::load("2m").unwrap();
    let options = ExportOptions {
        scene: scene.clone(),
        timestep: Some(STEP / FINER as f64),
        ..ExportOptions::default()
    };
    let xml = export(robot.spec(), &options).unwrap();
    let model = Model::from_xml(&as_coulomb(&xml)).unwrap();
    let mut theirs = model.data().unwrap();
    let stepper = Stepper::new(&robot, STEP, Integrator::SemiImplicitEuler).unwrap();
    let mut ours = ContactStepper::new(stepper, scene).unwrap();
    let mut state = State::straight(&robot);
    let mean = robot.mean_command();
    let mut paths = [Vec::new(), Vec::new()];
    let joints = 4 * robot.discs().len();
    for step in 0..STEPS {
        let share = (STEP * step as f64).min(1.0);
        let between = mean.as_slice().iter().zip(command);
        let values: Vec<f64> = between.map(|(a, b)| a + (b - a) * share).collect();
        theirs.ctrl_mut()[..values.len()].copy_from_slice(&values);
        for _ in 0..FINER {
            theirs.step();
        }
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

/// To one side, in the plane in which the robot is its own mirror image. Away from it a pushed box turns to one side or the other.
const LEFT: [f64; 6] = [0.034, 0.004, 0.004, 0.026, 0.017, 0.017];

fn place(path: &[f64; 7]) -> Vector3<f64> {
    Vector3::new(path[0], path[1], path[2])
}

/// A box of `mass` (kg), `long` and `high` (m), before the robot on a table, both of a coefficient of friction.
fn on_table(mass: f64, friction: f64, [long, high]: [f64; 2]) -> Scene {
    let table = Obstacle::cuboid("table", [0.4, 0.4, 0.02]).unwrap();
    let table = table.at([-0.25, 0.0, 0.23]);
    let parcel = Obstacle::cuboid("box", [long, 0.08, high]).unwrap();
    let parcel = parcel.with_mass(mass).unwrap();
    let parcel = parcel.at([-0.05 - long / 2.0, 0.0, 0.24 + high / 2.0]);
    let both = [table, parcel].map(|one| one.with_friction(friction).unwrap());
    Scene::new(both.to_vec()).unwrap()
}

/// Largest distance of two paths for the length of the second.
fn apart([ours, theirs]: &[Vec<[f64; 7]>; 2]) -> f64 {
    let steps = theirs.windows(2);
    let way: f64 = steps
        .map(|two| (place(&two[1]) - place(&two[0])).norm())
        .sum();
    let pairs = ours.iter().zip(theirs);
    let apart = pairs.map(|(a, b)| (place(a) - place(b)).norm());
    let apart = apart.fold(0.0, f64::max) / way;
    let end = [ours, theirs].map(|path| place(&path[STEPS - 1]));
    eprintln!("{:.2} % of {way} m, ends {end:?}", 100.0 * apart);
    apart
}

#[test]
fn a_pushed_box_of_ten_times_the_robots_mass_goes_where_mujocos_goes_within_a_fiftieth_of_its_way()
{
    let robot = Robot::load("2m").unwrap();
    let mass = 10.0 * robot.discs().iter().map(|disc| disc.mass).sum::<f64>();
    for friction in [0.3, 0.02] {
        let apart = apart(&paths(&on_table(mass, friction, [0.08, 0.05]), &LEFT));
        assert!(apart < 0.02, "{apart}");
    }
}

#[test]
fn a_tall_box_pushed_above_its_middle_falls_over_as_mujocos() {
    let paths = paths(&on_table(0.05, 0.5, [0.03, 0.1]), &LEFT);
    let apart = apart(&paths);
    assert!(apart < 0.04, "{apart}");
    // By a right angle about the y axis: half its sine.
    let fallen = paths.map(|path| path[STEPS - 1][5].abs());
    assert!(
        fallen
            .iter()
            .all(|sine| (sine - 0.5_f64.sqrt()).abs() < 1e-3),
        "{fallen:?}"
    );
}

/// Impacts on heavier boxes, and on those that tip, differ more: there MuJoCo's normal impulses grow with the speed of sliding.
#[test]
fn boxes_that_are_heavier_or_tip_go_nearly_where_mujocos_go() {
    for (mass, friction, size, bound) in [
        (0.1, 0.3, [0.08, 0.05], 0.04),
        (0.02, 0.3, [0.03, 0.05], 0.1),
    ] {
        let apart = apart(&paths(&on_table(mass, friction, size), &LEFT));
        assert!(apart < bound, "{mass} kg: {apart}");
    }
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
