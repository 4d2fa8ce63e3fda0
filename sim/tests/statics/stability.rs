//! Which equilibria count as settled, how stiff they are, and how exactly they are found.

use nalgebra::{DMatrix, DVector, SymmetricEigen, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::chain::Configuration;
use tdcr_sim::dynamics::State;
use tdcr_sim::robot::{
    Backbone, Command, Drive, Frame, HoleCircle, Holes, Limit, Loads, MassSpec, ModuleSpec,
    PerDisc, Pull, Robot, RobotSpec, Wrench,
};
use tdcr_sim::statics::{Equilibrium, LENGTH_TOLERANCE, NotSettled, Stability, TOLERANCE};

use crate::random_robot::{Kind, random_spec, within};

/// The 2m robot with other tendons.
fn two_modules(drive: Drive, pull: Pull, range: [f64; 2]) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        let tendons = module.tendons.as_mut().unwrap();
        (tendons.drive, tendons.pull, tendons.range) = (drive, pull, range);
    }
    spec
}

fn tip(settled: &Equilibrium) -> Vector3<f64> {
    *settled.positions.last().unwrap()
}

#[test]
fn equal_tensions_do_not_hold_a_robot_upright() {
    let robot = Robot::new(two_modules(Drive::Tension, Pull::Bilateral, [0.0, 20.0])).unwrap();
    let loads = Loads::payload(0.02).unwrap();
    let settle = |first: f64| {
        let command = robot.command(&[first, 1.0, 1.0, 1.0, 1.0, 1.0]).unwrap();
        let settled = robot.settle(&command, &loads);
        assert!(settled.converged, "{first}: {}", settled.residual);
        let stiffness = robot.smallest_stiffness(&command, &loads, &settled);
        assert!(stiffness > -1e-9, "{first}: {stiffness}");
        settled
    };
    let base = robot.spec().base.position[2];
    for first in [1.0, 1.000001] {
        assert!(tip(&settle(first)).z < base, "{}", tip(&settle(first)));
    }
}

#[test]
fn a_robot_on_slack_tendons_hangs() {
    let slack = two_modules(Drive::Gain(500.0), Pull::TensionOnly, [0.0, 0.3]);
    let robot = Robot::new(slack).unwrap();
    let command = robot.command(&[0.25; 6]).unwrap();
    let settled = robot.settle(&command, &Loads::default());
    assert!(settled.converged, "{}", settled.residual);
    // Its discs turn freely about their axes.
    assert_eq!(settled.stability, Some(Stability::Neutral));
    assert_eq!(settled.tendon_tensions, [0.0; 6]);
    let length: f64 = robot.discs().iter().skip(1).map(|disc| disc.offset.z).sum();
    let lowest = settled.positions[0].z - length;
    assert!((tip(&settled).z - lowest).abs() < 1e-6, "{}", tip(&settled));
}

/// Tendons without tension that would have to pull at the least motion: what the energy does is
/// not decided to second order.
#[test]
fn tendons_about_to_go_slack_are_not_counted_as_taut() {
    let mut spec = two_modules(Drive::Gain(500.0), Pull::TensionOnly, [0.0, 0.3]);
    spec.gravity = [0.0; 3];
    let robot = Robot::new(spec).unwrap();
    let (lengths, _) = robot.tendon_kinematics(&Configuration::straight(&robot));
    let command = robot.command(&lengths).unwrap();
    let settled = robot.settle(&command, &Loads::default());
    assert!(settled.converged && settled.iterations == 0);
    assert_eq!(settled.stability, Some(Stability::Neutral));
}

