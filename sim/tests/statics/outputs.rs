//! What is read off an equilibrium besides the discs' poses: the curve between them, tool frames, the tip's compliance,
//! the joints' reactions.

use std::f64::consts::{FRAC_PI_4, PI};
use std::path::Path;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::curve::BackboneCurve;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::pose::{PoseTangent, ToolFrame};
use tdcr_sim::reactions::{joint_reactions, joint_reactions_with_friction};
use tdcr_sim::robot::{
    Axis, Backbone, Frame, Friction, Loads, Parameter, Payload, PerDisc, Robot, RobotSpec, Wrench,
};
use tdcr_sim::statics::Equilibrium;
use tdcr_sim::tendon_friction::FrictionPath;

use crate::random_robot::{Kind, random_robot, random_spec, within};

const LENGTH: f64 = 0.6;
const RADIUS: f64 = 8e-4;
const YOUNGS: f64 = 200e9;
const POISSON: f64 = 0.33;
const DENSITY: f64 = 7870.0;
/// Bending stiffness (N m²).
const BENDING: f64 = YOUNGS * FRAC_PI_4 * RADIUS * RADIUS * RADIUS * RADIUS;

/// A steel rod along z as a chain of discs without mass.
fn rod(discs: usize, gravity: [f64; 3]) -> Robot {
    let spec = format!(
        "name = \"rod\"
        gravity = {gravity:?}
        routing = \"base\"
        base = {{ position = [0.0, 0.0, 0.0], holes = [], hole_height = 0.0 }}
        [[modules]]
        discs = {discs}
        length = {LENGTH}
        joint_below = {}
        radius = 0.0008
        half_height = 0.001
        mass = {{ density = 0.0 }}
        holes = []
        damping = 0.0
        armature = 0.0
        rod = {{ youngs = {YOUNGS:?}, poisson = {POISSON}, radius = {RADIUS}, density = {DENSITY:?} }}",
        LENGTH / discs as f64 / 2.0
    );
    Robot::new(RobotSpec::from_toml(&spec, Path::new("robot.toml")).unwrap()).unwrap()
}

fn settle(robot: &Robot, loads: &Loads) -> Equilibrium {
    let settled = robot.settle(&robot.mean_command(), loads);
    assert!(settled.converged, "{}", settled.residual);
    settled
}

fn push(disc: usize, force: [f64; 3], moment: [f64; 3], frame: Frame) -> Loads {
    let wrench = Wrench {
        force,
        moment,
        ..Wrench::none(disc, frame)
    };
    Loads::default().with_wrench(wrench).unwrap()
}

fn assert_close(found: f64, expected: f64, tolerance: f64) {
    let error = (found - expected).abs();
    assert!(error <= tolerance, "{found} where {expected} is expected");
}

/// Euler and Bernoulli's cantilever: `L³/3EI`, `L²/2EI`, `L/EI`, and `L/GJ` in torsion.
#[test]
fn the_tip_of_a_cantilever_has_the_compliance_of_the_textbooks() {
    let robot = rod(100, [0.0; 3]);
    let (command, loads) = (robot.mean_command(), Loads::default());
    let sensitivity = (robot.sensitivity(&command, &loads, &settle(&robot, &loads))).unwrap();
    let tip = ToolFrame {
        disc: 99,
        in_disc: Isometry3::identity(),
    };
    let compliance = sensitivity.compliance(&tip).unwrap();
    let torsion = BENDING / (1.0 + POISSON);
    let mut expected = nalgebra::Matrix6::zeros();
    for axis in 0..2 {
        expected[(axis, axis)] = LENGTH.powi(3) / (3.0 * BENDING);
        expected[(3 + axis, 3 + axis)] = LENGTH / BENDING;
    }
    expected[(5, 5)] = LENGTH / torsion;
    // A force along x turns the tip about y, one along y about -x.
    for (force, moment, sign) in [(0, 4, 1.0), (1, 3, -1.0)] {
        let both = sign * LENGTH.powi(2) / (2.0 * BENDING);
        expected[(force, moment)] = both;
        expected[(moment, force)] = both;
    }
    for (row, column) in (0..36).map(|k| (k / 6, k % 6)) {
        let scale = (expected[(row, row)] * expected[(column, column)]).sqrt();
        let tolerance = 3e-5 * scale + 1e-15;
        assert_close(
            compliance[(row, column)],
            expected[(row, column)],
            tolerance,
        );
    }
}

