//! Gradients of motions by everything that they depend on, against differences of motions.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{
    DynamicsError, Integrator, Lineariser, Rollout, RolloutDirection, RolloutGradient, State,
    StateCotangent, Stepper, rollout_gradient, rollout_tangent,
};
use tdcr_sim::pose::{PoseTangent, joint_cotangent, rotation_cotangent};
use tdcr_sim::robot::{
    Axis, Backbone, Body, Frame, Loads, MassSpec, Parameter, Payload, PerDisc, Robot, RobotSpec,
    RodDamping, RodSpec, SolidMass, Wrench,
};

use super::derivatives::{inner_command, nudged, nudged_command, random_rollout};
use super::{all_loads, random_robots, random_state, without_kinks};
use crate::random_robot::within;

const TIMESTEP: f64 = 0.002;

/// Every parameter of motions that a robot has.
fn all_parameters(spec: &RobotSpec) -> Vec<Parameter> {
    let (modules, tip) = (spec.modules.len(), spec.disc_count() - 1);
    let mut all = vec![Parameter::Payload, Parameter::Command(0)];
    for axis in Axis::ALL {
        all.extend([Parameter::Force(tip, axis), Parameter::Moment(1, axis)]);
    }
    let tendons = 0..spec.tendons().len();
    all.extend(tendons.flat_map(|t| [Parameter::Gain(t), Parameter::AxialStiffness(t)]));
    for m in 0..modules {
        all.extend([
            Parameter::Bending(m, Axis::X),
            Parameter::Bending(m, Axis::Y),
            Parameter::Torsion(m),
            Parameter::Youngs(m),
            Parameter::Density(m),
            Parameter::Pitch(m),
            Parameter::Damping(m),
            Parameter::Armature(m),
            Parameter::HingeStiffness(m, 0),
            Parameter::HingeStiffness(m, 1),
        ]);
    }
    let bodies = [Body::Base, Body::Disc(0), Body::Disc(tip)];
    all.extend(bodies.iter().flat_map(|&body| {
        [
            Parameter::HoleRadius(body),
            Parameter::Hole(body, 0, Axis::X),
            Parameter::Hole(body, 1, Axis::Y),
        ]
    }));
    let of_robot = |parameter: &Parameter| {
        matches!(
            parameter,
            Parameter::Payload
                | Parameter::Command(_)
                | Parameter::Force(..)
                | Parameter::Moment(..)
        ) || spec.value(*parameter).is_ok()
    };
    all.retain(of_robot);
    all
}

/// A motion as a function of its parameters, and a cost whose derivatives by the states are constant.
struct Case {
    spec: RobotSpec,
    rollout: Rollout,
    weights: Vec<StateCotangent>,
}

impl Case {
    fn random(robot: &Robot, steps: usize, rng: &mut ChaCha8Rng) -> Self {
        let rollout = random_rollout(robot, steps, rng);
        let n = robot.discs().len();
        let mut number = || within(-1.0, 1.0, rng);
        let mut weights = || StateCotangent {
            coordinates: (0..6 * n).map(|_| 0.1 * number()).collect(),
            poses: (0..n)
                .map(|_| PoseTangent {
                    position: Vector3::from_fn(|_, _| 10.0 * number()),
                    rotation: Vector3::from_fn(|_, _| number()),
                })
                .collect(),
        };
        Self {
            spec: robot.spec().clone(),
            weights: (0..=steps).map(|_| weights()).collect(),
            rollout,
        }
    }

    fn states(&self) -> (Robot, Vec<State>) {
        let robot = Robot::new(self.spec.clone()).unwrap();
        let mut stepper = Stepper::new(&robot, TIMESTEP, Integrator::SemiImplicitEuler).unwrap();
        let mut states = vec![self.rollout.start.clone()];
        states.extend(stepper.rollout(&self.rollout).unwrap());
        (robot, states)
    }

    fn gradient(&self, parameters: &[Parameter]) -> RolloutGradient {
        let (robot, states) = self.states();
        let cost = |k: usize, state: &State, cotangent: &mut StateCotangent| {
            assert_eq!(state, &states[k]);
            assert!(cotangent.coordinates.iter().all(|x| *x == 0.0));
            cotangent.clone_from(&self.weights[k]);
        };
        let states = &states[1..];
        rollout_gradient(&robot, TIMESTEP, &self.rollout, states, parameters, cost).unwrap()
    }

