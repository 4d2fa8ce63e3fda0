//! The expansion against differences of the energy.

use super::*;
use crate::factor::{Curvature, Factor, project};
use crate::robot::{Command, Frame, Loads, Payload, RobotSpec, Wrench};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::random_robot::{Kind, random_hinged_robot, random_robot, within};

/// The standard robots, and random ones, some with hinges.
fn robots() -> Vec<Robot> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let standard = RobotSpec::STANDARD
        .iter()
        .map(|name| Robot::load(name).expect("a standard robot"));
    let mut robots: Vec<Robot> = standard.collect();
    robots.extend((0..12).map(|_| random_robot(Kind::Elastic, &mut rng)));
    robots.extend((0..8).map(|_| random_hinged_robot(Kind::Elastic, &mut rng)));
    robots
}

/// A payload, a line load and a dead force.
fn dead_loads(robot: &Robot, rng: &mut impl Rng) -> Loads {
    let mut three = |size: f64| std::array::from_fn(|_| within(-size, size, rng));
    let payload = Payload {
        mass: 0.03,
        offset: three(0.02),
    };
    let push = Wrench {
        point: three(0.04),
        force: three(0.1),
        ..Wrench::none(robot.discs().len() / 2, Frame::World)
    };
    (Loads::default().with_payload(payload))
        .and_then(|loads| loads.with_line_load(three(0.2)))
        .and_then(|loads| loads.with_wrench(push))
        .expect("finite loads")
}

/// The energy as a function of joint turns away from a random bent configuration.
struct Landscape<'a> {
    robot: &'a Robot,
    command: Command,
    dead: DeadForces,
    bent: Configuration,
}

impl<'a> Landscape<'a> {
    fn random(robot: &'a Robot, rng: &mut ChaCha8Rng) -> Self {
        let straight = Configuration::straight(robot);
        let mut bent = straight.clone();
        let turns: Vec<f64> = (0..robot.dof()).map(|_| within(-0.4, 0.4, rng)).collect();
        straight.retract(robot, &turns, &mut bent);
        let mut dead = DeadForces::new(robot);
        dead.set(robot, &dead_loads(robot, rng));
        Self {
            robot,
            command: robot.random_command(rng),
            dead,
            bent,
        }
    }

    fn potential(&self) -> Potential<'_> {
        Potential {
            robot: self.robot,
            command: self.command.as_slice(),
            dead: &self.dead,
        }
    }

    fn energy(&self, step: &[f64]) -> f64 {
        let mut moved = self.bent.clone();
        self.bent.retract(self.robot, step, &mut moved);
        let mut posture = Posture::new(self.robot);
        posture.place(self.robot, &moved);
        self.potential().energy(&moved, &posture)
    }

    fn expansion(&self) -> (Posture, Expansion) {
        let mut posture = Posture::new(self.robot);
        posture.place(self.robot, &self.bent);
        let mut expansion = Expansion::new(self.robot);
        self.potential()
            .expand(&self.bent, &posture, &mut expansion);
        (posture, expansion)
    }
}

fn along(dof: usize, moves: &[(usize, f64)]) -> Vec<f64> {
    let mut step = vec![0.0; dof];
    for (index, size) in moves {
        step[*index] += size;
    }
    step
}

#[test]
fn gradient_is_the_central_difference_of_the_energy() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for robot in robots() {
        let landscape = Landscape::random(&robot, &mut rng);
        let (posture, expansion) = landscape.expansion();
        let mut gradient = vec![Vector3::zeros(); robot.discs().len()];
        expansion.gradient(&mut gradient);
        let h = 1e-5;
        for (joint, gradient) in gradient.iter().enumerate() {
            let own_axes = posture.chain.axes(joint).tr_mul(gradient);
            for (axis, analytic) in own_axes.iter().enumerate() {
                let i = 3 * joint + axis;
                let up = landscape.energy(&along(robot.dof(), &[(i, h)]));
                let down = landscape.energy(&along(robot.dof(), &[(i, -h)]));
                let numeric = (up - down) / (2.0 * h);
                let error = (analytic - numeric).abs();
                assert!(error < 2e-8, "{i}: {analytic} and {numeric}");
            }
        }
    }
}

