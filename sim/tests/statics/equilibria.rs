//! What the statics promise, checked from outside through the public interface.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{HoleCircle, Holes, Loads, Robot, RobotSpec, Routing};
use tdcr_sim::statics::{Equilibrium, Settler};

fn standard_robots() -> impl Iterator<Item = Robot> {
    RobotSpec::STANDARD
        .into_iter()
        .map(|name| Robot::load(name).unwrap())
}

#[test]
fn ten_thousand_random_commands_of_each_robot_settle() {
    for robot in standard_robots() {
        let mut rng = ChaCha8Rng::seed_from_u64(2026);
        let commands: Vec<_> = (0..10_000)
            .map(|_| robot.random_command(&mut rng))
            .collect();
        let equilibria = robot.settle_batch(&commands, &Loads::default());
        let missed = equilibria
            .iter()
            .filter(|e| !e.converged || e.residual > 1e-9)
            .count();
        assert_eq!(missed, 0, "of robot {}", robot.spec().name);
    }
}

#[test]
fn corner_commands_settle() {
    for robot in standard_robots() {
        let tendons = robot.tendons().len();
        // Every corner of the 2m box, every third of 3m's 512, of 5m's 32,768 every 97th.
        let stride = match tendons {
            ..=6 => 1,
            7..=9 => 3,
            _ => 97,
        };
        let corner = |bits: usize| -> Vec<f64> {
            (0..tendons)
                .map(|t| 0.04 * ((bits >> t) & 1) as f64)
                .collect()
        };
        let commands: Vec<_> = (0..1usize << tendons)
            .step_by(stride)
            .map(|bits| robot.command(&corner(bits)).unwrap())
            .collect();
        for (command, equilibrium) in commands
            .iter()
            .zip(robot.settle_batch(&commands, &Loads::default()))
        {
            assert!(
                equilibrium.converged,
                "{command:?}: {}",
                equilibrium.residual
            );
            let softest = robot.smallest_stiffness(command, &Loads::default(), &equilibrium);
            assert!(softest > 0.0, "{command:?}: {softest}");
        }
    }
}

/// Tendons as lists of (body, hole), written here again from the specification: body 0 is the base,
/// body `i + 1` disc `i`.
fn routes(spec: &RobotSpec) -> Vec<Vec<(usize, usize)>> {
    let mut routes = Vec::new();
    let mut below = 0;
    for module in &spec.modules {
        let start = if spec.routing == Routing::Base {
            0
        } else {
            below
        };
        for hole in 0..module.holes.count() {
            routes.push(
                (start..=below + module.discs)
                    .map(|body| (body, hole))
                    .collect(),
            );
        }
        below += module.discs;
    }
    routes
}

/// Force and moment balance of every disc, cut free from its neighbours: the reported tensions pull
/// on its holes, its weight and the payload on its origin, the joints above and below push back.
fn assert_every_disc_is_balanced(robot: &Robot, equilibrium: &Equilibrium, payload: f64) {
    let spec = robot.spec();
    let gravity = Vector3::from(spec.gravity);
    let count = robot.discs().len();
    let hole = |body: usize, hole: usize| -> Vector3<f64> {
        let base = Vector3::from(spec.base.position);
        match body.checked_sub(1) {
            None => {
                base + Vector3::new(
                    spec.base.holes.positions()[hole][0],
                    spec.base.holes.positions()[hole][1],
                    spec.base.hole_height,
                )
            }
            Some(disc) => {
                let module = &spec.modules[disc / spec.modules[0].discs];
                let local = Vector3::new(
                    module.holes.positions()[hole][0],
                    module.holes.positions()[hole][1],
                    0.0,
                );
                equilibrium.positions[disc] + equilibrium.orientations[disc] * local
            }
        }
    };
    let mut forces = vec![Vector3::zeros(); count];
    let mut moments = vec![Vector3::zeros(); count];
    for (route, tension) in routes(spec).iter().zip(&equilibrium.tendon_tensions) {
        for pair in route.windows(2) {
            let ends = [hole(pair[0].0, pair[0].1), hole(pair[1].0, pair[1].1)];
            let pull = (ends[1] - ends[0]).normalize() * *tension;
            for (end, force) in [(0, pull), (1, -pull)] {
                if let Some(disc) = pair[end].0.checked_sub(1) {
                    forces[disc] += force;
                    moments[disc] += (ends[end] - equilibrium.positions[disc]).cross(&force);
                }
            }
        }
    }
    let mut from_above = Vector3::zeros();
    for disc in (0..count).rev() {
        let mass = robot.discs()[disc].mass + if disc + 1 == count { payload } else { 0.0 };
        let mut moment = moments[disc];
        if disc + 1 < count {
            let arm = equilibrium.positions[disc + 1] - equilibrium.positions[disc];
            moment += arm.cross(&from_above);
        }
        assert!(
            moment.norm() < 1e-9,
            "disc {disc} of {}: {moment:?}",
            spec.name
        );
        // The joint below must carry all of this; being a joint at the origin, it has no moment.
        from_above += forces[disc] + gravity * mass;
    }
}

#[test]
fn tensions_weight_and_payload_balance_at_every_disc() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for mut robot in standard_robots() {
        for routing in [Routing::ModuleBelow, Routing::Base] {
            let mut spec = robot.spec().clone();
            spec.routing = routing;
            robot = Robot::new(spec).unwrap();
            for payload in [0.0, 0.02, 0.03] {
                let command = robot.random_command(&mut rng);
                let equilibrium = robot.settle(&command, &Loads::payload(payload).unwrap());
                assert!(equilibrium.converged);
                assert_every_disc_is_balanced(&robot, &equilibrium, payload);
            }
        }
    }
}