/// Specifications whose Hessians have pivots that are exactly zero, and others.
fn odd_spec(rng: &mut impl Rng) -> RobotSpec {
    let mut spec = random_spec(Kind::Elastic, rng);
    let symmetric = rng.random::<bool>();
    if symmetric {
        spec.base.orientation =
            [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]][rng.random_range(0..2)];
        spec.gravity = [0.0, 0.0, [-9.81, 0.0, 9.81][rng.random_range(0..3)]];
        spec.routes.clear();
    }
    let circle = HoleCircle {
        radius: 0.0125,
        angles: (0..4)
            .map(|k| std::f64::consts::FRAC_PI_2 * f64::from(k))
            .collect(),
    };
    if symmetric {
        spec.base.holes = Holes::Circle(circle.clone());
    }
    let pull = [Pull::Bilateral, Pull::TensionOnly][rng.random_range(0..2)];
    let (drive, range) = [
        (Drive::Tension, [0.0, 1.0]),
        (Drive::Gain(20.0), [0.0, 0.04]),
        (Drive::Gain(20.0), [0.0, 0.5]),
    ][rng.random_range(0..3)];
    let stiff = rng.random_range(0..3);
    for module in &mut spec.modules {
        if symmetric {
            module.holes = Holes::Circle(circle.clone());
        }
        if let Some(tendon) = &mut module.tendons {
            (tendon.drive, tendon.pull, tendon.range) = (drive, pull, range);
            tendon.axial_stiffness = None;
        }
        odd_joints(module, stiff, symmetric, rng);
    }
    spec
}

/// No backbone, one without torsion, or one that may buckle.
fn odd_joints(module: &mut ModuleSpec, stiff: usize, straight: bool, rng: &mut impl Rng) {
    let bending = within(1e-3, 0.1, rng);
    module.backbone = [
        None,
        Some(Backbone {
            torsion: 0.0,
            ..Backbone::isotropic(bending)
        }),
        Some(Backbone::isotropic(bending)),
    ][stiff]
        .map(PerDisc::Uniform);
    if straight || rng.random() {
        module.limit = None;
    } else {
        module.limit = Some(PerDisc::Uniform(Limit {
            angle: 0.1,
            stiffness: 0.5,
        }));
    }
}

/// Under equal commands and under random ones, with nothing, a payload, or loads without a potential.
fn odd_case(robot: &Robot, rng: &mut impl Rng) -> (Command, Loads) {
    let command = if rng.random() {
        let share: f64 = [0.0, 0.5, 1.0][rng.random_range(0..3)];
        let values = robot
            .tendons()
            .iter()
            .map(|t| t.range[0] + share * (t.range[1] - t.range[0]));
        robot.command(&values.collect::<Vec<_>>()).unwrap()
    } else {
        robot.random_command(rng)
    };
    let loads = match rng.random_range(0..4) {
        0 => Loads::payload(0.02).unwrap(),
        1 => {
            let push = Wrench {
                force: [0.0, 0.0, within(-0.2, 0.2, rng)],
                moment: [0.0, 0.0, [0.0, 1e-3][rng.random_range(0..2)]],
                ..Wrench::none(robot.discs().len() - 1, Frame::Disc)
            };
            Loads::default().with_wrench(push).unwrap()
        }
        _ => Loads::default(),
    };
    (command, loads)
}

#[test]
fn what_converges_is_stable_or_said_to_be_neutral() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let mut counts = [0; 4];
    for case in 0..400 {
        let robot = Robot::new(odd_spec(&mut rng)).unwrap();
        let (command, loads) = odd_case(&robot, &mut rng);
        let settled = robot.settle(&command, &loads);
        let stiffness = robot.smallest_stiffness(&command, &loads, &settled);
        let message = format!("case {case}: {stiffness} N m/rad, {settled:?}");
        let rests = matches!(
            settled.stability,
            Some(Stability::Stable | Stability::Neutral)
        );
        assert_eq!(settled.converged, rests, "{message}");
        let failure = settled.failure(&robot, &command);
        let kind = match settled.stability {
            Some(Stability::Stable) => {
                assert!(stiffness > 0.0 && failure.is_none(), "{message}");
                0
            }
            Some(Stability::Neutral) => {
                assert!(stiffness.abs() < 1e-8 && failure.is_none(), "{message}");
                1
            }
            Some(Stability::Unstable) => {
                assert!(stiffness < 0.0, "{message}");
                assert_eq!(failure, Some(NotSettled::Unstable), "{message}");
                2
            }
            Some(Stability::Flutter) => {
                assert!(matches!(failure, Some(NotSettled::Flutter(_))), "{message}");
                2
            }
            None => {
                let left = matches!(failure, Some(NotSettled::Moments { .. }));
                assert!(left && settled.residual.is_finite(), "{message}");
                3
            }
        };
        counts[kind] += 1;
    }
    // Tendons fold robots without a stiff backbone until two of their holes meet.
    assert!(counts[0] >= 150 && counts[1] >= 40, "{counts:?}");
    assert!(counts[2] >= 1 && counts[3] <= 160, "{counts:?}");
}