    /// The gradient, and that by parameters that may overlap: those that do not, at once.
    fn gradient_by(&self, parameters: &[Parameter]) -> (RolloutGradient, Vec<f64>) {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (place, &parameter) in parameters.iter().enumerate() {
            let fits = |group: &&mut Vec<usize>| {
                let apart =
                    |&other: &usize| !self.spec.parameters_overlap(parameters[other], parameter);
                group.iter().all(apart)
            };
            match groups.iter_mut().find(fits) {
                Some(group) => group.push(place),
                None => groups.push(vec![place]),
            }
        }
        let mut by_parameters = vec![f64::NAN; parameters.len()];
        for group in &groups {
            let named: Vec<_> = group.iter().map(|&place| parameters[place]).collect();
            let gradient = self.gradient(&named);
            for (&place, found) in group.iter().zip(&gradient.parameters) {
                by_parameters[place] = *found;
            }
        }
        (self.gradient(&[]), by_parameters)
    }

    /// A direction of everything, along a random half of the parameters that do not overlap.
    fn direction(&self, rng: &mut ChaCha8Rng) -> RolloutDirection {
        let robot = Robot::new(self.spec.clone()).unwrap();
        let mut parameters: Vec<(Parameter, f64)> = Vec::new();
        for parameter in all_parameters(&self.spec) {
            let apart =
                |(other, _): &(Parameter, f64)| !self.spec.parameters_overlap(*other, parameter);
            // A direction has the forces, moments and commands of its own.
            let own = !matches!(
                parameter,
                Parameter::Force(..) | Parameter::Moment(..) | Parameter::Command(_)
            );
            if own && parameters.iter().all(apart) && within(0.0, 1.0, rng) > 0.3 {
                parameters.push((parameter, within(-1.0, 1.0, rng) * self.step(parameter)));
            }
        }
        let (n, tendons) = (robot.discs().len(), robot.tendons().len());
        let mut some =
            |count: usize| -> Vec<f64> { (0..count).map(|_| within(-1.0, 1.0, rng)).collect() };
        let three = |v: Vec<f64>| -> Vec<Vector3<f64>> {
            v.as_chunks().0.iter().map(|v| Vector3::from(*v)).collect()
        };
        RolloutDirection {
            commands: self
                .rollout
                .commands
                .iter()
                .map(|_| some(tendons))
                .collect(),
            start: some(2 * robot.dof()),
            forces: three(some(3 * n)),
            moments: three(some(3 * n)),
            parameters,
        }
    }

    /// The motion with a parameter changed by `by`.
    fn moved(&self, parameter: Parameter, by: f64) -> Self {
        let mut moved = Self {
            spec: self.spec.clone(),
            rollout: self.rollout.clone(),
            weights: Vec::new(),
        };
        let robot = Robot::new(self.spec.clone()).unwrap();
        let loads = &mut moved.rollout.loads;
        let wrench = |wrench: Wrench| self.rollout.loads.clone().with_wrench(wrench).unwrap();
        match parameter {
            Parameter::Command(tendon) => {
                for command in &mut moved.rollout.commands {
                    *command = nudged_command(&robot, command, tendon, by);
                }
            }
            Parameter::Payload => {
                let payload = loads.tip_payload();
                let mass = payload.mass + by;
                *loads = (loads.clone())
                    .with_payload(Payload { mass, ..payload })
                    .unwrap();
            }
            Parameter::Force(disc, axis) => {
                let mut push = Wrench::none(disc, Frame::World);
                push.force[axis.index()] = by;
                *loads = wrench(push);
            }
            Parameter::Moment(disc, axis) => {
                let mut twist = Wrench::none(disc, Frame::World);
                twist.moment[axis.index()] = by;
                *loads = wrench(twist);
            }
            _ => {
                let value = self.spec.value(parameter).unwrap() + by;
                moved.spec = self.spec.with(&[(parameter, value)]).unwrap();
            }
        }
        moved
    }

    /// Step of a difference.
    fn step(&self, parameter: Parameter) -> f64 {
        match parameter {
            Parameter::Payload => 1e-3,
            Parameter::Force(..) => 1e-2,
            Parameter::Moment(..) => 1e-3,
            Parameter::Command(_) => 1e-4,
            Parameter::Hole(..) | Parameter::HoleRadius(_) | Parameter::Pitch(_) => 1e-5,
            // The lightest joint has a tenth of the mean.
            Parameter::Armature(_) => 1e-5,
            _ => 1e-2 * self.spec.value(parameter).unwrap().max(1e-3),
        }
    }