/// Bent far, on a point off the disc, with a following load besides.
#[test]
fn compliance_is_the_derivative_by_a_wrench_on_the_tool() {
    let robot = rod(20, [0.0, 3.0, -9.81]);
    let command = robot.mean_command();
    let loads = push(19, [0.1, 0.05, 0.02], [0.02, 0.03, 0.01], Frame::Disc);
    let settled = settle(&robot, &loads);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.3, 0.2));
    let tool = ToolFrame {
        disc: 16,
        in_disc: Isometry3::from_parts(Vector3::new(0.02, -0.03, 0.05).into(), turn),
    };
    let sensitivity = robot.sensitivity(&command, &loads, &settled).unwrap();
    let compliance = sensitivity.compliance(&tool).unwrap();
    let step = 1e-4;
    for column in 0..6 {
        let moved = |by: f64| {
            let component = |first: usize| {
                std::array::from_fn(|axis| if first + axis == column { by } else { 0.0 })
            };
            let wrench = Wrench {
                point: tool.in_disc.translation.vector.into(),
                force: component(0),
                moment: component(3),
                ..Wrench::none(tool.disc, Frame::World)
            };
            let loads = loads.clone().with_wrench(wrench).unwrap();
            tool.pose(&settle(&robot, &loads).pose())
        };
        let [low, high] = [-step, step].map(moved);
        let shift = (high.translation.vector - low.translation.vector) / (2.0 * step);
        let turn = (high.rotation * low.rotation.inverse()).scaled_axis() / (2.0 * step);
        for axis in 0..3 {
            assert_close(compliance[(axis, column)], shift[axis], 2e-5);
            assert_close(compliance[(3 + axis, column)], turn[axis], 2e-4);
        }
    }
    // The same by parameters: a force on the disc's origin.
    let forces = Axis::ALL.map(|axis| Parameter::Force(tool.disc, axis));
    let jacobian = sensitivity.tool_jacobian(&tool, &forces).unwrap();
    let at_origin = ToolFrame {
        disc: tool.disc,
        in_disc: Isometry3::identity(),
    };
    let arm = tool.arm(&settled.pose());
    let of_disc = sensitivity.compliance(&at_origin).unwrap();
    for column in 0..3 {
        let [shift, turn] = [0, 3].map(|row| of_disc.fixed_view::<3, 1>(row, column).into_owned());
        let expected = shift + turn.cross(&arm);
        for axis in 0..3 {
            assert_close(jacobian[(axis, column)], expected[axis], 1e-12);
            assert_close(jacobian[(3 + axis, column)], turn[axis], 1e-12);
        }
    }
}

#[test]
fn a_tool_moves_with_the_joints_below_it() {
    let robot = Robot::load("2m").unwrap();
    let settled = robot.settle(
        &robot.command(&[0.03, 0.01, 0.0, 0.02, 0.03, 0.01]).unwrap(),
        &Loads::default(),
    );
    let tool = ToolFrame {
        disc: 6,
        in_disc: Isometry3::translation(0.01, 0.02, 0.03),
    };
    let jacobian = tool.joint_jacobian(&robot, &settled.configuration);
    let mut moved = settled.clone();
    let step = 1e-6;
    for column in 0..robot.dof() {
        let [low, high] = [-step, step].map(|by| {
            let mut turns = vec![0.0; robot.dof()];
            turns[column] = by;
            (settled.configuration).retract(&robot, &turns, &mut moved.configuration);
            (moved.positions, moved.orientations) = moved.configuration.place(&robot);
            tool.pose(&moved.pose())
        });
        let shift = (high.translation.vector - low.translation.vector) / (2.0 * step);
        let turn = (high.rotation * low.rotation.inverse()).scaled_axis() / (2.0 * step);
        for axis in 0..3 {
            assert_close(jacobian[(axis, column)], shift[axis], 1e-8);
            assert_close(jacobian[(3 + axis, column)], turn[axis], 1e-8);
        }
    }
    // Tangents and cotangents are each other's transposes.
    let pose = settled.pose();
    let some = |a: f64| PoseTangent {
        position: Vector3::new(a, 0.3, -0.2 * a),
        rotation: Vector3::new(0.7, -a, 0.1),
    };
    let work = |a: &PoseTangent, b: &PoseTangent| {
        a.position.dot(&b.position) + a.rotation.dot(&b.rotation)
    };
    let there = work(&tool.tangent(&pose, &some(0.4)), &some(-1.1));
    let back = work(&some(0.4), &tool.cotangent(&pose, &some(-1.1)));
    assert_close(there, back, 1e-14);
    let face = ToolFrame::tip_face(&robot);
    let half_height = robot.discs()[9].half_height;
    let height = settled.orientations[9] * Vector3::z() * half_height;
    let found = face.pose(&pose).translation.vector;
    assert!((found - settled.positions[9] - height).norm() < 1e-15);
}

