//! The parameters: values set and read, the command's, and what has no derivative.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::pose::PoseTangent;
use tdcr_sim::robot::{ActsOn, Axis, Body, Command, Holes, Loads, Parameter, Robot, RobotSpec};
use tdcr_sim::sensitivity::SensitivityError;

use super::case::{all_parameters, random_case};

#[test]
fn a_robot_with_another_value_differs_in_that_parameter_alone() {
    let mut rng = ChaCha8Rng::seed_from_u64(37);
    for _ in 0..20 {
        let case = random_case(&mut rng);
        for (parameter, by) in all_parameters(&case.spec) {
            let Ok(value) = case.spec.value(parameter) else {
                let of_loads = "commands and loads are not part of a robot's specification";
                let refused = case.spec.value(parameter).unwrap_err().to_string();
                assert!(refused.contains(of_loads), "{refused}");
                continue;
            };
            let with = case.spec.with(&[(parameter, value + by)]).unwrap();
            let found = with.value(parameter).unwrap();
            assert!(
                (found - value - by).abs() <= 1e-14 * value.abs().max(by),
                "{parameter}"
            );
            let [a, b] = [with, case.moved(parameter, by).spec].map(|spec| numbers(&spec));
            assert_eq!(a.len(), b.len(), "{parameter}");
            let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-14 * a.abs().max(1e-3);
            assert!(a.iter().zip(&b).all(near), "{parameter}");
        }
    }
}

/// All numbers of a specification, in order.
fn numbers(spec: &RobotSpec) -> Vec<f64> {
    fn collect(value: &serde_json::Value, numbers: &mut Vec<f64>) {
        match value {
            serde_json::Value::Number(number) => numbers.extend(number.as_f64()),
            serde_json::Value::Array(list) => list.iter().for_each(|v| collect(v, numbers)),
            serde_json::Value::Object(map) => map.values().for_each(|v| collect(v, numbers)),
            _ => {}
        }
    }
    let mut spec = spec.clone();
    // A circle of holes, once moved, is a list of them.
    let holes = spec.modules.iter_mut().map(|module| &mut module.holes);
    for holes in holes.chain([&mut spec.base.holes]) {
        *holes = Holes::At(holes.positions());
    }
    let mut numbers = Vec::new();
    collect(&serde_json::to_value(&spec).unwrap(), &mut numbers);
    numbers
}