#[test]
fn tension_is_gain_times_stretch() {
    let robot = Robot::load("2m").unwrap();
    let command = robot
        .command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
        .unwrap();
    let equilibrium = robot.settle(&command, &Loads::default());
    for (t, rest) in command.as_slice().iter().enumerate() {
        let stretch = equilibrium.tendon_lengths[t] - rest;
        assert!((equilibrium.tendon_tensions[t] - 500.0 * stretch).abs() < 1e-12);
    }
}

/// The 3m robot with holes at exactly 120 degrees; the standard ones are rounded to 1e-6 m.
fn symmetric_spec() -> RobotSpec {
    let mut spec = RobotSpec::standard("3m").unwrap();
    let circle = Holes::Circle(HoleCircle {
        radius: 0.0125,
        angles: (0..3)
            .map(|k| std::f64::consts::TAU * f64::from(k) / 3.0)
            .collect(),
    });
    spec.base.holes.clone_from(&circle);
    spec.modules
        .iter_mut()
        .for_each(|module| module.holes.clone_from(&circle));
    spec
}

#[test]
fn equal_commands_keep_a_hanging_robot_straight() {
    // Upright, the straight pose is unstable: bends that leave the tendon lengths as they are have
    // no stiffness but gravity's.
    for gravity in [0.0, 9.81] {
        let mut spec = symmetric_spec();
        spec.gravity = [0.0, 0.0, gravity];
        let robot = Robot::new(spec).unwrap();
        let equilibrium = robot.settle(&robot.mean_command(), &Loads::default());
        assert!(equilibrium.converged);
        for (disc, position) in equilibrium.positions.iter().enumerate() {
            assert!(position.xy().norm() < 1e-9, "disc {disc}: {position:?}");
        }
    }
}

#[test]
fn an_upright_robot_does_not_rest_on_its_unstable_straight_pose() {
    let robot = Robot::new(symmetric_spec()).unwrap();
    let command = robot.mean_command();
    let equilibrium = robot.settle(&command, &Loads::default());
    assert!(equilibrium.converged);
    assert!(equilibrium.positions[14].xy().norm() > 1e-4);
    assert!(robot.smallest_stiffness(&command, &Loads::default(), &equilibrium) > 0.0);
}

#[test]
fn turning_the_command_turns_the_shape() {
    let robot = Robot::new(symmetric_spec()).unwrap();
    let command = [0.03, 0.01, 0.0, 0.02, 0.04, 0.01, 0.0, 0.035, 0.02];
    let turned: Vec<f64> = (0..9).map(|t| command[3 * (t / 3) + (t + 2) % 3]).collect();
    let settle =
        |lengths: &[f64]| robot.settle(&robot.command(lengths).unwrap(), &Loads::default());
    let third =
        nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::TAU / 3.0);
    let (before, after) = (settle(&command), settle(&turned));
    for (p, q) in before.positions.iter().zip(&after.positions) {
        assert!((third * p - q).norm() < 1e-9, "{p:?} {q:?}");
    }
}

/// Every body has its holes at y, 0 and -y: exchanging the second and third tendon of each module
/// mirrors the robot.
#[test]
fn mirroring_the_command_mirrors_the_shape() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for robot in standard_robots() {
        for _ in 0..10 {
            let command = robot.random_command(&mut rng);
            let swapped: Vec<f64> = (0..robot.tendons().len())
                .map(|t| command.as_slice()[3 * (t / 3) + [0, 2, 1][t % 3]])
                .collect();
            let loads = Loads::payload(0.01).unwrap();
            let settled = robot.settle(&command, &loads);
            let mirrored = robot.settle(&robot.command(&swapped).unwrap(), &loads);
            for (p, q) in settled.positions.iter().zip(&mirrored.positions) {
                let image = Vector3::new(p.x, -p.y, p.z);
                assert!((image - q).norm() < 1e-7, "{p} {q}");
            }
        }
    }
}

#[test]
fn a_solve_comes_to_the_same_place_from_elsewhere() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    for robot in standard_robots() {
        let mut settler = Settler::new(&robot);
        for _ in 0..20 {
            let [from, to] = [0, 1].map(|_| robot.random_command(&mut rng));
            let loads = Loads::payload(0.02).unwrap();
            let start = settler
                .settle(&from, &Loads::default())
                .configuration
                .clone();
            let warm = settler.settle_from(&start, &to, &loads).positions.clone();
            let cold = settler.settle(&to, &loads);
            assert!(cold.converged);
            for (p, q) in warm.iter().zip(&cold.positions) {
                assert!((p - q).norm() < 1e-7, "{p} {q}");
            }
        }
    }
}

#[test]
fn a_payload_lowers_the_tip_of_a_bent_robot() {
    let robot = Robot::load("5m").unwrap();
    let command = [0.04, 0.0, 0.0].repeat(5);
    let command = robot.command(&command).unwrap();
    let tip = |payload: f64| {
        let equilibrium = robot.settle(&command, &Loads::payload(payload).unwrap());
        assert!(equilibrium.converged);
        equilibrium.positions[24].z
    };
    assert!(tip(0.03) < tip(0.01) - 1e-3);
    assert!(tip(0.01) < tip(0.0) - 1e-3);
}

#[test]
fn a_batch_is_what_single_solves_are() {
    let robot = Robot::load("2m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let commands: Vec<_> = (0..50).map(|_| robot.random_command(&mut rng)).collect();
    let one_by_one: Vec<_> = commands
        .iter()
        .map(|c| robot.settle(c, &Loads::default()))
        .collect();
    assert_eq!(robot.settle_batch(&commands, &Loads::default()), one_by_one);
}