/// A moment at the tip bends the rod to an arc of radius `EI/M`.
#[test]
fn the_curve_of_a_bent_rod_is_an_arc_to_second_order() {
    let moment = 2.0 * BENDING / LENGTH;
    let radius = BENDING / moment;
    let errors = [10, 20, 40].map(|discs| {
        let robot = rod(discs, [0.0; 3]);
        let loads = push(discs - 1, [0.0; 3], [moment, 0.0, 0.0], Frame::World);
        let curve = BackboneCurve::new(&robot, &settle(&robot, &loads).pose());
        let off = |share: f64| {
            let angle = share * LENGTH / radius;
            let place = Vector3::new(0.0, radius * (angle.cos() - 1.0), radius * angle.sin());
            let frame = curve.at(share * LENGTH).unwrap();
            let turned = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle);
            let turn = frame.rotation.angle_to(&turned);
            [(frame.translation.vector - place).norm(), turn]
        };
        let errors = [0.07, 0.33, 0.51, 0.77, 0.98].map(off);
        [0, 1].map(|k| errors.iter().map(|error| error[k]).fold(0.0, f64::max))
    });
    for pair in errors.windows(2) {
        assert!(pair[0][0] / pair[1][0] > 3.8, "{errors:?}");
    }
    assert!(errors[2][0] < 2e-4 * LENGTH, "{errors:?}");
    // The frames of an arc are met between the discs, too.
    assert!(errors.iter().all(|[_, turn]| *turn < 1e-3), "{errors:?}");
}

#[test]
fn the_curve_converges_with_the_square_of_the_pitch_in_space() {
    let frames = |discs: usize| {
        let robot = rod(discs, [0.0, 5.0, -9.81]);
        let (force, moment) = ([0.1, -0.05, 0.1], [0.03, 0.02, 0.04]);
        let loads = Loads::default()
            .with_backbone_wrench(&robot, 0.31 * LENGTH, force, moment, Frame::World)
            .and_then(|l| l.with_backbone_wrench(&robot, LENGTH, force, moment, Frame::Disc));
        let curve = BackboneCurve::new(&robot, &settle(&robot, &loads.unwrap()).pose());
        [0.11, 0.4, 0.63, 0.87, 1.0].map(|share| curve.at(share * LENGTH).unwrap())
    };
    let limit = frames(800);
    let errors = [25, 50, 100].map(|discs| {
        let pairs = frames(discs).into_iter().zip(&limit);
        pairs.fold([0.0, 0.0], |[shift, turn]: [f64; 2], (frame, exact)| {
            let apart = frame.translation.vector - exact.translation.vector;
            let turned = frame.rotation.angle_to(&exact.rotation);
            [shift.max(apart.norm()), turn.max(turned)]
        })
    });
    for k in 0..2 {
        let order = (errors[0][k] / errors[2][k]).log2() / 2.0;
        assert!(order > 1.8, "order {order}: {errors:?}");
    }
}

