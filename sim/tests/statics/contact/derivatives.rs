//! Derivatives beside central differences, where all contacts bear force.

use nalgebra::{DVector, Isometry3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{Activity, ContactEquilibrium, ContactSensitivity, ContactSettler};
use tdcr_sim::pose::PoseTangent;
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};

use super::scenes::scene;

/// Motions of obstacles and the base: about two axes at once, and along two.
const SHIFT: PoseTangent = PoseTangent {
    position: Vector3::new(0.8, -0.5, 0.3),
    rotation: Vector3::new(0.0, 0.0, 0.0),
};
const TURN: PoseTangent = PoseTangent {
    position: Vector3::new(0.0, 0.0, 0.0),
    rotation: Vector3::new(0.8, -0.5, 0.3),
};

/// Steps of differences, each half as long as the one before.
const HALVINGS: i32 = 7;
/// Largest difference from them, and beyond their own error.
const EXACT: f64 = 1e-6;
const BEYOND: f64 = 1e-7;

/// An equilibrium whose derivatives are asked for.
struct Case {
    robot: Robot,
    scene: Scene,
    command: Command,
    found: ContactEquilibrium,
    sensitivity: ContactSensitivity,
}

impl Case {
    /// The next pair of a command and a scene in which all contacts bear force.
    fn next(rng: &mut ChaCha8Rng, robot: &Robot) -> Self {
        loop {
            let scene = scene(rng, robot);
            let command = robot.random_command(rng);
            let mut settler = ContactSettler::new(robot, &scene);
            let Ok(found) = settler.settle(&command, &Loads::default()).cloned() else {
                continue;
            };
            let strict = |found: &ContactEquilibrium| {
                (found.contacts.iter()).all(|contact| contact.activity == Activity::Strict)
            };
            if found.equilibrium.converged && !found.contacts.is_empty() && strict(&found) {
                let sensitivity = settler.sensitivity(&command, &Loads::default()).unwrap();
                let (robot, scene) = (robot.clone(), scene.clone());
                return Self {
                    robot,
                    scene,
                    command,
                    found,
                    sensitivity,
                };
            }
        }
    }

    /// Positions of all discs in a changed world, from the equilibrium; `None` where other contacts bear.
    fn positions(&self, robot: &Robot, scene: &Scene, command: &Command) -> Option<DVector<f64>> {
        let mut settler = ContactSettler::new(robot, scene);
        let start = &self.found.equilibrium.configuration;
        let found = settler
            .settle_from(start, command, &Loads::default())
            .ok()?;
        let same = found.contacts.len() == self.found.contacts.len()
            && (found.contacts.iter()).all(|contact| contact.activity == Activity::Strict);
        (same && found.equilibrium.converged).then(|| flat(&found.equilibrium.positions))
    }

    /// Largest difference from central ones, as a share of 1 + the largest change, and their own error by what they say of it; `None`
    /// where contacts change within the shortest steps. Differences over the `longest` step and its halves are extrapolated to none
    /// (Romberg), as far as that is worth while: long steps err by higher orders, short ones by how exactly the robot settles.
    fn error(
        &self,
        ours: &[PoseTangent],
        longest: f64,
        moved: impl Fn(f64) -> (Robot, Scene, Command),
    ) -> Option<[f64; 2]> {
        let at = |step: f64| {
            let (robot, scene, command) = moved(step);
            self.positions(&robot, &scene, &command)
        };
        let difference = |step: f64| Some((at(step)? - at(-step)?) / (2.0 * step));
        let ours: Vec<_> = ours.iter().map(|pose| pose.position).collect();
        let ours = flat(&ours);
        let mut best: Option<(f64, DVector<f64>)> = None;
        // Of the step before: the difference, and what it and those before it are extrapolated to, by orders.
        let mut before: Vec<DVector<f64>> = Vec::new();
        for halvings in 0..HALVINGS {
            let Some(first) = difference(longest * 0.5_f64.powi(halvings)) else {
                before.clear();
                continue;
            };
            let mut now = vec![first];
            for (order, coarse) in before.iter().enumerate() {
                let share = 4.0_f64.powi(order as i32 + 1);
                let fine = &now[order];
                let next = (fine * share - coarse) / (share - 1.0);
                let own = (&next - fine).amax().max((&next - coarse).amax());
                if best.as_ref().is_none_or(|(least, _)| own < *least) {
                    best = Some((own, next.clone()));
                }
                now.push(next);
            }
            before = now;
        }
        let (own, limit) = best?;
        let size = 1.0 + ours.amax();
        Some([(limit - &ours).amax() / size, own / size])
    }

