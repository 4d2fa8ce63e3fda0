//! One equilibrium as a function of its parameters, and its derivatives by differences.

use nalgebra::{DMatrix, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{
    Axis, Backbone, Body, Drive, Frame, Holes, Loads, MassSpec, ModuleSpec, Parameter, Payload,
    PerDisc, Robot, RobotSpec, TendonSpec, Wrench,
};
use tdcr_sim::sensitivity::{PoseTangent, Sensitivity};
use tdcr_sim::statics::{Equilibrium, Settler};

use crate::random_robot::{Kind, random_robot, within};

/// One equilibrium, as a function of its parameters.
#[derive(Clone)]
pub struct Case {
    pub spec: RobotSpec,
    pub command: Vec<f64>,
    pub loads: Loads,
}

impl Case {
    pub fn settle_from(&self, near: &Equilibrium) -> Equilibrium {
        let mut spec = self.spec.clone();
        // A command may be moved past its range: that is not what is tested.
        for module in &mut spec.modules {
            if let Some(tendons) = &mut module.tendons {
                tendons.range = [0.0, 100.0];
            }
        }
        spec.routes
            .iter_mut()
            .for_each(|route| route.tendon.range = [0.0, 100.0]);
        let robot = Robot::new(spec).unwrap();
        let command = robot.command(&self.command).unwrap();
        let mut settler = Settler::new(&robot);
        let mut settled = settler
            .settle_from(&near.configuration, &command, &self.loads)
            .clone();
        // Differences need more digits than a solve promises: nudged, it takes one more step.
        for nudge in 1..5 {
            if settled.residual < 1e-13 {
                break;
            }
            let mut start = settled.configuration.clone();
            let step: Vec<f64> = (0..robot.dof())
                .map(|i| 1e-6 * ((i * nudge) as f64).sin())
                .collect();
            settled.configuration.retract(&robot, &step, &mut start);
            settled = settler.settle_from(&start, &command, &self.loads).clone();
        }
        assert!(settled.converged, "{}", settled.residual);
        settled
    }

    /// The case with a parameter changed by `by`, written again from the specification's fields.
    pub fn moved(&self, parameter: Parameter, by: f64) -> Self {
        let mut moved = self.clone();
        let spec = &mut moved.spec;
        let joints = |module: &mut ModuleSpec, change: &dyn Fn(&mut Backbone)| match module
            .backbone
            .as_mut()
            .unwrap()
        {
            PerDisc::Uniform(backbone) => change(backbone),
            PerDisc::Each(each) => each.iter_mut().for_each(change),
        };
        let holes =
            |spec: &mut RobotSpec, body: Body, change: &dyn Fn(usize, [f64; 2]) -> [f64; 2]| {
                let module = match body {
                    Body::Base => None,
                    Body::Disc(disc) => spec.module_of(disc),
                };
                let holes = match module {
                    None => &mut spec.base.holes,
                    Some(module) => &mut spec.modules[module].holes,
                };
                let changed = holes
                    .positions()
                    .into_iter()
                    .enumerate()
                    .map(|(i, h)| change(i, h));
                *holes = Holes::At(changed.collect());
            };
        match parameter {
            Parameter::Command(t) => moved.command[t] += by,
            Parameter::Payload => {
                let payload = moved.loads.tip_payload();
                let mass = payload.mass + by;
                moved.loads = moved
                    .loads
                    .with_payload(Payload { mass, ..payload })
                    .unwrap();
            }
            Parameter::Force(disc, axis) => {
                let mut push = Wrench::none(disc, Frame::World);
                push.force[axis.index()] = by;
                moved.loads = moved.loads.with_wrench(push).unwrap();
            }
            Parameter::Moment(disc, axis) => {
                let mut twist = Wrench::none(disc, Frame::World);
                twist.moment[axis.index()] = by;
                moved.loads = moved.loads.with_wrench(twist).unwrap();
            }
            Parameter::Gain(t) => {
                if let Drive::Gain(gain) = &mut tendon_of(spec, t).drive {
                    *gain += by;
                }
            }
            Parameter::AxialStiffness(t) => {
                *tendon_of(spec, t).axial_stiffness.as_mut().unwrap() += by;
            }
            Parameter::Bending(m, axis) => {
                joints(&mut spec.modules[m], &|b| b.bending[axis.index()] += by);
            }
            Parameter::HingeStiffness(m, hinge) => match &mut spec.modules[m].joint {
                Some(PerDisc::Each(joints)) => {
                    (joints.iter_mut()).for_each(|joint| joint.hinges[hinge].stiffness += by)
                }
                other => panic!("{other:?}"),
            },
            Parameter::Torsion(m) => joints(&mut spec.modules[m], &|b| b.torsion += by),
            Parameter::Density(m) => match &mut spec.modules[m].mass {
                MassSpec::Density(PerDisc::Uniform(density)) => *density += by,
                MassSpec::Solid(PerDisc::Uniform(solid)) => solid.density += by,
                other => panic!("{other:?}"),
            },
            Parameter::Youngs(m) => spec.modules[m].rod.as_mut().unwrap().youngs += by,
            Parameter::Pitch(m) => spec.modules[m].pitch += by,
            Parameter::HoleRadius(body) => holes(spec, body, &|_, [x, y]| {
                let stretch = 1.0 + by / x.hypot(y);
                [x * stretch, y * stretch]
            }),
            Parameter::Hole(body, hole, axis) => holes(spec, body, &|index, mut place| {
                if index == hole {
                    place[axis.index()] += by;
                }
                place
            }),
            other => panic!("no change by {other:?} is written here"),
        }
        moved
    }
}

/// The specification of a tendon, by its place in a command. Modules share one among their tendons,
/// so a tendon of a module gets a module's worth of routes of its own beforehand: see [`own_routes`].
fn tendon_of(spec: &mut RobotSpec, tendon: usize) -> &mut TendonSpec {
    &mut spec.routes[tendon].tendon
}

/// The same robot with every tendon on a route of its own.
pub fn own_routes(robot: &Robot) -> RobotSpec {
    let mut spec = robot.spec().clone();
    let mut specs = Vec::new();
    for module in &mut spec.modules {
        if let Some(tendons) = module.tendons.take() {
            specs.extend(std::iter::repeat_n(tendons, module.holes.positions().len()));
        }
    }
    specs.extend(spec.routes.iter().map(|route| route.tendon.clone()));
    spec.routes = (specs.into_iter().zip(robot.tendons()))
        .map(|(tendon, laid)| tdcr_sim::robot::RouteSpec {
            through: laid.route.clone(),
            tendon,
        })
        .collect();
    spec
}

/// Every parameter that a robot has.
pub fn all_parameters(spec: &RobotSpec) -> Vec<(Parameter, f64)> {
    let mut all = Vec::new();
    for (t, route) in spec.routes.iter().enumerate() {
        let step = if route.tendon.drive == Drive::Tension {
            1e-2
        } else {
            1e-4
        };
        all.push((Parameter::Command(t), step));
        if let Drive::Gain(gain) = route.tendon.drive {
            all.push((Parameter::Gain(t), 1e-2 * gain));
        }
        if let (Some(axial), false) = (
            route.tendon.axial_stiffness,
            route.tendon.drive == Drive::Tension,
        ) {
            all.push((Parameter::AxialStiffness(t), 1e-2 * axial));
        }
    }
    all.push((Parameter::Payload, 1e-4));
    let tip = spec.disc_count() - 1;
    for axis in Axis::ALL {
        all.push((Parameter::Force(tip, axis), 1e-2));
        all.push((Parameter::Force(tip / 2, axis), 1e-2));
        all.push((Parameter::Moment(tip, axis), 2e-4));
    }
    let on_axis = |holes: &Holes| holes.positions().contains(&[0.0, 0.0]);
    if !on_axis(&spec.base.holes) {
        all.push((Parameter::HoleRadius(Body::Base), 1e-5));
    }
    all.push((Parameter::Hole(Body::Base, 1, Axis::X), 1e-5));
    let mut disc = 0;
    for (m, module) in spec.modules.iter().enumerate() {
        if module.backbone.is_some() {
            all.push((Parameter::Bending(m, Axis::X), 2e-3));
            all.push((Parameter::Bending(m, Axis::Y), 2e-3));
            all.push((Parameter::Torsion(m), 2e-3));
        }
        for hinge in 0..3 {
            let parameter = Parameter::HingeStiffness(m, hinge);
            if spec.value(parameter).is_ok() {
                all.push((parameter, 2e-3));
            }
        }
        if let Some(rod) = module.rod {
            all.push((Parameter::Youngs(m), 1e-2 * rod.youngs));
        }
        if let MassSpec::Density(PerDisc::Uniform(_)) | MassSpec::Solid(PerDisc::Uniform(_)) =
            module.mass
        {
            all.push((Parameter::Density(m), 1.0));
        }
        all.push((Parameter::Pitch(m), 1e-5));
        if !on_axis(&module.holes) {
            all.push((Parameter::HoleRadius(Body::Disc(disc)), 1e-5));
        }
        all.push((Parameter::Hole(Body::Disc(disc), 0, Axis::Y), 1e-5));
        disc += module.discs;
    }
    all
}

/// Poses of `b` relative to those of `a`: rows as in `Sensitivity::jacobian`.
fn difference(a: &Equilibrium, b: &Equilibrium) -> Vec<f64> {
    let mut rows = Vec::new();
    for i in 0..a.positions.len() {
        rows.extend((b.positions[i] - a.positions[i]).iter());
        let turn = (b.orientations[i] * a.orientations[i].inverse()).scaled_axis();
        rows.extend(turn.iter());
    }
    rows
}

/// Central differences to fourth order.
fn numeric(case: &Case, near: &Equilibrium, parameter: Parameter, h: f64) -> Vec<f64> {
    let central = |h: f64| {
        let [up, down] = [h, -h].map(|by| case.moved(parameter, by).settle_from(near));
        let rows = difference(&down, &up);
        rows.into_iter()
            .map(move |row| row / (2.0 * h))
            .collect::<Vec<_>>()
    };
    let (wide, narrow) = (central(h), central(h / 2.0));
    wide.iter()
        .zip(&narrow)
        .map(|(w, n)| (4.0 * n - w) / 3.0)
        .collect()
}

/// Asserts relative errors of 1e-6 at most, beyond what `noise` (m) in the settled poses does to the
/// differences; `false` where the robot does not settle.
pub fn derivatives_agree(case: &Case, label: &str, noise: f64) -> bool {
    let robot = Robot::new(case.spec.clone()).unwrap();
    let command = robot.command(&case.command).unwrap();
    let settled = robot.settle(&command, &case.loads);
    if !settled.converged {
        return false;
    }
    let sensitivity = robot.sensitivity(&command, &case.loads, &settled).unwrap();
    // Places of holes and their radii stand for the same numbers: one kind at a time.
    let place = |(parameter, _): &(Parameter, f64)| matches!(parameter, Parameter::Hole(..));
    let (places, others): (Vec<_>, Vec<_>) =
        all_parameters(&case.spec).into_iter().partition(place);
    for parameters in [others, places] {
        parameters_agree(
            case,
            &parameters,
            (&robot, &sensitivity, &settled),
            label,
            noise,
        );
    }
    true
}

fn parameters_agree(
    case: &Case,
    parameters: &[(Parameter, f64)],
    (robot, sensitivity, settled): (&Robot, &Sensitivity, &Equilibrium),
    label: &str,
    noise: f64,
) {
    let names: Vec<_> = parameters.iter().map(|(parameter, _)| *parameter).collect();
    let jacobian = sensitivity.jacobian(&names).unwrap();
    for (column, &(parameter, step)) in parameters.iter().enumerate() {
        // Small enough steps that the poses change little, where a small change does much.
        let step = step.min(5e-5 / jacobian.column(column).amax());
        let expected = numeric(case, settled, parameter, step);
        // Relative to the column: small entries are as uncertain as large ones.
        let scale = expected.iter().fold(0.0, |s: f64, x| s.max(x.abs()));
        let worst = (expected.iter().enumerate())
            .map(|(row, x)| (jacobian[(row, column)] - x).abs())
            .fold(0.0, f64::max);
        assert!(
            worst <= 1e-6 * scale + noise / step,
            "{label}: {parameter:?}: {worst:e} of {scale:e}"
        );
    }
    assert_products_agree(robot, sensitivity, &names, &jacobian);
}

pub const NOISE: f64 = 1e-12;

pub fn assert_derivatives_agree(case: &Case, label: &str) {
    assert!(derivatives_agree(case, label, NOISE), "{label} settles");
}

/// `jvp` and `vjp` are the Jacobian's products.
fn assert_products_agree(
    robot: &Robot,
    sensitivity: &Sensitivity,
    names: &[Parameter],
    jacobian: &DMatrix<f64>,
) {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let n = robot.discs().len();
    let mut three = || Vector3::from_fn(|_, _| within(-1.0, 1.0, &mut rng));
    let cotangents: Vec<_> = (0..n)
        .map(|_| PoseTangent {
            position: three(),
            rotation: three(),
        })
        .collect();
    let flat = |tangents: &[PoseTangent]| {
        let rows = tangents.iter().flat_map(|t| {
            t.position
                .iter()
                .chain(t.rotation.iter())
                .copied()
                .collect::<Vec<_>>()
        });
        nalgebra::DVector::from_iterator(6 * n, rows)
    };
    let direction: Vec<_> = names
        .iter()
        .map(|&name| (name, within(-1.0, 1.0, &mut rng)))
        .collect();
    let rates = nalgebra::DVector::from_iterator(names.len(), direction.iter().map(|d| d.1));
    let forward = flat(&sensitivity.jvp(&direction).unwrap());
    let expected = jacobian * &rates;
    assert!((&forward - &expected).amax() <= 1e-9 * expected.amax());
    let back = sensitivity.vjp(&cotangents, names).unwrap();
    let expected = jacobian.transpose() * flat(&cotangents);
    for (i, name) in names.iter().enumerate() {
        let scale = jacobian.column(i).amax() * (6 * n) as f64;
        assert!(
            (back[i] - expected[i]).abs() <= 1e-9 * scale,
            "{name:?}: {} {}",
            back[i],
            expected[i]
        );
    }
}

pub fn random_case(rng: &mut impl Rng) -> Case {
    let robot = random_robot(Kind::Elastic, rng);
    case_of(&robot, rng)
}

/// A robot under a payload and a random command.
pub fn case_of(robot: &Robot, rng: &mut impl Rng) -> Case {
    let payload = Payload {
        mass: 0.01,
        offset: [0.01, 0.0, 0.005],
    };
    Case {
        command: robot.random_command(rng).as_slice().to_vec(),
        spec: own_routes(robot),
        loads: Loads::default().with_payload(payload).unwrap(),
    }
}