    /// The change of the cost from one motion to another near it.
    fn change(&self, from: &Self, to: &Self) -> f64 {
        let [(a, from), (b, to)] = [from, to].map(Self::states);
        let mut sum = 0.0;
        for (weights, (from, to)) in self.weights.iter().zip(from.iter().zip(&to)) {
            let coordinates = super::difference(&a, from, to);
            let by = weights.coordinates.iter().zip(&coordinates);
            sum += by.map(|(weight, change)| weight * change).sum::<f64>();
            let [before, after] = [orientations(&a, from), orientations(&b, to)];
            let places = from.positions(&a).into_iter().zip(to.positions(&b));
            let turns = before.iter().zip(&after);
            for (weight, ((p, moved), (q, turned))) in weights.poses.iter().zip(places.zip(turns)) {
                let turn = (turned * q.inverse()).scaled_axis();
                sum += weight.position.dot(&(moved - p)) + weight.rotation.dot(&turn);
            }
        }
        sum
    }

    /// Central differences to fourth order.
    fn numeric(&self, size: f64, moved: impl Fn(f64) -> Self) -> f64 {
        let central = |h: f64| self.change(&moved(-h), &moved(h)) / (2.0 * h);
        (4.0 * central(size / 2.0) - central(size)) / 3.0
    }
}

/// Orientations of the discs in the world.
fn orientations(robot: &Robot, state: &State) -> Vec<UnitQuaternion<f64>> {
    let [w, x, y, z] = robot.spec().base.orientation;
    let mut turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    (state.configuration.0.iter())
        .map(|q| {
            turn *= q;
            turn
        })
        .collect()
}

/// Relative to the change of the cost that a step makes where it is large: differences of sums lose digits.
fn assert_near(found: f64, expected: f64, size: f64, what: &str) {
    let close = 1e-6 * expected.abs() + 1e-10 / size;
    assert!(
        (found - expected).abs() <= close,
        "{what}: {found} and {expected}"
    );
}

fn assert_parameters(case: &Case, label: &str) {
    let parameters = all_parameters(&case.spec);
    let (gradient, by_parameters) = case.gradient_by(&parameters);
    for (&parameter, found) in parameters.iter().zip(&by_parameters) {
        let size = case.step(parameter);
        let expected = case.numeric(size, |by| case.moved(parameter, by));
        assert_near(*found, expected, size, &format!("{label}: {parameter}"));
    }
    // The command's is the sum of the steps' own; wrenches are parameters too.
    let named = |parameter: Parameter| {
        let at = parameters.iter().position(|p| *p == parameter).unwrap();
        by_parameters[at]
    };
    let all: f64 = gradient.commands.iter().map(|command| command[0]).sum();
    assert_near(all, named(Parameter::Command(0)), 1.0, "commands");
    let tip = case.spec.disc_count() - 1;
    for axis in Axis::ALL {
        let (force, moment) = (gradient.forces[tip], gradient.moments[1]);
        assert_eq!(force[axis.index()], named(Parameter::Force(tip, axis)));
        assert_eq!(moment[axis.index()], named(Parameter::Moment(1, axis)));
    }
}

#[test]
fn gradients_by_parameters_are_differences_of_motions() {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    for (index, robot) in random_robots(6, &mut rng).iter().enumerate() {
        let robot = without_kinks(robot);
        let case = Case::random(&robot, 12, &mut rng);
        assert_parameters(&case, &format!("robot {index}"));
    }
}