    fn with_obstacle(&self, index: usize, change: impl Fn(&mut Obstacle)) -> Scene {
        let mut obstacles = self.scene.obstacles().to_vec();
        change(&mut obstacles[index]);
        Scene::new(obstacles).unwrap()
    }

    fn with_base(&self, motion: &PoseTangent, step: f64) -> Robot {
        let mut spec = self.robot.spec().clone();
        let [w, x, y, z] = spec.base.orientation;
        let turn = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        let turned = UnitQuaternion::from_scaled_axis(motion.rotation * step) * turn;
        spec.base.orientation = [turned.w, turned.i, turned.j, turned.k];
        spec.base.position = (Vector3::from(spec.base.position) + motion.position * step).into();
        Robot::new(spec).unwrap()
    }

    fn command_by(&self, tendon: usize, step: f64) -> Option<Command> {
        let mut values = self.command.as_slice().to_vec();
        values[tendon] += step;
        self.robot.command(&values).ok()
    }
}

fn flat(positions: &[Vector3<f64>]) -> DVector<f64> {
    DVector::from_iterator(3 * positions.len(), positions.iter().flatten().copied())
}

fn moved(pose: &Isometry3<f64>, motion: &PoseTangent, step: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(motion.rotation * step);
    let position = pose.translation.vector + motion.position * step;
    Isometry3::from_parts(position.into(), turn * pose.rotation)
}

/// Checks all derivatives at so many poses of a robot.
fn assert_derivatives(name: &str, poses: usize) {
    let robot = Robot::load(name).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut worst = [0.0_f64; 6];
    let (mut checked, mut exact, mut rough) = (0, 0, 0.0_f64);
    for _ in 0..poses {
        let case = Case::next(&mut rng, &robot);
        let touched = case.found.contacts[0].partner.obstacle().unwrap();
        let sensitivity = &case.sensitivity;
        let (here, scene, command) = (&case.robot, &case.scene, &case.command);
        let obstacle = |motion: &PoseTangent| {
            case.error(&sensitivity.by_obstacle(touched, motion), 3.2e-5, |step| {
                let scene =
                    case.with_obstacle(touched, |own| own.pose = moved(&own.pose, motion, step));
                (here.clone(), scene, command.clone())
            })
        };
        let base = |motion: &PoseTangent| {
            case.error(&sensitivity.by_base(motion), 3.2e-5, |step| {
                (case.with_base(motion, step), scene.clone(), command.clone())
            })
        };
        // Of the compliance as a share of it.
        let per_share = sensitivity.by_compliance(touched);
        let per_share: Vec<_> = (per_share.iter())
            .map(|pose| PoseTangent {
                position: pose.position * 1e-6,
                rotation: pose.rotation * 1e-6,
            })
            .collect();
        let compliance = case.error(&per_share, 0.16, |step| {
            let scene = case.with_obstacle(touched, |own| own.compliance *= 1.0 + step);
            (here.clone(), scene, command.clone())
        });
        let jacobian = sensitivity.parameters().command_jacobian();
        let by_command: Vec<_> = (0..here.discs().len())
            .map(|disc| PoseTangent {
                position: jacobian.fixed_view::<3, 1>(6 * disc, 0).into(),
                rotation: Vector3::zeros(),
            })
            .collect();
        let pulled = (case.command_by(0, -1.6e-5))
            .zip(case.command_by(0, 1.6e-5))
            .and_then(|_| {
                case.error(&by_command, 1.6e-5, |step| {
                    let command = case.command_by(0, step).unwrap();
                    (here.clone(), scene.clone(), command)
                })
            });
        let errors = [
            obstacle(&SHIFT),
            obstacle(&TURN),
            base(&SHIFT),
            base(&TURN),
            compliance,
            pulled,
        ];
        for (worst, error) in worst.iter_mut().zip(errors) {
            if let Some([error, own]) = error {
                checked += 1;
                exact += usize::from(error < EXACT);
                rough = rough.max(own);
                *worst = worst.max(error - own);
            }
        }
    }
    eprintln!(
        "{name}: {exact} of {checked} derivatives within {EXACT:e}; beyond the differences' own error {worst:?}, which is {rough:e} at most"
    );
    assert!(checked > 5 * poses && exact == checked);
    assert!(worst.iter().all(|error| *error < BEYOND), "{worst:?}");
}