/// The Hessian of the Lagrangian `V + sum_t T_t L_t` of weight and commanded lengths, by second
/// differences, in an orthonormal basis of the turns that keep the lengths to first order.
fn constrained_hessian(robot: &Robot, settled: &Equilibrium) -> DMatrix<f64> {
    let start = &settled.configuration;
    let (lengths, jacobian) = robot.tendon_kinematics(start);
    let kept = SymmetricEigen::new(jacobian.tr_mul(&jacobian));
    let mut order: Vec<usize> = (0..robot.dof()).collect();
    order.sort_by(|a, b| kept.eigenvalues[*a].total_cmp(&kept.eigenvalues[*b]));
    order.truncate(robot.dof() - lengths.len());
    let gravity = Vector3::from(robot.spec().gravity);
    let lagrangian = |step: &DVector<f64>| {
        let mut q = start.clone();
        start.retract(robot, step.as_slice(), &mut q);
        let (now, _) = robot.tendon_kinematics(&q);
        let pulls = now.iter().zip(&lengths).zip(&settled.tendon_tensions);
        let pulled: f64 = pulls.map(|((now, then), t)| t * (now - then)).sum();
        let places = State::at_rest(q).positions(robot);
        let weights = robot.discs().iter().zip(&places);
        let lifted = weights.map(|(disc, place)| disc.mass * gravity.dot(place));
        pulled - lifted.sum::<f64>()
    };
    let h = 3e-4;
    DMatrix::from_fn(order.len(), order.len(), |i, j| {
        let [a, b] = [order[i], order[j]].map(|k| kept.eigenvectors.column(k) * h);
        let (sum, difference) = (&a + &b, a - b);
        let second = lagrangian(&sum) + lagrangian(&-sum)
            - lagrangian(&difference)
            - lagrangian(&-difference);
        second / (4.0 * h * h)
    })
}

#[test]
fn the_smallest_stiffness_at_commanded_lengths_is_that_of_the_turns_that_keep_them() {
    let free = Robot::load("2m").unwrap();
    let held = Robot::new(two_modules(Drive::Length, Pull::Bilateral, [0.0, 0.3])).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    for _ in 0..3 {
        let shape = free.settle(&free.random_command(&mut rng), &Loads::default());
        let command = held.command(&shape.tendon_lengths).unwrap();
        let settled = held.settle(&command, &Loads::default());
        assert!(settled.converged, "{}", settled.residual);
        let stiffness = held.smallest_stiffness(&command, &Loads::default(), &settled);
        let hessian = constrained_hessian(&held, &settled);
        let expected = hessian.symmetric_eigenvalues().min();
        assert!(expected > 0.0);
        assert!(
            (stiffness / expected - 1.0).abs() < 1e-3,
            "{stiffness} {expected}"
        );
    }
}

/// A robot `scale` times as large, whose tensions and weights have the same proportion to each other.
fn scaled(mut spec: RobotSpec, scale: f64) -> RobotSpec {
    let holes = |holes: &mut Holes| match holes {
        Holes::At(holes) => holes
            .as_flattened_mut()
            .iter_mut()
            .for_each(|x| *x *= scale),
        Holes::Circle(circle) => circle.radius *= scale,
    };
    spec.base.position.iter_mut().for_each(|x| *x *= scale);
    spec.base.hole_height *= scale;
    holes(&mut spec.base.holes);
    for module in &mut spec.modules {
        holes(&mut module.holes);
        for length in [
            &mut module.first_offset,
            &mut module.pitch,
            &mut module.radius,
            &mut module.half_height,
        ] {
            *length *= scale;
        }
        module.mass = MassSpec::Density(PerDisc::Uniform(25.0 / (scale * scale)));
        let tendons = module.tendons.as_mut().unwrap();
        tendons.range.iter_mut().for_each(|x| *x *= scale);
    }
    spec
}