#[test]
fn the_curve_runs_through_the_discs_along_its_own_tangent() {
    let robot = rod(12, [0.0, 9.81, 0.0]);
    let settled = settle(
        &robot,
        &push(11, [0.1, 0.0, 0.1], [0.0, 0.03, 0.02], Frame::World),
    );
    let curve = BackboneCurve::new(&robot, &settled.pose());
    for (disc, arc_length) in robot.arc_lengths().into_iter().enumerate() {
        let frame = curve.at(arc_length.min(curve.length())).unwrap();
        assert!((frame.translation.vector - settled.positions[disc]).norm() < 1e-12);
        assert!(frame.rotation.angle_to(&settled.orientations[disc]) < 1e-7);
    }
    for index in 1..100 {
        let at = |by: f64| {
            curve
                .at(curve.length() * (f64::from(index) + by) / 100.0)
                .unwrap()
        };
        let apart = at(1e-4).translation.vector - at(-1e-4).translation.vector;
        let along = at(0.0) * Vector3::z();
        assert!(along.cross(&apart.normalize()).norm() < 1e-4, "{index}");
        assert_close(apart.norm(), 2e-6 * curve.length(), 2e-8 * curve.length());
    }
    assert!(curve.at(-1e-9).is_none() && curve.at(0.61).is_none());
    assert!(curve.at(f64::NAN).is_none());
    assert_eq!(curve.sample(7).len(), 7);
    assert_eq!(curve.sample(7)[6], curve.at(curve.length()).unwrap());
}

/// Shear `P + w (L - s)` and bending moment `P (L - s) + w (L - s)² / 2` of a cantilever that hardly bends.
#[test]
fn the_reactions_of_a_cantilever_are_those_of_the_textbooks() {
    let weight = 1e-4;
    let line = weight * DENSITY * PI * RADIUS * RADIUS;
    let robot = rod(50, [weight, 0.0, 0.0]);
    let force = 1e-5;
    let loads = push(49, [force, 0.0, 0.0], [0.0; 3], Frame::World);
    let settled = settle(&robot, &loads);
    let reactions = joint_reactions(&robot, &settled.pose(), &loads).unwrap();
    for (k, reaction) in reactions.iter().enumerate() {
        let left = LENGTH * (1.0 - (k as f64 + 0.5) / 50.0);
        assert_close(reaction.force.x, -(force + line * left), 1e-12);
        assert_close(reaction.force.y.hypot(reaction.force.z), 0.0, 1e-12);
        let moment = -(force * left + line * left * left / 2.0);
        assert_close(reaction.moment.y, moment, 1e-7 * force * LENGTH);
    }
}

/// The moment that backbone and limit put on a disc, by differences of their energy, world frame.
fn elastic_moment(robot: &Robot, settled: &Equilibrium, disc: usize) -> Vector3<f64> {
    let q = settled.configuration.0[disc];
    let body = &robot.discs()[disc];
    let energy = |turn: Vector3<f64>| {
        let q = q * UnitQuaternion::from_scaled_axis(turn);
        let bent = body.backbone.map_or(0.0, |backbone| {
            let rest = UnitQuaternion::from_scaled_axis(Vector3::from(backbone.rest));
            let phi = (rest.inverse() * q).scaled_axis();
            let [x, y] = backbone.bending;
            0.5 * (x * phi.x.powi(2) + y * phi.y.powi(2) + backbone.torsion * phi.z.powi(2))
        });
        let limited = body.limit.map_or(0.0, |limit| {
            0.5 * limit.stiffness * (q.angle() - limit.angle).max(0.0).powi(2)
        });
        bent + limited
    };
    let h = 1e-5;
    let moment = Vector3::from_fn(|axis, _| {
        let turn = Vector3::ith(axis, h);
        (energy(-turn) - energy(turn)) / (2.0 * h)
    });
    settled.orientations[disc] * moment
}

#[test]
fn joints_bear_what_their_backbones_and_limits_do() {
    let mut rng = ChaCha8Rng::seed_from_u64(61);
    let mut checked = 0;
    for _ in 0..30 {
        let robot = random_robot(Kind::Elastic, &mut rng);
        let last = robot.discs().len() - 1;
        let mut three = |size: f64| std::array::from_fn(|_| within(-size, size, &mut rng));
        let payload = Payload {
            mass: 0.01,
            offset: three(0.02),
        };
        let mut loads = (Loads::default().with_payload(payload))
            .and_then(|loads| loads.with_line_load(three(0.1)))
            .unwrap();
        for (disc, frame) in [(last, Frame::Disc), (last / 2, Frame::World)] {
            let wrench = Wrench {
                disc,
                point: three(0.02),
                force: three(0.05),
                moment: three(2e-3),
                frame,
            };
            loads = loads.with_wrench(wrench).unwrap();
        }
        let settled = robot.settle(&robot.random_command(&mut rng), &loads);
        if settled.residual > 1e-9 {
            continue;
        }
        checked += 1;
        let reactions = joint_reactions(&robot, &settled.pose(), &loads).unwrap();
        for (disc, reaction) in reactions.iter().enumerate() {
            let elastic = elastic_moment(&robot, &settled, disc);
            let error = (reaction.moment - elastic).norm();
            assert!(error < 3e-9, "{error} N m at joint {disc}");
        }
    }
    assert!(checked >= 25, "{checked} of 30 robots settled");
    let robot = Robot::load("2m").unwrap();
    let settled = settle(&robot, &Loads::default());
    let loads = push(10, [1.0; 3], [0.0; 3], Frame::World);
    assert!(joint_reactions(&robot, &settled.pose(), &loads).is_err());
}

