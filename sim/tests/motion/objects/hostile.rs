//! Random scenes of objects, and objects that there are not.

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{DynamicsError, Integrator, State, Stepper};
use tdcr_sim::geometry::Shape;
use tdcr_sim::objects::ObjectError;
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{HingeSpec, JointSpec, Obstacle, ObstacleShape, Scene, SliderSpec};

use super::STEP;

/// An object of a random shape, mass, friction and joint beside the robot.
fn object(rng: &mut ChaCha8Rng, name: &str) -> Obstacle {
    let size = rng.random_range(0.01..0.03);
    let mut object = match rng.random_range(0..5) {
        0 => Obstacle::sphere(name, size).unwrap(),
        1 => Obstacle::capsule(name, 0.5 * size, 2.0 * size).unwrap(),
        2 => Obstacle::cuboid(name, [2.0 * size, size, 1.5 * size]).unwrap(),
        3 => Obstacle::cylinder(name, size, 1.4 * size).unwrap(),
        _ => {
            let s = size;
            let corners = [[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]];
            let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
            let mesh = Shape::mesh(&corners, &faces).unwrap();
            Obstacle::new(name, ObstacleShape::Solid(mesh))
        }
    };
    let around = rng.random_range(0.0..std::f64::consts::TAU);
    let out = Vector3::new(f64::cos(around), f64::sin(around), 0.0);
    let place = out * (0.025 + 2.0 * size + rng.random_range(0.0..0.03));
    let height = rng.random_range(0.2..0.36);
    object.pose.translation = Translation3::from(place + Vector3::z() * height);
    let turn = Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0));
    object.pose.rotation = UnitQuaternion::from_scaled_axis(turn);
    let mass = 10_f64.powf(rng.random_range(-4.0..1.0));
    let object = object.with_mass(mass).unwrap();
    let object = object
        .with_friction([0.0, 0.5][rng.random_range(0..2)])
        .unwrap();
    let speed = Vector3::from_fn(|_, _| rng.random_range(-0.5..0.5)) - out;
    let spin = Vector3::from_fn(|_, _| rng.random_range(-5.0..5.0));
    let axis = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)).into();
    match rng.random_range(0..6) {
        0 => object.with_joint(JointSpec::Slider(SliderSpec {
            axis,
            limits: Some([-0.05, 0.05]),
            damping: 0.1,
        })),
        1 => object.with_joint(JointSpec::Hinge(HingeSpec {
            axis,
            anchor: [size, 0.0, 0.0],
            limits: None,
            damping: 1e-3,
        })),
        _ => object.with_velocity(speed.into(), spin.into()),
    }
    .unwrap()
}

/// Moves a robot in random scenes for 2 s each. Scenes that moved, and the number of contacts.
fn random_scenes(seeds: std::ops::Range<u64>) -> (usize, usize) {
    let (mut moved, mut touched) = (0, 0);
    for seed in seeds {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let robot = Robot::load(["2m", "3m"][seed as usize % 2]).unwrap();
        let count = rng.random_range(1..=5);
        let mut obstacles = vec![
            Obstacle::half_space("floor")
                .with_friction(0.5)
                .unwrap()
                .at([0.0, 0.0, 0.17]),
        ];
        obstacles.extend((0..count).map(|number| object(&mut rng, &number.to_string())));
        let scene = Scene::new(obstacles).unwrap();
        let stepper = Stepper::new(&robot, STEP, Integrator::SemiImplicitEuler).unwrap();
        let mut stepper = ContactStepper::new(stepper, &scene).unwrap();
        let mut state = State::straight(&robot);
        if stepper.check_start(&state).is_err() {
            continue;
        }
        let phase: Vec<f64> = (0..robot.tendons().len())
            .map(|_| rng.random_range(0.0..6.3))
            .collect();
        for step in 0..1_000 {
            let time = STEP * step as f64;
            let pull = |phase: &f64| 0.02 + 0.015 * (4.0 * time + phase).sin() * time.min(1.0);
            let values: Vec<f64> = phase.iter().map(pull).collect();
            let command = robot.command(&values).unwrap();
            (stepper.step(&mut state, &command, &Loads::default()))
                .unwrap_or_else(|error| panic!("scene {seed}, step {step}: {error}"));
            assert!(state.is_finite(), "scene {seed}, step {step}");
            let fine = stepper.objects().iter().all(|object| object.is_finite());
            assert!(fine, "scene {seed}, step {step}");
            touched += stepper.contacts().len();
            assert!(
                stepper
                    .contacts()
                    .iter()
                    .all(|contact| contact.force.norm().is_finite())
            );
        }
        moved += 1;
    }
    (moved, touched)
}

#[test]
fn objects_in_random_scenes_stay_finite() {
    let (moved, touched) = random_scenes(0..24);
    eprintln!("{moved} scenes, {touched} contacts");
    assert!(moved >= 12 && touched > 1_000, "{moved} {touched}");
}

/// `cargo test --release -p tdcr-sim --test motion -- --ignored ten_thousand_scenes`: 37 minutes of one core.
#[test]
#[ignore = "takes 37 minutes"]
fn ten_thousand_scenes_of_objects_stay_finite() {
    let (moved, touched) = random_scenes(0..10_000);
    eprintln!("{moved} scenes, {touched} contacts");
    assert!(moved > 8_000);
}

#[test]
fn objects_that_cannot_move_are_refused_by_name() {
    let robot = Robot::load("2m").unwrap();
    let refused = |object: Obstacle| {
        let scene = Scene::new(vec![object.with_mass(0.1).unwrap()]).unwrap();
        let stepper = Stepper::new(&robot, STEP, Integrator::SemiImplicitEuler).unwrap();
        match ContactStepper::new(stepper, &scene) {
            Err(DynamicsError::Objects(error)) => error,
            other => panic!("{other:?}"),
        }
    };
    let error = refused(Obstacle::pipe("tube", 0.02, 0.1).unwrap());
    assert!(matches!(&error, ObjectError::Shape { object, .. } if object == "tube"));
    let text = error.to_string();
    assert!(
        text.contains("a pipe, which is a bore in a block"),
        "{text}"
    );
    assert!(
        text.contains("expected a box, a sphere, a capsule, a cylinder or a convex mesh"),
        "{text}"
    );
    // Two tetrahedra that share a corner.
    let corners = [
        [0.0, 0.0, 0.0],
        [0.01, 0.0, 0.0],
        [0.0, 0.01, 0.0],
        [0.0, 0.0, 0.01],
        [-0.01, 0.0, 0.0],
        [0.0, -0.01, 0.0],
        [0.0, 0.0, -0.01],
    ];
    let faces = [
        [0, 2, 1],
        [0, 1, 3],
        [0, 3, 2],
        [1, 2, 3],
        [0, 4, 5],
        [0, 6, 4],
        [0, 5, 6],
        [4, 6, 5],
    ];
    let mesh = Shape::mesh(&corners, &faces).unwrap();
    let text = refused(Obstacle::new("star", ObstacleShape::Solid(mesh))).to_string();
    assert!(
        text.contains("`star` is a mesh that is open, flat or not convex"),
        "{text}"
    );
}
