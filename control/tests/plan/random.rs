//! Random queries: two commands, and 5 to 20 obstacles that are clear of the robot under both.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::ContactSettler;
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::statics::{Equilibrium, Settler};

use crate::check::gap;

/// Clearance that is planned with (m).
pub const CLEARANCE: f64 = 0.002;
/// By how much more the two ends are clear (m).
const SPARE: f64 = 0.001;

pub struct Query {
    pub scene: Scene,
    pub from: Command,
    pub to: Command,
}

/// Query `index` of a robot. Commands are uniform in their box, such that the robot settles and does not touch itself. Obstacles are
/// balls of 10 to 30 mm radius, boxes with sides of 20 to 60 mm, and capsules and cylinders of 5 to 15 mm radius and 40 to 120 mm length; their
/// middles are uniform in the upright cylinder about the base whose radius is the robot's length, from a third of that below the base
/// to as much above it as the robot is long, their orientations uniform. One that is within the clearance and a millimetre of the
/// robot under either command is drawn again.
pub fn query(robot: &Robot, index: u64) -> Query {
    let mut rng = ChaCha8Rng::seed_from_u64(index);
    let ends = [0, 1].map(|_| end(robot, &mut rng));
    let count = rng.random_range(5..=20);
    let mut obstacles: Vec<Obstacle> = Vec::new();
    while obstacles.len() < count {
        let drawn = obstacle(robot, &format!("obstacle {}", obstacles.len()), &mut rng);
        let scene = Scene::new(vec![drawn.clone()]).unwrap();
        let clear = |(_, equilibrium): &(Command, Equilibrium)| {
            gap(
                robot,
                &scene,
                &equilibrium.positions,
                &equilibrium.orientations,
            ) >= CLEARANCE + SPARE
        };
        if ends.iter().all(clear) {
            obstacles.push(drawn);
        }
    }
    let [from, to] = ends.map(|(command, _)| command);
    Query {
        scene: Scene::new(obstacles).unwrap(),
        from,
        to,
    }
}

fn end(robot: &Robot, rng: &mut ChaCha8Rng) -> (Command, Equilibrium) {
    // In a scene without obstacles, discs that touch each other are contacts.
    let empty = Scene::new(Vec::new()).unwrap();
    let mut settler = ContactSettler::new(robot, &empty);
    loop {
        let command = robot.random_command(rng);
        let alone = Settler::new(robot)
            .settle(&command, &Loads::default())
            .clone();
        let found = settler.settle(&command, &Loads::default()).unwrap();
        if alone.converged && found.equilibrium.converged && found.contacts.is_empty() {
            return (command, alone);
        }
    }
}

fn obstacle(robot: &Robot, name: &str, rng: &mut ChaCha8Rng) -> Obstacle {
    let mut uniform = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let drawn = match uniform(0.0, 4.0) as usize {
        0 => Obstacle::sphere(name, uniform(0.01, 0.03)),
        1 => Obstacle::cuboid(name, [0; 3].map(|_| uniform(0.02, 0.06))),
        2 => Obstacle::capsule(name, uniform(0.005, 0.015), uniform(0.04, 0.12)),
        _ => Obstacle::cylinder(name, uniform(0.005, 0.015), uniform(0.04, 0.12)),
    };
    let length = *robot.arc_lengths().last().unwrap();
    let (radius, angle) = (
        length * uniform(0.0, 1.0).sqrt(),
        uniform(0.0, std::f64::consts::TAU),
    );
    let base = Vector3::from(robot.spec().base.position);
    let place = base
        + Vector3::new(
            radius * angle.cos(),
            radius * angle.sin(),
            length * uniform(-0.33, 1.0),
        );
    let turn = loop {
        let q = Quaternion::new(
            uniform(-1.0, 1.0),
            uniform(-1.0, 1.0),
            uniform(-1.0, 1.0),
            uniform(-1.0, 1.0),
        );
        if (0.01..=1.0).contains(&q.norm_squared()) {
            break UnitQuaternion::from_quaternion(q);
        }
    };
    let pose = nalgebra::Isometry3::from_parts(place.into(), turn);
    drawn.unwrap().with_pose(pose)
}