#[test]
fn the_command_jacobian_is_that_of_the_command_parameters() {
    let robot = Robot::load("5m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(36);
    let command: Command = robot.random_command(&mut rng);
    let settled = robot.settle(&command, &Loads::default());
    let sensitivity = robot
        .sensitivity(&command, &Loads::default(), &settled)
        .unwrap();
    let all: Vec<_> = (0..15).map(Parameter::Command).collect();
    let by_parameters = sensitivity.jacobian(&all).unwrap();
    let difference = sensitivity.command_jacobian() - &by_parameters;
    assert!(difference.amax() <= 1e-12 * by_parameters.amax());
}

#[test]
fn what_cannot_be_differentiated_is_refused_by_name() {
    let robot = Robot::load("2m").unwrap();
    let command = robot.mean_command();
    let mut settled = robot.settle(&command, &Loads::default());
    let sensitivity = robot
        .sensitivity(&command, &Loads::default(), &settled)
        .unwrap();
    for (parameter, reason) in [
        (Parameter::Command(6), "no such tendon"),
        (Parameter::Bending(0, Axis::X), "the module has no backbone"),
        (Parameter::AxialStiffness(0), "the tendon is inextensible"),
        (Parameter::Force(10, Axis::X), "no such disc"),
        (Parameter::Pitch(2), "no such module"),
        (Parameter::Hole(Body::Disc(3), 3, Axis::X), "no such hole"),
        (
            Parameter::Hole(Body::Base, 0, Axis::Z),
            "holes move along x or y",
        ),
    ] {
        let error = sensitivity.jacobian(&[parameter]).unwrap_err().to_string();
        assert!(error.contains(reason) && error.contains("`2m`"), "{error}");
    }
    settled.converged = false;
    let refused = robot
        .sensitivity(&command, &Loads::default(), &settled)
        .unwrap_err();
    assert!(matches!(refused, SensitivityError::NotSettled(_)));
}

#[test]
fn parameters_of_the_same_numbers_are_refused_by_name() {
    let robot = Robot::load("2m").unwrap();
    let command = robot.mean_command();
    let settled = robot.settle(&command, &Loads::default());
    let sensitivity = robot
        .sensitivity(&command, &Loads::default(), &settled)
        .unwrap();
    let radius = |disc| Parameter::HoleRadius(Body::Disc(disc));
    let place = |disc, axis| Parameter::Hole(Body::Disc(disc), 1, axis);
    let cotangents = vec![PoseTangent::default(); 10];
    for [first, second] in [
        [radius(0), radius(3)],
        [radius(7), radius(7)],
        [place(1, Axis::X), place(4, Axis::X)],
        [radius(6), place(9, Axis::Y)],
        [place(9, Axis::Y), radius(6)],
        [
            Parameter::Hole(Body::Base, 0, Axis::X),
            Parameter::HoleRadius(Body::Base),
        ],
        [Parameter::Gain(2), Parameter::Gain(2)],
        [Parameter::Payload, Parameter::Payload],
    ] {
        // Whatever stands between them.
        let parameters = [first, Parameter::Pitch(0), second];
        let direction = parameters.map(|parameter| (parameter, 1.0));
        let errors = [
            sensitivity.jacobian(&parameters).unwrap_err(),
            sensitivity.vjp(&cotangents, &parameters).unwrap_err(),
            sensitivity.jvp(&direction).unwrap_err(),
        ];
        let names = format!(
            "`{}` and `{}` of robot `2m` overlap",
            first.key(),
            second.key()
        );
        for error in errors {
            assert!(error.to_string().contains(&names), "{error}");
        }
        if robot.spec().value(first).is_ok() {
            let values = [(first, 0.0125), (second, 0.013)];
            let error = robot.spec().with(&values).unwrap_err();
            assert!(error.to_string().contains(&names), "{error}");
        }
        assert!(robot.spec().parameters_overlap(first, second));
    }
    let distinct = [
        radius(0),
        radius(5),
        Parameter::HoleRadius(Body::Base),
        Parameter::Gain(0),
        Parameter::Gain(1),
    ];
    sensitivity.jacobian(&distinct).unwrap();
}

/// A robot has the parameters that it lists and no others, each once; two overlap exactly where setting one moves the other.
#[test]
fn a_robot_lists_its_parameters_and_what_they_act_on() {
    let mut rng = ChaCha8Rng::seed_from_u64(39);
    for _ in 0..20 {
        let spec = random_case(&mut rng).spec;
        let listed = spec.parameters();
        for (parameter, _) in all_parameters(&spec) {
            let has_value = spec.value(parameter).is_ok();
            assert_eq!(has_value, listed.contains(&parameter), "{parameter}");
        }
        for &parameter in &listed {
            let value = spec.value(parameter).unwrap();
            let moved = spec.with(&[(parameter, value + 1e-4)]).unwrap();
            for &other in &listed {
                let changes = moved.value(other).unwrap() != spec.value(other).unwrap();
                let overlap = spec.parameters_overlap(parameter, other);
                // A hole that moves across its radius' direction changes no radius.
                assert!(!changes || overlap, "{parameter} changes {other}");
                assert_eq!(overlap, spec.parameters_overlap(other, parameter));
                assert_eq!(overlap, spec.check_parameters(&[parameter, other]).is_err());
            }
            // What it acts on is what differs of the compiled robot, if it is a number of the discs.
            let [a, b] = [&spec, &moved].map(|spec| Robot::new(spec.clone()));
            let (Ok(a), Ok(b)) = (a, b) else { continue };
            for (disc, (a, b)) in a.discs().iter().zip(b.discs()).enumerate() {
                let differs = a.damping != b.damping || a.armature != b.armature;
                let acts = match spec.acts_on(parameter).unwrap() {
                    ActsOn::Module { discs, .. } => discs.contains(&disc),
                    _ => false,
                };
                assert!(acts || !differs, "{parameter} and disc {disc}");
            }
        }
    }
}
