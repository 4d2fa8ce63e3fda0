//! Rates of small motions against dense matrices.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use faer::Mat;
use faer::linalg::solvers::Solve;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::dynamics::composite::compose;
use crate::dynamics::implicit::{in_coordinates, mass_matrix};
use crate::energy::following::{add_forces, add_moments, jacobian};
use crate::energy::{DeadForces, Expansion, Potential};
use crate::random_robot::{Kind, random_robot, within};
use crate::robot::{Command, Frame, PerDisc, RobotSpec, Wrench};
use crate::tendon::Posture;

/// The rate with the largest real part, by the eigenvalues of the dense companion matrix, in units of `unit` (1/s).
fn dense(
    robot: &Robot,
    q: &Configuration,
    command: &Command,
    loads: &Loads,
    unit: f64,
) -> Complex<f64> {
    let armatures = Link::armatures(robot, 0.0);
    let mut equations = EquationsOfMotion::new(robot, &armatures).unwrap();
    equations.payload = PointMass::payload(robot, loads);
    let still = vec![0.0; robot.dof()];
    equations.enter(q, &still, command.as_slice());
    let mut composites = Vec::new();
    compose(&equations, &still, &still, &mut composites);
    let mass = mass_matrix(&composites, &armatures);
    let mut posture = Posture::new(robot);
    posture.place(robot, q);
    let mut dead = DeadForces::new(robot);
    dead.set(robot, loads);
    add_forces(loads, 1.0, &posture, &mut dead);
    let mut expansion = Expansion::new(robot);
    let potential = Potential {
        robot,
        command: command.as_slice(),
        dead: &dead,
    };
    potential.expand(q, &posture, &mut expansion);
    add_moments(loads, 1.0, &posture, &mut expansion);
    let world = jacobian(loads, 1.0, &posture, &expansion);
    let stiffness = in_coordinates(&world, &equations.posture.chain);
    let n = robot.dof();
    let forces = Mat::from_fn(n, 2 * n, |row, column| {
        if column < n {
            -stiffness[(row, column)] / (unit * unit)
        } else if row == column - n {
            let disc = &robot.discs()[row / 3];
            -(disc.damping + disc.extra_damping[row % 3]) / unit
        } else {
            0.0
        }
    });
    let below = mass.partial_piv_lu().solve(&forces);
    let companion = Mat::from_fn(2 * n, 2 * n, |row, column| {
        if row < n {
            f64::from(u8::from(column == row + n))
        } else {
            below[(row - n, column)]
        }
    });
    let values = companion.eigenvalues().unwrap();
    values
        .into_iter()
        .max_by(|a, b| a.re.total_cmp(&b.re))
        .unwrap()
}

/// Random robots in random poses, dampings and loads without a potential: what grows, grows as the dense matrices say.
#[test]
fn the_fastest_growth_is_that_of_the_dense_matrices() {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    let mut counts = [0; 2];
    for case in 0..60 {
        let mut spec = random_robot(Kind::Elastic, &mut rng).spec().clone();
        // Some robots longer than those whose rates are all computed, some without damping.
        if case % 3 == 0 {
            let last = spec.modules[spec.modules.len() - 1].clone();
            spec.modules.resize(spec.modules.len() + 2, last);
        }
        let damping = [0.0, 1e-3, 0.05][case % 3 % 2 + usize::from(case % 5 == 0)];
        for module in &mut spec.modules {
            module.damping = PerDisc::Uniform(damping);
        }
        let Ok(robot) = Robot::new(spec) else {
            continue;
        };
        let n = robot.discs().len();
        let size = 10.0_f64.powf(within(-3.0, 0.5, &mut rng));
        let mut three = |size: f64| std::array::from_fn(|_| within(-size, size, &mut rng));
        let push = Wrench {
            force: three(4.0 * size),
            moment: three(0.1 * size),
            ..Wrench::none(n - 1, Frame::Disc)
        };
        let loads = Loads::default().with_wrench(push).unwrap();
        let command = robot.random_command(&mut rng);
        let q = robot.settle(&command, &Loads::default()).configuration;
        let mut rates = SmallMotionRates::new(&robot).unwrap();
        let Some(found) = rates.examine(&q, command.as_slice(), &loads, 1e-10) else {
            panic!("case {case}: not computed");
        };
        let unit = 100.0;
        let expected = dense(&robot, &q, &command, &loads, unit) * unit;
        let message = format!("case {case}, {n} discs: {found:?}, not {expected}");
        match found {
            SmallMotion::Grows(growth) => {
                counts[0] += 1;
                let error = (growth.rate - expected.re).abs();
                assert!(error <= 1e-5 * expected.norm(), "{message}");
            }
            _ => {
                counts[1] += 1;
                let share = if damping == 0.0 {
                    1.1 * STEADY_UNDAMPED
                } else {
                    1e-5
                };
                assert!(expected.re <= share * expected.norm(), "{message}");
            }
        }
    }
    assert!(counts[0] >= 10 && counts[1] >= 10, "{counts:?}");
}

/// A straight robot pushed down by more than its joints bear leaves without swinging, at the rate of the dense matrices.
#[test]
fn what_topples_does_not_swing() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.tendons = None;
        module.backbone = Some(PerDisc::Uniform(crate::robot::Backbone::isotropic(0.1)));
    }
    let robot = Robot::new(spec).unwrap();
    let down = Wrench {
        force: [0.0, 0.0, 20.0 * robot.spec().gravity[2].signum()],
        moment: [0.0, 0.0, 1e-6],
        ..Wrench::none(9, Frame::World)
    };
    let loads = Loads::default().with_wrench(down).unwrap();
    let q = Configuration::straight(&robot);
    let command = robot.command(&[]).unwrap();
    let mut rates = SmallMotionRates::new(&robot).unwrap();
    let Some(SmallMotion::Grows(growth)) = rates.examine(&q, &[], &loads, 1e-10) else {
        panic!("it stays");
    };
    let expected = dense(&robot, &q, &command, &loads, 10.0) * 10.0;
    assert!(
        growth.angular_frequency == 0.0 && growth.without_damping,
        "{growth:?}"
    );
    assert!(
        (growth.rate / expected.re - 1.0).abs() < 1e-6,
        "{growth:?}, not {expected}"
    );
}
