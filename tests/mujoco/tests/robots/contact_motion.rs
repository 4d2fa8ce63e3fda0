//! Motion among obstacles by MuJoCo's own law of contacts, step by step beside MuJoCo.

use std::fmt::Write;

use nalgebra::{Quaternion, UnitQuaternion};
use tdcr_mujoco::Model;
use tdcr_sim::chain::Configuration;
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::geometry::{Bead, Beads};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{ContactLaw, Impedance, Obstacle, Scene};

use crate::paper;

const STEPS: usize = 1_000;

/// An obstacle of each shape that both have, each at a side of the robot, and the same as geoms.
fn surroundings() -> (Scene, String) {
    let wall = Obstacle::half_space("wall")
        .at([0.05, 0.0, 0.0])
        .with_orientation([0.5_f64.sqrt(), 0.0, -(0.5_f64.sqrt()), 0.0])
        .unwrap();
    let ball = Obstacle::sphere("ball", 0.03).unwrap();
    let rod = Obstacle::capsule("rod", 0.01, 0.2).unwrap();
    let block = Obstacle::cuboid("block", [0.04, 0.05, 0.06]).unwrap();
    let turned = [0.9, 0.1, 0.3, 0.2].map(|q: f64| q / 0.95_f64.sqrt());
    let scene = Scene::new(vec![
        wall,
        ball.at([-0.02, 0.07, 0.26]),
        rod.at([-0.05, -0.03, 0.25]),
        block
            .at([0.0, -0.07, 0.28])
            .with_orientation(turned)
            .unwrap(),
    ]);
    let [w, x, y, z] = turned;
    let shapes = [
        "type='plane' size='1 1 0.1' pos='0.05 0 0' quat='0.5 0 -0.5 0'".to_owned(),
        "type='sphere' size='0.03' pos='-0.02 0.07 0.26'".to_owned(),
        "type='capsule' size='0.01 0.1' pos='-0.05 -0.03 0.25'".to_owned(),
        format!("type='box' size='0.02 0.025 0.03' pos='0 -0.07 0.28' quat='{w} {x} {y} {z}'"),
    ];
    let geom = |shape: &String| format!("<geom {shape} condim='1' contype='0' conaffinity='1'/>");
    (scene.unwrap(), shapes.iter().map(geom).collect())
}

/// The robot with its beads and the obstacles as geoms.
fn mjcf(robot: &Robot, beads: &[Bead], obstacles: &str) -> String {
    let mut text = paper::mjcf(&robot.spec().name);
    text = text.replace(
        "<option timestep='0.002' ",
        "<option timestep='0.002' solver='Newton' iterations='200' tolerance='0' ",
    );
    text = text.replace("<worldbody>", &format!("<worldbody>{obstacles}"));
    for disc in 0..robot.discs().len() {
        let body = text.find(&format!("<body name='disc{disc}'")).unwrap();
        let place = body + text[body..].find("<geom").unwrap();
        let mut spheres = String::new();
        for bead in beads.iter().filter(|bead| bead.disc == disc) {
            let [x, y, z]: [f64; 3] = bead.centre.into();
            write!(
                spheres,
                "<geom type='sphere' size='{}' pos='{x} {y} {z}' mass='0' condim='1' contype='1' conaffinity='0'/>",
                bead.radius
            )
            .unwrap();
        }
        text.insert_str(place, &spheres);
    }
    text
}

#[test]
fn trajectories_with_contacts_are_mujocos_step_by_step() {
    for robot in crate::standard_robots() {
        let (scene, obstacles) = surroundings();
        let beads = Beads::new(&robot);
        let model = Model::from_xml(&mjcf(&robot, beads.as_slice(), &obstacles)).unwrap();
        let mut theirs = model.data().unwrap();
        let law = ContactLaw::Impedance(Impedance::default());
        let scene = scene.with_contact_law(law).unwrap();
        let stepper = Stepper::new(&robot, 2e-3, Integrator::SemiImplicitEuler).unwrap();
        let mut ours = ContactStepper::with_beads(stepper, &scene, beads).unwrap();
        let mut state = State::straight(&robot);
        let (mut away, mut touching, mut largest, mut touched) = (0.0_f64, 0, 0.0_f64, [0; 4]);
        for step in 0..STEPS {
            let time = 2e-3 * step as f64;
            let values: Vec<f64> = (0..robot.tendons().len())
                .map(|t| {
                    0.02 + 0.018 * (3.0 * time + 2.1 * (t % 3) as f64).sin() * (2.0 * time).min(1.0)
                })
                .collect();
            let command = robot.command(&values).unwrap();
            theirs.ctrl_mut().copy_from_slice(&values);
            theirs.step();
            ours.step(&mut state, &command, &Loads::default()).unwrap();
            touching += usize::from(!ours.contacts().is_empty());
            for contact in ours.contacts() {
                touched[contact.partner.obstacle().unwrap()] += 1;
                largest = largest.max(contact.force.norm());
            }
            // MuJoCo's joints are at the end of the step, its poses at the begin.
            let joints = theirs.qpos().chunks_exact(4);
            let joints = joints.map(|q| Quaternion::new(q[0], q[1], q[2], q[3]));
            let there = Configuration(joints.map(UnitQuaternion::from_quaternion).collect());
            let (here, there) = (state.positions(&robot), there.place(&robot).0);
            let apart = (here.iter().zip(&there)).map(|(here, there)| (here - there).norm());
            away = away.max(apart.fold(0.0, f64::max));
        }
        let name = &robot.spec().name;
        eprintln!(
            "{name}: within {away:e} m over {STEPS} steps, {touching} with contacts {touched:?}, up to {largest:.3} N; {} unsolved",
            ours.unsolved()
        );
        assert!(touching > STEPS / 10, "{name}: {touching}");
        assert!(away <= 1e-8, "{name}: {away:e} m");
    }
}
