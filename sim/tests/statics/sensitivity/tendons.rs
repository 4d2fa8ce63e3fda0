//! Lengths and tensions of tendons, against differences of settled robots.

use tdcr_sim::robot::{
    Axis, Backbone, Drive, Frame, Loads, Parameter, PerDisc, Pull, Robot, RobotSpec, Wrench,
};

use super::case::own_routes;

/// The 2m robot on a backbone, every tendon on its own route, the last one driven in this way; and a command.
fn on_backbone(last: Drive) -> (RobotSpec, Vec<f64>) {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
    }
    let mut spec = own_routes(&Robot::new(spec).unwrap());
    let mut command = vec![0.02, 0.025, 0.03, 0.02, 0.025, 0.028];
    // What the last tendon comes to by its gain, commanded in another way.
    let robot = Robot::new(spec.clone()).unwrap();
    let settled = robot.settle(&robot.command(&command).unwrap(), &Loads::default());
    spec.routes[5].tendon.drive = last;
    spec.routes[5].tendon.range = [0.0, 100.0];
    match last {
        Drive::Gain(_) => {}
        Drive::Length => command[5] = settled.tendon_lengths[5],
        Drive::Tension => command[5] = settled.tendon_tensions[5],
    }
    (spec, command)
}

/// Lengths and tensions with parameters at these values.
fn settled(
    spec: &RobotSpec,
    command: &[f64],
    [payload, force, gain]: [f64; 3],
) -> (Vec<f64>, Vec<f64>) {
    let spec = match gain == 0.0 {
        true => spec.clone(),
        false => spec.with(&[(Parameter::Gain(1), 500.0 + gain)]).unwrap(),
    };
    let robot = Robot::new(spec).unwrap();
    let push = Wrench {
        force: [force, 0.0, 0.0],
        ..Wrench::none(9, Frame::World)
    };
    let loads = Loads::payload(payload).unwrap().with_wrench(push).unwrap();
    let equilibrium = robot.settle(&robot.command(command).unwrap(), &loads);
    assert!(equilibrium.converged);
    (equilibrium.tendon_lengths, equilibrium.tendon_tensions)
}

#[test]
fn lengths_and_tensions_change_as_differences_say() {
    for drive in [Drive::Gain(500.0), Drive::Length, Drive::Tension] {
        let (spec, command) = on_backbone(drive);
        let robot = Robot::new(spec.clone()).unwrap();
        let mut parameters: Vec<Parameter> = (0..6).map(Parameter::Command).collect();
        parameters.extend([Parameter::Payload, Parameter::Force(9, Axis::X)]);
        if let Drive::Gain(_) = drive {
            parameters.push(Parameter::Gain(1));
        }
        let push = Wrench {
            force: [0.01, 0.0, 0.0],
            ..Wrench::none(9, Frame::World)
        };
        let loads = Loads::payload(0.01).unwrap().with_wrench(push).unwrap();
        let command_of = robot.command(&command).unwrap();
        let equilibrium = robot.settle(&command_of, &loads);
        let found = robot
            .sensitivity(&command_of, &loads, &equilibrium)
            .unwrap()
            .tendon_jacobians(&parameters)
            .unwrap();
        for (column, parameter) in parameters.iter().enumerate() {
            let step = match parameter {
                Parameter::Gain(_) => 1e-2,
                Parameter::Command(5) if drive == Drive::Tension => 1e-3,
                _ => 1e-6,
            };
            let ends = [-step, step].map(|step| {
                let (mut command, mut others) = (command.clone(), [0.01, 0.01, 0.0]);
                match parameter {
                    Parameter::Command(t) => command[*t] += step,
                    Parameter::Payload => others[0] += step,
                    Parameter::Force(..) => others[1] += step,
                    _ => others[2] = step,
                }
                settled(&spec, &command, others)
            });
            for tendon in 0..6 {
                let slope = |a: f64, b: f64| (b - a) / (2.0 * step);
                let length = slope(ends[0].0[tendon], ends[1].0[tendon]);
                let tension = slope(ends[0].1[tendon], ends[1].1[tendon]);
                let [of_length, of_tension] =
                    [&found.lengths, &found.tensions].map(|matrix| matrix[(tendon, column)]);
                let what = format!("{drive:?}, {parameter:?}, tendon {tendon}");
                assert!(
                    (of_length - length).abs() < 1e-5 * (1.0 + length.abs()),
                    "{what}: {of_length} {length}"
                );
                assert!(
                    (of_tension - tension).abs() < 1e-4 * (1.0 + tension.abs()),
                    "{what}: {of_tension} {tension}"
                );
            }
        }
    }
}

#[test]
fn a_slack_tendon_has_no_tension_to_change() {
    let (mut spec, _) = on_backbone(Drive::Gain(500.0));
    for route in &mut spec.routes {
        route.tendon.pull = Pull::TensionOnly;
        route.tendon.range = [0.0, 0.2];
    }
    let robot = Robot::new(spec).unwrap();
    let command = robot
        .command(&[0.15, 0.07, 0.07, 0.07, 0.07, 0.07])
        .unwrap();
    let equilibrium = robot.settle(&command, &Loads::default());
    assert_eq!(equilibrium.tendon_tensions[0], 0.0);
    let parameters: Vec<Parameter> = (0..6).map(Parameter::Command).collect();
    let found = robot
        .sensitivity(&command, &Loads::default(), &equilibrium)
        .unwrap()
        .tendon_jacobians(&parameters)
        .unwrap();
    assert!(found.tensions.row(0).iter().all(|&slope| slope == 0.0));
    assert!(found.lengths.row(0).iter().any(|&slope| slope.abs() > 1e-3));
}