#[test]
fn a_small_robot_settles_as_exactly_as_a_large_one() {
    let spec = RobotSpec::standard("2m").unwrap();
    let robot = Robot::new(spec.clone()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(33);
    let commands: Vec<_> = (0..20).map(|_| robot.random_command(&mut rng)).collect();
    for scale in [1e-2, 1e-4, 1e2] {
        let copy = Robot::new(scaled(spec.clone(), scale)).unwrap();
        for command in &commands {
            let values: Vec<f64> = command.as_slice().iter().map(|x| x * scale).collect();
            let here = robot.settle(command, &Loads::default());
            let there = copy.settle(&copy.command(&values).unwrap(), &Loads::default());
            assert!(there.converged, "{scale}: {}", there.residual);
            for (p, q) in here.positions.iter().zip(&there.positions) {
                assert!((p - q / scale).norm() < 1e-7, "{scale}: {p} {q}");
            }
        }
    }
}

#[test]
fn the_standard_robots_keep_their_tolerance() {
    for name in RobotSpec::STANDARD {
        let robot = Robot::load(name).unwrap();
        assert_eq!(robot.moment_tolerance(), TOLERANCE, "{name}");
        assert_eq!(robot.length_tolerance(), LENGTH_TOLERANCE, "{name}");
    }
}

#[test]
fn quaternions_are_continuous_from_the_base_up() {
    let mut rng = ChaCha8Rng::seed_from_u64(34);
    let standard = RobotSpec::STANDARD.map(|name| RobotSpec::standard(name).unwrap());
    let random = (0..10).map(|_| random_spec(Kind::Elastic, &mut rng));
    let specs: Vec<_> = standard.into_iter().chain(random).collect();
    let mut negative = 0;
    for spec in specs {
        let robot = Robot::new(spec).unwrap();
        for _ in 0..20 {
            let settled = robot.settle(&robot.random_command(&mut rng), &Loads::default());
            let [w, x, y, z] = robot.spec().base.orientation;
            let sign = if w < 0.0 { -1.0 } else { 1.0 };
            let mut below = nalgebra::Quaternion::new(w, x, y, z).normalize() * sign;
            for q in &settled.orientations {
                assert!(
                    q.coords.dot(&below.coords) >= 0.0,
                    "{:?}",
                    settled.orientations
                );
                below = *q.quaternion();
                negative += usize::from(q.w < 0.0);
            }
        }
    }
    assert!(negative > 0, "some robot turns by more than half a turn");
}

#[test]
fn numbers_too_large_to_compute_with_are_refused() {
    type Change = fn(&mut RobotSpec);
    let cases: [(&str, Change); 8] = [
        ("base.orientation", |spec| {
            spec.base.orientation = [1e200, 0.0, 0.0, 0.0]
        }),
        ("base.position", |spec| {
            spec.base.position = [0.0, 1e18, 0.0]
        }),
        ("base.hole_height", |spec| spec.base.hole_height = -1e9),
        ("base.holes", |spec| {
            spec.base.holes = Holes::At(vec![[1e160, 0.0]; 3])
        }),
        ("gravity", |spec| spec.gravity = [0.0, 0.0, -1e200]),
        ("modules[0].pitch", |spec| spec.modules[0].pitch = 1e20),
        ("modules[1].mass.density", |spec| {
            spec.modules[1].mass = MassSpec::Density(PerDisc::Uniform(1e300));
        }),
        ("modules[1].tendons.range", |spec| {
            spec.modules[1].tendons.as_mut().unwrap().range = [0.0, 1e200];
        }),
    ];
    for (field, change) in cases {
        let mut spec = RobotSpec::standard("2m").unwrap();
        change(&mut spec);
        let message = Robot::new(spec).unwrap_err().to_string();
        assert!(
            message.contains(&format!("`{field}`")),
            "{field}: {message}"
        );
        assert!(
            message.contains("at most") || message.contains("1e15"),
            "{message}"
        );
    }
}

#[test]
fn loads_too_large_to_compute_with_leave_a_robot_unsettled() {
    let robot = Robot::load("2m").unwrap();
    for mass in [1e160, 1e308] {
        let settled = robot.settle(&robot.mean_command(), &Loads::payload(mass).unwrap());
        assert!(!settled.converged && settled.stability.is_none(), "{mass}");
    }
}
