//! The Jacobian against differences of the balance.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use crate::robot::{Backbone, Frame, Friction, Payload, PerDisc, RobotSpec, Wrench};
use nalgebra::{Matrix3, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[allow(dead_code, reason = "shared with tests that draw other robots")]
use crate::random_robot::{Kind, random_hinged_spec, random_spec, within};

/// A random robot with friction in the holes of every tendon.
fn rough_robot(rng: &mut impl Rng) -> Robot {
    let spec = random_spec(Kind::Elastic, rng);
    roughened(spec, rng)
}

fn roughened(mut spec: RobotSpec, rng: &mut impl Rng) -> Robot {
    let tendons = (spec.modules.iter_mut())
        .filter_map(|module| module.tendons.as_mut())
        .chain(spec.routes.iter_mut().map(|route| &mut route.tendon));
    for tendon in tendons {
        tendon.friction = Some(Friction {
            coefficient: within(0.05, 0.4, rng),
            contact_stiffness: within(50.0, 500.0, rng),
        });
    }
    Robot::new(spec).unwrap()
}

fn bent(robot: &Robot, from: &Configuration, size: f64, rng: &mut impl Rng) -> Configuration {
    let turns: Vec<f64> = (0..robot.dof()).map(|_| within(-size, size, rng)).collect();
    let mut to = from.clone();
    from.retract(robot, &turns, &mut to);
    to
}

fn random_slip_state(rng: &mut impl Rng) -> SlipState {
    [
        SlipState::Sticks,
        SlipState::SlipsToServo,
        SlipState::SlipsToEnd,
    ][rng.random_range(0..3)]
}

fn random_loads(robot: &Robot, rng: &mut impl Rng) -> Loads {
    let mut loads = Loads::payload(0.02).unwrap();
    for frame in [Frame::World, Frame::Disc] {
        let disc = rng.random_range(0..robot.discs().len());
        let wrench = Wrench {
            point: std::array::from_fn(|_| within(-0.03, 0.03, rng)),
            force: std::array::from_fn(|_| within(-0.2, 0.2, rng)),
            moment: std::array::from_fn(|_| within(-0.01, 0.01, rng)),
            ..Wrench::none(disc, frame)
        };
        loads = loads.with_wrench(wrench).unwrap();
    }
    loads
}

/// The balance in each disc's own axes, turned from `q` by `step`.
fn moments(
    balance: &mut Balance,
    q: &Configuration,
    step: &[f64],
    before: &[TendonProfile],
) -> Vec<Vector3<f64>> {
    let mut moved = q.clone();
    q.retract(&balance.robot, step, &mut moved);
    balance.start_at(&moved);
    balance.evaluate(before, SlipRule::Assumed);
    let mut gradient = vec![Vector3::zeros(); moved.0.len()];
    balance.expansion.gradient(&mut gradient);
    for (joint, moment) in gradient.iter_mut().enumerate() {
        *moment = balance.iterate.posture.chain.disc(joint).tr_mul(moment);
    }
    gradient
}

#[test]
fn jacobian_is_the_central_difference_of_the_balance() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let mut asymmetric = 0;
    for _ in 0..12 {
        let robot = rough_robot(&mut rng);
        let mut balance = Balance::new(&robot);
        let q = bent(&robot, &Configuration::straight(&robot), 0.3, &mut rng);
        balance.start_at(&bent(&robot, &q, 0.05, &mut rng));
        let mut before = balance.profiles.clone();
        for (line, profile) in balance.lines.iter().zip(&mut before) {
            profile.relax(line, 1.0);
        }
        for slip_states in &mut balance.assumed {
            slip_states.fill_with(|| random_slip_state(&mut rng));
        }
        let command = robot.random_command(&mut rng);
        let loads = random_loads(&robot, &mut rng);
        balance.load(command.as_slice(), &loads, &before);
        let dof = robot.dof();
        let still = moments(&mut balance, &q, &vec![0.0; dof], &before);
        let jacobian = balance.jacobian();
        let turned = |joint: usize| *balance.iterate.posture.chain.disc(joint);
        let blocks: Vec<Matrix3<f64>> = (0..dof / 3)
            .flat_map(|k| (0..dof / 3).map(move |i| (k, i)))
            .map(|(k, i)| {
                let world = Matrix3::from_fn(|r, c| jacobian[(3 * k + r, 3 * i + c)]);
                turned(k).tr_mul(&world) * turned(i)
            })
            .collect();
        asymmetric += usize::from((blocks[1] - blocks[dof / 3].transpose()).amax() > 1e-3);
        let h = 1e-6;
        for j in 0..dof {
            let mut step = vec![0.0; dof];
            step[j] = h;
            let up = moments(&mut balance, &q, &step, &before);
            step[j] = -h;
            let down = moments(&mut balance, &q, &step, &before);
            for k in 0..dof / 3 {
                let mut expected = blocks[k * (dof / 3) + j / 3].column(j % 3).into_owned();
                if k == j / 3 {
                    // Moments in a disc's axes turn with it; along `q exp(xi)` they do by half.
                    expected += still[k].cross(&Vector3::ith(j % 3, 0.5));
                }
                let error = ((up[k] - down[k]) / (2.0 * h) - expected).amax();
                assert!(
                    error < 1e-6 * (1.0 + expected.amax()),
                    "({k}, {j}): {error}"
                );
            }
        }
    }
    assert!(asymmetric >= 4, "{asymmetric} clearly asymmetric Jacobians");
}

