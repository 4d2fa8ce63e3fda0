//! Motions as functions of their parameters, and the derivatives of their costs by differences.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{
    Integrator, ObstacleTangent, Rollout, RolloutDirection, RolloutGradient, State, StateCotangent,
    Stepper, rollout_gradient,
};
use tdcr_sim::pose::PoseTangent;
use tdcr_sim::robot::{Axis, Body, Frame, Parameter, Payload, Robot, RobotSpec, Wrench};
use tdcr_sim::scene::Scene;

use super::super::derivatives::{nudged_command, random_rollout};
use super::super::difference;
use crate::random_robot::within;

pub const TIMESTEP: f64 = 0.002;

/// Every parameter of motions that a robot has.
pub fn all_parameters(spec: &RobotSpec) -> Vec<Parameter> {
    let (modules, tip) = (spec.modules.len(), spec.disc_count() - 1);
    let mut all = vec![Parameter::Payload, Parameter::Command(0)];
    for axis in Axis::ALL {
        all.extend([Parameter::Force(tip, axis), Parameter::Moment(1, axis)]);
    }
    let tendons = 0..spec.tendons().len();
    all.extend(tendons.flat_map(|t| {
        [
            Parameter::Gain(t),
            Parameter::AxialStiffness(t),
            Parameter::Friction(t),
        ]
    }));
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
    // Where there is no friction the law has a kink.
    let rubs = |parameter: &Parameter| spec.value(*parameter) != Ok(0.0);
    all.retain(|parameter| !matches!(parameter, Parameter::Friction(_)) || rubs(parameter));
    all
}

/// A motion as a function of its parameters, and a cost whose derivatives by the states are constant.
pub struct Case {
    pub spec: RobotSpec,
    pub rollout: Rollout,
    pub weights: Vec<StateCotangent>,
    /// What it is among, if anything.
    pub scene: Option<Scene>,
}

impl Case {
    pub fn random(robot: &Robot, steps: usize, rng: &mut ChaCha8Rng) -> Self {
        Self::of(robot, random_rollout(robot, steps, rng), rng)
    }

