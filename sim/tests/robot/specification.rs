//! What a robot's specification accepts, and what it says to what it does not.

use std::path::Path;

use proptest::prelude::*;
use tdcr_sim::robot::{
    Axis, Body, CommandError, Drive, Holes, Loads, MassSpec, Parameter, PerDisc, Robot, RobotSpec,
    RouteSpec, ServoSpec, Waypoint,
};

#[test]
fn the_standard_robots_have_the_papers_dimensions() {
    for (name, modules, height, lightest) in [
        ("2m", 2, 0.33595, 25.0),
        ("3m", 3, 0.40695, 25.0),
        ("5m", 5, 0.56695, 5.0),
    ] {
        let robot = Robot::load(name).unwrap();
        assert_eq!(robot.tendons().len(), 3 * modules);
        assert_eq!(robot.dof(), 15 * modules);
        let tip = 0.174 + robot.discs().iter().map(|disc| disc.offset.z).sum::<f64>();
        assert!((tip - height).abs() < 1e-12, "{name}: {tip}");
        let top = robot.discs().last().unwrap();
        let volume = std::f64::consts::PI * top.radius.powi(2) * 2.0 * top.half_height;
        assert!((top.mass / volume - lightest).abs() < 1e-9);
    }
}

#[test]
fn a_specification_survives_its_files() {
    let folder = std::env::temp_dir().join(format!("tdcr-robot-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let spec = RobotSpec::standard("5m").unwrap();
    for (file, text) in [
        ("robot.toml", spec.to_toml().unwrap()),
        ("robot.json", serde_json::to_string(&spec).unwrap()),
    ] {
        let path = folder.join(file);
        std::fs::write(&path, text).unwrap();
        assert_eq!(RobotSpec::load(path.to_str().unwrap()).unwrap(), spec);
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_wrong_field_is_named_with_its_value_and_what_is_expected() {
    type Change = fn(&mut RobotSpec);
    let cases: [(Change, &str); 10] = [
        (
            |s| s.modules[1].radius = -0.02,
            "`modules[1].radius` is -0.02; expected a finite number above 0",
        ),
        (
            |s| s.modules[0].pitch = f64::NAN,
            "`modules[0].pitch` is NaN",
        ),
        (
            |s| s.modules[0].discs = 0,
            "`modules[0].discs` is 0; expected 1 to 1000",
        ),
        (|s| s.modules.clear(), "`modules` is empty"),
        (
            |s| s.modules[1].mass = MassSpec::Density(PerDisc::Each(vec![1.0; 4])),
            "`modules[1].mass.density` is a list of 4",
        ),
        (
            |s| s.modules[0].tendons.as_mut().unwrap().range = [0.04, 0.0],
            "`modules[0].tendons.range` is [0.04, 0]",
        ),
        (
            |s| with_servo(s, |servo| servo.lag = f64::NAN),
            "`modules[0].tendons.servo.lag` is NaN",
        ),
        (
            |s| with_servo(s, |servo| servo.rate = Some(0.0)),
            "`modules[0].tendons.servo.rate` is 0",
        ),
        (
            |s| {
                with_servo(s, |servo| servo.largest_force = Some(5.0));
                s.modules[0].tendons.as_mut().unwrap().drive = Drive::Length;
            },
            "`modules[0].tendons.servo.largest_force` is 5; expected none, or a tendon that stretches",
        ),
        (
            |s| s.base.holes = Holes::At(vec![[0.01, 0.0]; 2]),
            "`base.holes` is a list of 2",
        ),
    ];
    for (change, expected) in cases {
        let mut spec = RobotSpec::standard("2m").unwrap();
        change(&mut spec);
        let message = Robot::new(spec).unwrap_err().to_string();
        assert!(
            message.contains(expected),
            "{message} does not contain {expected}"
        );
    }
}

#[test]
fn a_wrong_route_is_named_with_its_place() {
    let route = |through: &[Waypoint]| RouteSpec {
        through: through.to_vec(),
        tendon: RobotSpec::standard("2m").unwrap().modules[0]
            .tendons
            .clone()
            .unwrap(),
    };
    let base = Waypoint(Body::Base, 0);
    let disc = |disc, hole| Waypoint(Body::Disc(disc), hole);
    for (through, expected) in [
        (
            vec![base, disc(10, 0)],
            "`routes[0].through[1]` is 10; expected \"base\" or",
        ),
        (
            vec![base, disc(3, 3)],
            "`routes[0].through[1]` is hole 3 of 3",
        ),
        (
            vec![base, disc(3, 1), disc(3, 1)],
            "`routes[0].through[2]` is the hole before it",
        ),
        (
            vec![base],
            "`routes[0].through` is a list of 1; expected at least two holes",
        ),
        (
            vec![disc(2, 0), disc(2, 1)],
            "expected at least two holes, not all of one body",
        ),
    ] {
        let mut spec = RobotSpec::standard("2m").unwrap();
        spec.routes = vec![route(&through)];
        let message = Robot::new(spec).unwrap_err().to_string();
        assert!(
            message.contains(expected),
            "{message} does not contain {expected}"
        );
    }
}

#[test]
fn robot_files_say_what_was_expected_where() {
    let two = RobotSpec::standard("2m").unwrap().to_toml().unwrap();
    for (from, to, expected) in [
        (
            "gain = 500.0",
            "gian = 500.0",
            "expected one of `gain`, `length`, `tension`",
        ),
        (
            "[modules.mass]\ndensity = 25.0",
            "[modules.mass]\ndensity = \"x\"",
            "expected one value, or a list with one per disc",
        ),
        (
            "routing = \"module_below\"",
            "routing = \"below\"",
            "expected `module_below` or `base`",
        ),
    ] {
        assert!(two.contains(from), "{two}");
        let broken = two.replacen(from, to, 1);
        let message = RobotSpec::from_toml(&broken, Path::new("robot.toml"))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains(expected),
            "{message} does not contain {expected}"
        );
    }
}

#[test]
fn an_unknown_robot_and_a_broken_file_are_told_apart() {
    let message = |name: &str| RobotSpec::load(name).unwrap_err().to_string();
    assert!(message("4m").contains("unknown robot `4m`: expected 2m, 3m, 5m"));
    assert!(message("/no/such/robot.toml").contains("cannot read robot file /no/such/robot.toml"));
    let path = std::env::temp_dir().join(format!("tdcr-broken-{}.toml", std::process::id()));
    std::fs::write(&path, "name = \"x\"\ncolour = 3\n").unwrap();
    let said = message(path.to_str().unwrap());
    assert!(
        said.contains("is not a robot specification") && said.contains("line 2"),
        "{said}"
    );
    std::fs::remove_file(path).unwrap();
}

#[test]
fn a_command_must_fit_the_tendons() {
    let robot = Robot::load("2m").unwrap();
    assert!(matches!(
        robot.command(&[0.01; 5]),
        Err(CommandError::Length {
            expected: 6,
            found: 5,
            ..
        })
    ));
    let refused = |value: f64| {
        robot
            .command(&[0.0, 0.0, value, 0.0, 0.0, 0.0])
            .unwrap_err()
    };
    for value in [0.0401, -1e-9, f64::NAN, f64::INFINITY] {
        assert!(refused(value).to_string().starts_with(&format!(
            "command entry 3 is {value} m; tendon 3 takes 0 to 0.04 m"
        )));
    }
    assert!(Loads::payload(-0.01).is_err() && Loads::payload(f64::NAN).is_err());
}

/// Any parameter, of any robot.
fn parameter() -> impl Strategy<Value = Parameter> {
    let axis = || prop::sample::select(&Axis::ALL[..]);
    let body = || prop_oneof![Just(Body::Base), any::<usize>().prop_map(Body::Disc)];
    let numbered = [
        Parameter::Command,
        Parameter::Gain,
        Parameter::AxialStiffness,
        Parameter::Friction,
        Parameter::Torsion,
        Parameter::Density,
        Parameter::Youngs,
        Parameter::Pitch,
        Parameter::Damping,
        Parameter::Armature,
    ];
    let along = [Parameter::Force, Parameter::Moment, Parameter::Bending];
    prop_oneof![
        Just(Parameter::Payload),
        (prop::sample::select(numbered.to_vec()), any::<usize>()).prop_map(|(of, i)| of(i)),
        (prop::sample::select(along.to_vec()), 0..100_usize, axis())
            .prop_map(|(of, i, axis)| of(i, axis)),
        body().prop_map(Parameter::HoleRadius),
        (body(), any::<usize>(), axis()).prop_map(|(b, h, axis)| Parameter::Hole(b, h, axis)),
    ]
}

proptest! {
    #[test]
    fn a_parameter_is_read_from_its_key(parameter in parameter()) {
        prop_assert_eq!(parameter.key().parse(), Ok(parameter));
    }

    /// One spelling each: whatever is read as a parameter is that parameter's key.
    #[test]
    fn a_text_is_the_key_of_what_is_read_from_it(
        parameter in parameter(),
        at in any::<prop::sample::Index>(),
        with in prop::option::of(any::<char>()),
        digit in prop::option::of("[0-9+ xyz.\\[\\]]"),
    ) {
        let mut text: Vec<char> = parameter.key().chars().collect();
        let at = at.index(text.len());
        match (with, digit) {
            (_, Some(digit)) => text.insert(at, digit.chars().next().unwrap()),
            (Some(with), None) => text[at] = with,
            (None, None) => { text.remove(at); }
        }
        let text: String = text.into_iter().collect();
        if let Ok(read) = text.parse::<Parameter>() {
            prop_assert_eq!(read.key(), text);
        }
    }
}

#[test]
fn what_is_no_key_of_a_parameter_is_refused_with_what_would_be() {
    for (key, says) in [
        (
            "stiffness[0]",
            "there is no parameter \"stiffness\"; expected a key like one of command[0], payload,",
        ),
        ("", "there is no parameter \"\""),
        (
            "gain",
            "the tendon in brackets is missing at \"\"; expected a key like gain[2]",
        ),
        ("gain[02]", "\"02\" is not the number of a tendon"),
        ("gain[2].x", "\".x\" is too much"),
        (
            "force[9]",
            "\"\" is not an axis: .x, .y or .z; expected a key like force[9].x",
        ),
        (
            "hole[tip][0].x",
            "\"tip\" is not the number of a disc, nor base",
        ),
        ("hole[base].x", "the hole in brackets is missing at \".x\""),
    ] {
        let error = key.parse::<Parameter>().unwrap_err().to_string();
        let start = format!("{key:?} is not the key of a parameter: {says}");
        assert!(error.starts_with(&start), "{error}");
    }
}

/// Gives the tendons of the first module a servo.
fn with_servo(spec: &mut RobotSpec, change: fn(&mut ServoSpec)) {
    let servo = &mut spec.modules[0].tendons.as_mut().unwrap().servo;
    change(servo.insert(ServoSpec::default()));
}