/// The tangent along a direction, weighted, is the gradient of the weighted sum along it. Gradients are those of differences.
#[test]
fn the_tangent_is_what_the_gradient_is_the_adjoint_of() {
    let mut rng = ChaCha8Rng::seed_from_u64(47);
    for (index, robot) in random_robots(6, &mut rng).iter().enumerate() {
        let case = Case::random(&without_kinks(robot), 8, &mut rng);
        let direction = case.direction(&mut rng);
        let (robot, states) = case.states();
        let tangents =
            rollout_tangent(&robot, TIMESTEP, &case.rollout, &states[1..], &direction).unwrap();
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let vectors = |a: &[Vector3<f64>], b: &[Vector3<f64>]| -> f64 {
            a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
        };
        let mut forward = 0.0;
        for (weights, tangent) in case.weights[1..].iter().zip(&tangents) {
            forward += dot(&weights.coordinates, &tangent.coordinates);
            for (weight, pose) in weights.poses.iter().zip(&tangent.poses) {
                forward +=
                    weight.position.dot(&pose.position) + weight.rotation.dot(&pose.rotation);
            }
        }
        // The weights of the start are no part of the tangents.
        let mut after = case;
        after.weights[0].coordinates.fill(0.0);
        after.weights[0].poses.fill(PoseTangent::default());
        let named: Vec<_> = direction.parameters.iter().map(|(p, _)| *p).collect();
        let gradient = after.gradient(&named);
        let rates: Vec<f64> = direction.parameters.iter().map(|(_, by)| *by).collect();
        let parts = [
            dot(&gradient.commands.concat(), &direction.commands.concat()),
            dot(&gradient.start, &direction.start),
            vectors(&gradient.forces, &direction.forces),
            vectors(&gradient.moments, &direction.moments),
            dot(&gradient.parameters, &rates),
        ];
        let scale: f64 = parts.iter().map(|part| part.abs()).sum();
        let backward: f64 = parts.iter().sum();
        assert!(
            (forward - backward).abs() <= 1e-9 * scale,
            "robot {index}: {forward} and {backward} of {scale}"
        );
    }
}

#[test]
fn they_are_so_with_rods_whose_mass_the_pitch_moves() {
    let mut rng = ChaCha8Rng::seed_from_u64(42);
    let mut spec = RobotSpec::standard("3m").unwrap();
    for (m, module) in spec.modules.iter_mut().enumerate() {
        module.clocking = 0.3 * m as f64;
        module.mass = MassSpec::Solid(PerDisc::Uniform(SolidMass {
            density: 300.0,
            centre_of_mass: [0.0, 0.0, -0.002],
        }));
        module.joint_below = 0.006;
        module.rod = (m < 2).then_some(RodSpec {
            youngs: 60e9,
            poisson: 0.3,
            radius: 6e-4,
            density: 7870.0,
            damping: RodDamping {
                bending: 3e-3,
                torsion: 2e-3,
            },
        });
        module.backbone = (m == 2).then_some(PerDisc::Uniform(Backbone::isotropic(0.4)));
    }
    let robot = Robot::new(spec).unwrap();
    let case = Case::random(&robot, 12, &mut rng);
    assert_parameters(&case, "rods");
}

#[test]
fn gradients_by_start_and_commands_are_differences_of_motions() {
    let mut rng = ChaCha8Rng::seed_from_u64(43);
    let robot = without_kinks(&random_robots(1, &mut rng)[0]);
    let case = Case::random(&robot, 12, &mut rng);
    let gradient = case.gradient(&[]);
    let other = |rollout: Rollout| Case {
        spec: case.spec.clone(),
        rollout,
        weights: Vec::new(),
    };
    for (index, found) in gradient.start.iter().enumerate() {
        let expected = case.numeric(1e-4, |by| {
            let start = nudged(&robot, &case.rollout.start, index, by);
            other(Rollout {
                start,
                ..case.rollout.clone()
            })
        });
        assert_near(*found, expected, 1e-4, "start");
    }
    for step in [0, 5, 11] {
        for (tendon, found) in gradient.commands[step].iter().enumerate() {
            let expected = case.numeric(1e-3, |by| {
                let mut moved = case.rollout.clone();
                let command = &mut moved.commands[step];
                *command = nudged_command(&robot, command, tendon, by);
                other(moved)
            });
            assert_near(*found, expected, 1e-3, "command");
        }
    }
}