    pub fn of(robot: &Robot, rollout: Rollout, rng: &mut ChaCha8Rng) -> Self {
        let steps = rollout.commands.len();
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
            scene: None,
        }
    }

    /// Another motion of the robot, without a cost.
    pub fn with(&self, rollout: Rollout) -> Self {
        Self {
            spec: self.spec.clone(),
            rollout,
            weights: Vec::new(),
            scene: self.scene.clone(),
        }
    }

    fn stepper(&self, robot: &Robot) -> Stepper {
        Stepper::new(robot, TIMESTEP, Integrator::SemiImplicitEuler).unwrap()
    }

    /// A stepper among what the motion is among.
    pub fn among(&self, scene: &Scene) -> ContactStepper {
        let robot = Robot::new(self.spec.clone()).unwrap();
        ContactStepper::new(self.stepper(&robot), scene).unwrap()
    }

    pub fn states(&self) -> (Robot, Vec<State>) {
        let robot = Robot::new(self.spec.clone()).unwrap();
        let mut states = vec![self.rollout.start.clone()];
        states.extend(match &self.scene {
            Some(scene) => self.among(scene).rollout(&self.rollout).unwrap(),
            None => self.stepper(&robot).rollout(&self.rollout).unwrap(),
        });
        (robot, states)
    }

    pub fn gradient(&self, parameters: &[Parameter]) -> RolloutGradient {
        let (robot, states) = self.states();
        let cost = |k: usize, state: &State, cotangent: &mut StateCotangent| {
            assert_eq!(state, &states[k]);
            assert!(cotangent.coordinates.iter().all(|x| *x == 0.0));
            cotangent.clone_from(&self.weights[k]);
        };
        let (rollout, states) = (&self.rollout, &states[1..]);
        match &self.scene {
            Some(scene) => (self.among(scene)).rollout_gradient(rollout, states, parameters, cost),
            None => rollout_gradient(&robot, TIMESTEP, rollout, states, parameters, cost),
        }
        .unwrap()
    }

    /// The gradient, and that by parameters that may overlap: those that do not, at once.
    pub fn gradient_by(&self, parameters: &[Parameter]) -> (RolloutGradient, Vec<f64>) {
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
    pub fn direction(&self, rng: &mut ChaCha8Rng) -> RolloutDirection {
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
        let obstacles = self
            .scene
            .as_ref()
            .map_or(0, |scene| scene.obstacles().len());
        let obstacles = some(7 * obstacles);
        let of_obstacle = |&[x, y, z, a, b, c, softer]: &[f64; 7]| ObstacleTangent {
            pose: PoseTangent {
                position: Vector3::new(x, y, z),
                rotation: Vector3::new(a, b, c),
            },
            compliance: 0.05 * softer,
        };
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
            wrenches: match self.rollout.wrenches.is_empty() {
                true => Vec::new(),
                false => self
                    .rollout
                    .commands
                    .iter()
                    .map(|_| three(some(6 * n)).as_chunks().0.to_vec())
                    .collect(),
            },
            parameters,
            obstacles: obstacles.as_chunks().0.iter().map(of_obstacle).collect(),
            base: PoseTangent {
                position: Vector3::from_fn(|_, _| within(-1.0, 1.0, rng)),
                rotation: Vector3::from_fn(|_, _| within(-1.0, 1.0, rng)),
            },
        }
    }

    /// The motion with the base moved `by` along the first three of six axes, or rotated about the others.
    pub fn with_base_moved(&self, axis: usize, by: f64) -> Self {
        let mut moved = self.with(self.rollout.clone());
        let base = &mut moved.spec.base;
        match axis {
            0..3 => base.position[axis] += by,
            _ => {
                let [w, x, y, z] = base.orientation;
                let turn = Vector3::ith(axis - 3, by);
                let turned = UnitQuaternion::from_scaled_axis(turn)
                    * UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
                base.orientation = [turned.w, turned.i, turned.j, turned.k];
            }
        }
        moved
    }

    /// The motion with a parameter changed by `by`.
    pub fn moved(&self, parameter: Parameter, by: f64) -> Self {
        let mut moved = self.with(self.rollout.clone());
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
    pub fn step(&self, parameter: Parameter) -> f64 {
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
    pub fn change(&self, from: &Self, to: &Self) -> f64 {
        let [(a, from), (b, to)] = [from, to].map(Self::states);
        let mut sum = 0.0;
        for (weights, (from, to)) in self.weights.iter().zip(from.iter().zip(&to)) {
            let coordinates = difference(&a, from, to);
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
    pub fn numeric(&self, size: f64, moved: impl Fn(f64) -> Self) -> f64 {
        let central = |h: f64| self.change(&moved(-h), &moved(h)) / (2.0 * h);
        (4.0 * central(size / 2.0) - central(size)) / 3.0
    }
}

/// Orientations of the discs in the world.
pub fn orientations(robot: &Robot, state: &State) -> Vec<UnitQuaternion<f64>> {
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
pub fn assert_near(found: f64, expected: f64, size: f64, what: &str) {
    let close = 1e-6 * expected.abs() + 1e-10 / size;
    assert!(
        (found - expected).abs() <= close,
        "{what}: {found} and {expected}"
    );
}

/// The gradient by the base is that of differences by steps of `size` (m, rad).
pub fn assert_base(case: &Case, gradient: &PoseTangent, size: f64, label: &str) {
    let found = gradient.position.iter().chain(&gradient.rotation);
    for (axis, found) in found.enumerate() {
        let expected = case.numeric(size, |by| case.with_base_moved(axis, by));
        assert_near(*found, expected, size, &format!("{label}: base {axis}"));
    }
}

pub fn assert_parameters(case: &Case, label: &str) {
    let parameters = all_parameters(&case.spec);
    let (gradient, by_parameters) = case.gradient_by(&parameters);
    for (&parameter, found) in parameters.iter().zip(&by_parameters) {
        let size = case.step(parameter);
        let expected = case.numeric(size, |by| case.moved(parameter, by));
        assert_near(*found, expected, size, &format!("{label}: {parameter}"));
    }
    assert_base(case, &gradient.base, 1e-4, label);
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