#[test]
fn hessian_is_the_second_difference_of_the_energy() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for robot in robots() {
        let landscape = Landscape::random(&robot, &mut rng);
        let (posture, expansion) = landscape.expansion();
        let world = expansion.dense();
        let block = |k: usize, i: usize| {
            let b = Matrix3::from_fn(|r, c| world[(3 * k + r, 3 * i + c)]);
            posture.chain.axes(k).tr_mul(&b) * posture.chain.axes(i)
        };
        let h = 1e-4;
        for i in 0..robot.dof() {
            for j in 0..=i {
                let corner = |a, b| landscape.energy(&along(robot.dof(), &[(i, a), (j, b)]));
                let numeric =
                    (corner(h, h) - corner(h, -h) - corner(-h, h) + corner(-h, -h)) / (4.0 * h * h);
                let analytic = block(i / 3, j / 3)[(i % 3, j % 3)];
                let error = (analytic - numeric).abs();
                assert!(
                    error < 1e-5,
                    "({i}, {j}): {analytic} and {numeric} {:?} spans {:?}",
                    robot.tendons(),
                    robot.spans()
                );
            }
        }
    }
}

/// The products in O(n) and those of the dense matrices, loads without a potential among them.
#[test]
fn products_are_those_of_the_dense_matrices() {
    let mut rng = ChaCha8Rng::seed_from_u64(15);
    for robot in robots() {
        let landscape = Landscape::random(&robot, &mut rng);
        let (posture, expansion) = landscape.expansion();
        let n = robot.discs().len();
        let mut three = || Vector3::from_fn(|_, _| within(-1.0, 1.0, &mut rng));
        let mut turns: Vec<_> = (0..n).map(|_| three()).collect();
        project(&expansion.hinges, &mut turns);
        let loads = wrenches(n, three);
        let dense = [
            expansion.dense(),
            following::jacobian(&loads, 1.0, &posture, &expansion),
        ];
        let mut found = vec![Vector3::zeros(); n];
        expansion.product(&turns, &mut found);
        for (step, matrix) in dense.iter().enumerate() {
            if step == 1 {
                following::add_transposed_product(&loads, &posture, &turns, &mut found);
                project(&expansion.hinges, &mut found);
            }
            let vector = Mat::from_fn(3 * n, 1, |i, _| turns[i / 3][i % 3]);
            let expected = matrix.transpose() * vector;
            for i in 0..3 * n {
                let error = (found[i / 3][i % 3] - expected[(i, 0)]).abs();
                assert!(error < 1e-12 * expected.norm_max(), "{step} {i}: {error}");
            }
        }
        let mut found = vec![Vector3::zeros(); n];
        expansion.product(&turns, &mut found);
        following::add_product(&loads, 1.0, &posture, &turns, &mut found);
        project(&expansion.hinges, &mut found);
        let vector = Mat::from_fn(3 * n, 1, |i, _| turns[i / 3][i % 3]);
        let expected = &dense[1] * vector;
        for i in 0..3 * n {
            let error = (found[i / 3][i % 3] - expected[(i, 0)]).abs();
            assert!(error < 1e-12 * expected.norm_max(), "{i}: {error}");
        }
    }
}

/// Wrenches of both frames, off the discs' origins.
fn wrenches(n: usize, mut three: impl FnMut() -> Vector3<f64>) -> Loads {
    let places = [
        (0, Frame::World),
        (n / 2, Frame::Disc),
        (n - 1, Frame::Disc),
    ];
    (places.into_iter()).fold(Loads::default(), |loads, (disc, frame)| {
        let wrench = Wrench {
            point: (three() * 0.2).into(),
            force: three().into(),
            moment: three().into(),
            ..Wrench::none(disc, frame)
        };
        loads.with_wrench(wrench).expect("finite")
    })
}