/// Two ways to the same numbers, kinks included: each on the side where the state lies.
#[test]
fn the_adjoint_of_a_step_is_the_transpose_of_its_linearisation() {
    let mut rng = ChaCha8Rng::seed_from_u64(44);
    for robot in random_robots(30, &mut rng) {
        let rollout = Rollout {
            start: random_state(&robot, &mut rng),
            commands: vec![inner_command(&robot, &mut rng)],
            loads: all_loads(&robot, &mut rng),
        };
        let mut stepper = Stepper::new(&robot, TIMESTEP, Integrator::SemiImplicitEuler).unwrap();
        let states = stepper.rollout(&rollout).unwrap();
        let after: Vec<f64> = (0..2 * robot.dof())
            .map(|_| within(-1.0, 1.0, &mut rng))
            .collect();
        let gradient = rollout_gradient(
            &robot,
            TIMESTEP,
            &rollout,
            &states,
            &[],
            |k, _, cotangent| {
                if k == 1 {
                    cotangent.coordinates.copy_from_slice(&after);
                }
            },
        )
        .unwrap();
        let mut lineariser = Lineariser::new(&robot, TIMESTEP).unwrap();
        let linear = lineariser
            .linearise(&rollout.start, &rollout.commands[0], &rollout.loads)
            .unwrap();
        let after = nalgebra::DVector::from_vec(after);
        for (found, expected) in [
            (&gradient.start, linear.a.tr_mul(&after)),
            (&gradient.commands[0], linear.b.tr_mul(&after)),
        ] {
            let scale = expected.amax();
            for (found, expected) in found.iter().zip(&expected) {
                assert!(
                    (found - expected).abs() < 1e-10 * scale,
                    "{found} and {expected} of {scale}"
                );
            }
        }
    }
}

#[test]
fn derivatives_by_poses_become_those_by_joints() {
    let mut rng = ChaCha8Rng::seed_from_u64(45);
    for robot in random_robots(5, &mut rng) {
        let state = random_state(&robot, &mut rng);
        let n = robot.discs().len();
        // A cost of the origins and of the numbers of the discs' quaternions.
        let weights: Vec<[f64; 7]> = (0..n)
            .map(|_| std::array::from_fn(|_| within(-1.0, 1.0, &mut rng)))
            .collect();
        let cost = |state: &State| -> f64 {
            let places = state.positions(&robot);
            let poses = places.iter().zip(orientations(&robot, state));
            let of_disc = |(w, (p, q)): (&[f64; 7], (&Vector3<f64>, UnitQuaternion<f64>))| {
                let numbers = [p.x, p.y, p.z, q.w, q.i, q.j, q.k];
                w.iter().zip(numbers).map(|(w, x)| w * x).sum::<f64>()
            };
            weights.iter().zip(poses).map(of_disc).sum()
        };
        let cotangents: Vec<PoseTangent> = (weights.iter().zip(orientations(&robot, &state)))
            .map(|(&[x, y, z, a, b, c, d], q)| PoseTangent {
                position: Vector3::new(x, y, z),
                rotation: rotation_cotangent(&q, [a, b, c, d]),
            })
            .collect();
        let found = joint_cotangent(&robot, &state.configuration, &cotangents);
        assert_eq!(found.len(), robot.dof());
        for (index, found) in found.iter().enumerate() {
            let [up, down] = [1e-5, -1e-5].map(|by| cost(&nudged(&robot, &state, index, by)));
            let expected = (up - down) / 2e-5;
            assert!((found - expected).abs() < 1e-8, "{found} and {expected}");
        }
    }
}

#[test]
fn what_has_no_gradient_is_refused_with_the_reason() {
    let robot = Robot::load("2m").unwrap();
    let rollout = Rollout {
        start: State::straight(&robot),
        commands: vec![robot.mean_command(); 2],
        loads: Loads::default(),
    };
    let mut stepper = Stepper::new(&robot, TIMESTEP, Integrator::default()).unwrap();
    let states = stepper.rollout(&rollout).unwrap();
    let gradient = |rollout: &Rollout, states: &[State], parameters: &[Parameter]| {
        rollout_gradient(
            &robot,
            TIMESTEP,
            rollout,
            states,
            parameters,
            |_, _, cotangent| {
                cotangent.coordinates.fill(1.0);
            },
        )
    };
    let message = gradient(&rollout, &states, &[Parameter::Youngs(1)])
        .unwrap_err()
        .to_string();
    assert!(message.contains("the module has no rod"), "{message}");
    let message = gradient(&rollout, &states[1..], &[])
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "the list of states has 1 entries; robot `2m` needs 2"
    );
    let other = State::straight(&Robot::load("3m").unwrap());
    let elsewhere = [states[0].clone(), other];
    let message = gradient(&rollout, &elsewhere, &[]).unwrap_err().to_string();
    assert_eq!(
        message,
        "the configuration has 15 entries; robot `2m` needs 10"
    );
    let mut fast = rollout.clone();
    fast.start.velocity[4] = 1e200;
    assert_eq!(
        gradient(&fast, &states, &[]).unwrap_err(),
        DynamicsError::NotDifferentiable
    );
}