#[test]
fn a_load_on_the_way_to_another_is_a_superposition() {
    let robot = Robot::load("2m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    let mut balance = Balance::new(&robot);
    balance.start_at(&bent(
        &robot,
        &Configuration::straight(&robot),
        0.3,
        &mut rng,
    ));
    let hung = |mass: f64, x: f64, line: f64| {
        let offset = [x, 0.01, 0.0];
        (Loads::default().with_payload(Payload { mass, offset }))
            .and_then(|loads| loads.with_line_load([line, 0.0, 0.1]))
            .unwrap()
    };
    let (from, to) = (hung(0.01, 0.02, 0.0), hung(0.03, -0.01, 0.4));
    let mut energy = |loads: &Loads| {
        balance.dead.set(&robot, loads);
        balance.dead.energy(&balance.iterate.posture.chain)
    };
    let mixed = 0.75 * energy(&from) + 0.25 * energy(&to);
    assert!((energy(&from.towards(&to, 0.25)) - mixed).abs() < 1e-15);
    assert!((energy(&from) - energy(&to)).abs() > 1e-4);
}

/// A standard robot on elastic joints, with friction in its holes.
fn rough_standard(name: &str, rng: &mut impl Rng) -> Robot {
    let mut spec = RobotSpec::standard(name).unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
        if let Some(tendons) = &mut module.tendons {
            tendons.friction = Some(Friction {
                coefficient: within(0.05, 0.4, rng),
                contact_stiffness: within(1e3, 1e5, rng),
            });
        }
    }
    Robot::new(spec).unwrap()
}

#[test]
fn solving_in_linear_time_gives_what_the_dense_jacobian_does() {
    let mut rng = ChaCha8Rng::seed_from_u64(33);
    let robots = ["2m", "3m", "5m"].map(|name| rough_standard(name, &mut rng));
    let mut random: Vec<Robot> = (0..30).map(|_| rough_robot(&mut rng)).collect();
    random.extend((0..20).map(|_| {
        let spec = random_hinged_spec(Kind::Elastic, &mut rng);
        roughened(spec, &mut rng)
    }));
    let mut in_chain = 0;
    for robot in robots.iter().chain(&random) {
        let mut balance = Balance::new(robot);
        let q = bent(robot, &Configuration::straight(robot), 0.2, &mut rng);
        balance.start_at(&bent(robot, &q, 0.05, &mut rng));
        let mut before = balance.profiles.clone();
        for (line, profile) in balance.lines.iter().zip(&mut before) {
            profile.relax(line, 1.0);
        }
        for slip_states in &mut balance.assumed {
            slip_states.fill_with(|| random_slip_state(&mut rng));
        }
        let command = robot.random_command(&mut rng);
        balance.load(command.as_slice(), &Loads::payload(0.02).unwrap(), &before);
        balance.start_at(&q);
        balance.evaluate(&before, SlipRule::Assumed);
        balance.linearise();
        if !balance.linear.is_in_chain() {
            // Random tendons pass discs by; those of standard robots do not.
            assert!(robots.iter().all(|standard| !standard.is_same(robot)));
            continue;
        }
        in_chain += 1;
        balance.newton_step();
        let dense = balance.jacobian();
        let n = balance.linear.rhs.len();
        let product = |row: usize| -> f64 {
            let turn = |column: usize| balance.linear.solution[column / 3][column % 3];
            (0..3 * n)
                .map(|column| dense[(row, column)] * turn(column))
                .sum()
        };
        let size = balance
            .linear
            .rhs
            .iter()
            .fold(0.0, |size: f64, moment| size.max(moment.norm()));
        for row in 0..3 * n {
            let error = (product(row) - balance.linear.rhs[row / 3][row % 3]).abs();
            assert!(error < 1e-8 * size, "row {row}: {error}");
        }
    }
    assert!(in_chain > 5, "{in_chain} robots solved in linear time");
}