/// Drawn apart, with no joint turned, the discs of a module take the energy that the joints' forces hold back: the principle
/// of virtual work.
#[test]
fn the_forces_on_joints_are_the_energys_derivatives_by_the_pitch() {
    let mut rng = ChaCha8Rng::seed_from_u64(62);
    let mut checked = 0;
    while checked < 12 {
        let mut spec = random_spec(Kind::Elastic, &mut rng);
        spec.modules[0].discs = spec.modules[0].discs.max(2);
        let Ok(robot) = Robot::new(spec.clone()) else {
            continue;
        };
        if spec.modules[0].rod.is_some()
            || Stepper::new(&robot, 1e-3, Integrator::default()).is_err()
        {
            continue;
        }
        let command = robot.random_command(&mut rng);
        let last = robot.discs().len() - 1;
        let loads = push(last, [0.1, -0.2, 0.3], [0.0; 3], Frame::World);
        let settled = robot.settle(&command, &loads);
        if !settled.converged {
            continue;
        }
        let reactions = joint_reactions(&robot, &settled.pose(), &loads).unwrap();
        let by_pitch: f64 = (1..spec.modules[0].discs)
            .map(|disc| {
                let below = settled.orientations[disc - 1] * Vector3::z();
                reactions[disc].force.dot(&below)
            })
            .sum();
        let state = State::at_rest(settled.configuration.clone());
        let [low, high] = [-1e-6, 1e-6].map(|by| {
            let mut spec = spec.clone();
            spec.modules[0].pitch += by;
            let robot = Robot::new(spec).unwrap();
            let mut stepper = Stepper::new(&robot, 1e-3, Integrator::default()).unwrap();
            stepper.energy(&state, &command, &loads).unwrap().potential
        });
        let slope = (high - low) / 2e-6;
        assert_close(by_pitch, slope, 1e-5 * (1.0 + slope.abs()));
        checked += 1;
    }
}

/// With friction, each piece of a tendon pulls with its own tension.
#[test]
fn reactions_balance_along_a_path_with_friction() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
        if let Some(tendons) = &mut module.tendons {
            tendons.friction = Some(Friction {
                coefficient: 0.3,
                contact_stiffness: 1e5,
            });
        }
    }
    let robot = Robot::new(spec).unwrap();
    let loads = Loads::payload(0.02).unwrap();
    let mut path = FrictionPath::new(&robot);
    for first in [0.03, 0.01] {
        let command = robot
            .command(&[first, 0.03, 0.03, 0.03, 0.02, 0.03])
            .unwrap();
        path.advance(&command, &loads);
    }
    let state = path.state();
    assert!(state.equilibrium.converged);
    let along = &state.tendons[0].tensions;
    assert!(along[0] > 1.01 * along[along.len() - 1], "{along:?}");
    let reactions = joint_reactions_with_friction(&robot, state, &loads).unwrap();
    let without = joint_reactions(&robot, &state.equilibrium.pose(), &loads).unwrap();
    let mut apart: f64 = 0.0;
    for (disc, reaction) in reactions.iter().enumerate() {
        let elastic = elastic_moment(&robot, &state.equilibrium, disc);
        assert!((reaction.moment - elastic).norm() < 3e-9);
        apart = apart.max((without[disc].moment - elastic).norm());
    }
    assert!(apart > 1e-4, "friction changes the moments: {apart}");
}