#[test]
fn derivatives_of_two_modules_are_those_of_differences() {
    assert_derivatives("2m", 80);
}

#[test]
fn derivatives_of_three_modules_are_those_of_differences() {
    assert_derivatives("3m", 30);
}

#[test]
fn derivatives_of_five_modules_are_those_of_differences() {
    assert_derivatives("5m", 30);
}

/// `cargo test --release -p tdcr-sim --test statics contact::derivatives -- --ignored --nocapture`: the figures of docs/contact.md.
#[test]
#[ignore = "takes minutes"]
fn derivatives_of_many_poses_are_those_of_differences() {
    assert_derivatives("2m", 500);
    assert_derivatives("3m", 150);
    assert_derivatives("5m", 150);
}

/// The gradient of a cost is the transpose of what moves the poses.
#[test]
fn gradients_are_transposed_derivatives() {
    let robot = Robot::load("3m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for _ in 0..20 {
        let case = Case::next(&mut rng, &robot);
        let cotangent = |disc: usize| {
            let number = disc as f64;
            PoseTangent {
                position: Vector3::new(number.sin(), number.cos(), 0.3),
                rotation: Vector3::new(0.1 * number, -0.2, number.sin()),
            }
        };
        let cotangents: Vec<_> = (0..robot.discs().len()).map(cotangent).collect();
        let cost = |poses: &[PoseTangent]| -> f64 {
            let terms = poses.iter().zip(&cotangents);
            let term = |(pose, own): (&PoseTangent, &PoseTangent)| {
                pose.position.dot(&own.position) + pose.rotation.dot(&own.rotation)
            };
            terms.map(term).sum()
        };
        let gradient = case.sensitivity.vjp(&cotangents);
        let close = |found: f64, expected: f64| {
            assert!(
                (found - expected).abs() < 1e-6 * (1.0 + expected.abs()),
                "{found} {expected}"
            );
        };
        for motion in [SHIFT, TURN] {
            let along = |own: &PoseTangent| {
                own.position.dot(&motion.position) + own.rotation.dot(&motion.rotation)
            };
            close(
                along(&gradient.base),
                cost(&case.sensitivity.by_base(&motion)),
            );
            for (index, own) in gradient.obstacles.iter().enumerate() {
                close(
                    along(&own.pose),
                    cost(&case.sensitivity.by_obstacle(index, &motion)),
                );
            }
        }
        for (index, own) in gradient.obstacles.iter().enumerate() {
            close(own.compliance, cost(&case.sensitivity.by_compliance(index)));
        }
    }
}

/// Compliances below 1e-8 m/N count as that, so that nothing changes with them.
#[test]
fn a_compliance_below_the_stiffest_has_no_derivative() {
    let robot = Robot::load("2m").unwrap();
    let command = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
    let command = robot.command(&command).unwrap();
    let turned = std::f64::consts::FRAC_1_SQRT_2;
    let settled = |compliance: f64| {
        let wall = Obstacle::half_space("wall")
            .at([-0.05, 0.0, 0.0])
            .with_orientation([turned, 0.0, turned, 0.0])
            .and_then(|wall| wall.with_compliance(compliance))
            .unwrap();
        let scene = Scene::new(vec![wall]).unwrap();
        let mut settler = ContactSettler::new(&robot, &scene);
        let found = settler.settle(&command, &Loads::default()).unwrap().clone();
        assert!(found.equilibrium.converged && !found.contacts.is_empty());
        let sensitivity = settler.sensitivity(&command, &Loads::default()).unwrap();
        let tip = sensitivity.by_compliance(0)[9].position;
        (found.equilibrium.positions[9], tip.norm())
    };
    let [harder, stiffest, softer] = [5e-9, 1e-8, 2e-8].map(settled);
    assert_eq!(harder.0, stiffest.0);
    assert_eq!(harder.1, 0.0);
    assert!(
        stiffest.1 > 0.1 && softer.1 > 0.1,
        "{stiffest:?} {softer:?}"
    );
}