#[test]
fn the_factor_under_following_loads_solves_as_a_dense_factorisation_does() {
    use crate::factor::{LoadedFactor, LoadedMatrix, Side};
    use faer::linalg::solvers::Solve;
    let mut rng = ChaCha8Rng::seed_from_u64(16);
    let (mut chains, mut checked) = (0, 0);
    for robot in robots() {
        let landscape = Landscape::random(&robot, &mut rng);
        let (posture, mut expansion) = landscape.expansion();
        let n = robot.discs().len();
        let mut three = || Vector3::from_fn(|_, _| within(-1.0, 1.0, &mut rng));
        let [joint, disc] = [0, 1].map(|_| (0..n).map(|_| three()).collect::<Vec<_>>());
        let loads = wrenches(n, three);
        following::add_moments(&loads, 1.0, &posture, &mut expansion);
        let dense = following::jacobian(&loads, 1.0, &posture, &expansion);
        let factor = LoadedFactor::new(&LoadedMatrix {
            loads: &loads,
            share: 1.0,
            posture: &posture,
            expansion: &expansion,
        });
        chains += usize::from(matches!(factor, LoadedFactor::Chain(_)));
        let mut total: Vec<Vector3<f64>> = (0..n)
            .map(|joint_index| {
                joint[joint_index] + disc[joint_index..].iter().sum::<Vector3<f64>>()
            })
            .collect();
        project(&expansion.hinges, &mut total);
        let rhs = Mat::from_fn(3 * n, 1, |i, _| total[i / 3][i % 3]);
        for side in [Side::Matrix, Side::Transpose] {
            let mut found = vec![Vector3::zeros(); n];
            factor.solve(&joint, &disc, side, &mut found);
            let matrix = match side {
                Side::Matrix => dense.clone(),
                Side::Transpose => dense.transpose().to_owned(),
            };
            let exact = matrix.partial_piv_lu().solve(&rhs);
            for i in 0..3 * n {
                let error = (found[i / 3][i % 3] - exact[(i, 0)]).abs();
                assert!(error < 1e-7 * exact.norm_max(), "{side:?} {i}: {error}");
            }
        }
        checked += 1;
    }
    assert!(3 * chains >= 2 * checked, "{chains} of {checked} in O(n)");
}

#[test]
fn the_factor_solves_as_a_dense_factorisation_does() {
    use faer::linalg::solvers::Solve;
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let mut positive = 0;
    for robot in robots() {
        let landscape = Landscape::random(&robot, &mut rng);
        let (_, mut expansion) = landscape.expansion();
        // Stiff enough joints make any Hessian positive definite.
        for stiffness in [0.0, 0.1, 3.0] {
            let identity = Matrix3::identity() * stiffness;
            expansion
                .joint_blocks
                .iter_mut()
                .for_each(|block| *block += identity);
            let mut factor = Factor::new(&expansion);
            let curvature = factor.factorise(&expansion, 0.0);
            let mut dense = expansion.dense();
            expansion.confine(&mut dense);
            let eigenvalues = dense
                .self_adjoint_eigenvalues(faer::Side::Lower)
                .expect("finite");
            assert_eq!(curvature == Curvature::Positive, eigenvalues[0] > 0.0);
            let n = robot.discs().len();
            let mut step = vec![Vector3::zeros(); n];
            factor.descend(
                &expansion.joint_gradient,
                &expansion.disc_gradient,
                &mut step,
            );
            let mut gradient = vec![Vector3::zeros(); n];
            expansion.gradient(&mut gradient);
            let slope: f64 = step.iter().zip(&gradient).map(|(s, g)| s.dot(g)).sum();
            assert!(slope < 0.0, "a step must go down");
            if curvature == Curvature::Modified {
                let mut falling = step.clone();
                factor.negative_curvature(&mut falling);
                let w = Mat::from_fn(3 * n, 1, |i, _| falling[i / 3][i % 3]);
                assert!((w.transpose() * &dense * &w)[(0, 0)] < 0.0);
                continue;
            }
            positive += 1;
            let rhs = Mat::from_fn(3 * n, 1, |i, _| -gradient[i / 3][i % 3]);
            let exact = dense.partial_piv_lu().solve(&rhs);
            let scale = exact.norm_max();
            for i in 0..3 * n {
                let error = (step[i / 3][i % 3] - exact[(i, 0)]).abs();
                assert!(error < 1e-8 * scale, "{i}: {error}");
            }
        }
    }
    assert!(positive >= 15, "{positive} positive definite Hessians");
}

#[test]
fn tendon_lengths_do_not_change_when_the_robot_turns_about_its_axis() {
    let robot = Robot::load("2m").expect("a standard robot");
    let mut rng = ChaCha8Rng::seed_from_u64(14);
    let third =
        nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::TAU / 3.0);
    let bent = Landscape::random(&robot, &mut rng).bent;
    let turned = Configuration(bent.0.iter().map(|q| third * q * third.inverse()).collect());
    let lengths = [bent, turned].map(|q| {
        let mut posture = Posture::new(&robot);
        posture.place(&robot, &q);
        posture.lengths
    });
    for (t, length) in lengths[0].iter().enumerate() {
        // Hole k moves to where hole k + 1 was; the holes are rounded to 1e-6 m.
        let next = 3 * (t / 3) + (t + 1) % 3;
        assert!((length - lengths[1][next]).abs() < 1e-5);
    }
}
