//! Commands for target shapes.

use nalgebra::{Unit, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::inverse::shape::{
    ActiveBound, Bound, Goal, Outcome, Search, ShapeControlError, ShapeController, ShapeSolution,
    Target,
};
use tdcr_sim::robot::{Backbone, Frame, Loads, LoadsError, PerDisc, Robot, RobotSpec, Wrench};
use tdcr_sim::statics::Equilibrium;

/// What must hold of every answer, whatever was asked.
fn assert_honest(robot: &Robot, loads: &Loads, targets: &[Target], found: &ShapeSolution) {
    for (value, tendon) in found.command.as_slice().iter().zip(robot.tendons()) {
        assert!((tendon.range[0]..=tendon.range[1]).contains(value));
    }
    let settled = robot.settle(&found.command, loads);
    assert_eq!(settled.positions, found.equilibrium.positions);
    for (target, error) in targets.iter().zip(&found.errors) {
        if let Goal::Position(wanted) = target.goal {
            let left = (settled.positions[target.disc] - wanted).norm();
            assert!((left - error).abs() <= 1e-15);
        }
    }
    let met = found.errors.iter().all(|error| *error <= 1e-6);
    assert_eq!(met, found.outcome == Outcome::Reached);
    if let Outcome::Unreachable { active, gap, .. } = &found.outcome {
        assert!((0.0..=1e-6).contains(gap), "{gap}");
        for ActiveBound { tendon, bound } in active {
            let [low, high] = robot.tendons()[*tendon].range;
            let end = match bound {
                Bound::Low => low,
                Bound::High => high,
            };
            assert_eq!(found.command.as_slice()[*tendon], end);
        }
    }
}

fn assert_tips_are_reached(name: &str) {
    let robot = Robot::load(name).unwrap();
    let loads = Loads::payload(0.01).unwrap();
    let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(71);
    let tip = robot.discs().len() - 1;
    let mut missed = Vec::new();
    for k in 0..120 {
        let settled = robot.settle(&robot.random_command(&mut rng), &loads);
        let targets = [Target::tip(&robot, settled.positions[tip])];
        let found = controller.reach(&targets).unwrap();
        assert_honest(&robot, &loads, &targets, &found);
        if found.outcome != Outcome::Reached {
            missed.push((k, found.errors[0], found.outcome));
        }
    }
    assert!(
        missed.is_empty(),
        "{name}: {} of 120: {missed:?}",
        missed.len()
    );
}

#[test]
fn tips_of_the_2m_robot_are_reached_to_a_micrometre() {
    assert_tips_are_reached("2m");
}

#[test]
fn tips_of_the_3m_robot_are_reached_to_a_micrometre() {
    assert_tips_are_reached("3m");
}

#[test]
fn whole_backbones_are_reproduced() {
    for name in ["2m", "3m"] {
        let robot = Robot::load(name).unwrap();
        let loads = Loads::payload(0.01).unwrap();
        let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(72);
        let mut missed = Vec::new();
        for k in 0..50 {
            let command = robot.random_command(&mut rng);
            let settled = robot.settle(&command, &loads);
            let position =
                |(disc, position): (usize, &Vector3<f64>)| Target::position(disc, *position);
            let targets: Vec<_> = settled.positions.iter().enumerate().map(position).collect();
            let found = controller.reach(&targets).unwrap();
            assert_honest(&robot, &loads, &targets, &found);
            if found.outcome != Outcome::Reached {
                missed.push((k, found.errors, found.outcome));
            }
        }
        assert!(missed.is_empty(), "{name}: {missed:?}");
    }
}

#[test]
fn tips_are_reached_in_an_asked_direction() {
    let robot = Robot::load("3m").unwrap();
    let loads = Loads::default();
    let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(73);
    let mut missed = Vec::new();
    for k in 0..40 {
        let settled = robot.settle(&robot.random_command(&mut rng), &loads);
        let orientation = settled.orientations[14];
        let axis = Unit::new_normalize(orientation * Vector3::z());
        let goal = match k % 2 {
            0 => Goal::Direction { axis, lever: 0.1 },
            _ => Goal::Orientation {
                orientation,
                lever: 0.1,
            },
        };
        let targets = [
            Target::tip(&robot, settled.positions[14]),
            Target {
                disc: 14,
                goal,
                weight: 1.0,
            },
        ];
        let found = controller.reach(&targets).unwrap();
        assert_honest(&robot, &loads, &targets, &found);
        if found.outcome != Outcome::Reached {
            missed.push((k, found.errors, found.outcome));
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

/// With loads of every kind, on a robot with an elastic backbone.
#[test]
fn targets_are_reached_under_loads() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.1)));
    }
    let robot = Robot::new(spec).unwrap();
    let push = Wrench {
        disc: 6,
        point: [0.02, 0.0, 0.01],
        force: [0.05, -0.1, 0.02],
        moment: [1e-3, 0.0, 2e-3],
        frame: Frame::Disc,
    };
    let loads = Loads::payload(0.02).unwrap().with_wrench(push).unwrap();
    let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(74);
    for _ in 0..20 {
        let settled = robot.settle(&robot.random_command(&mut rng), &loads);
        let targets = [Target::tip(&robot, settled.positions[9])];
        let found = controller.reach(&targets).unwrap();
        assert_honest(&robot, &loads, &targets, &found);
        assert_eq!(found.outcome, Outcome::Reached);
    }
}

/// The targets' nearest points are on the workspace's border; random commands come near from inside.
#[test]
fn no_random_command_comes_nearer_to_what_is_out_of_reach() {
    for name in ["2m", "3m"] {
        let robot = Robot::load(name).unwrap();
        let loads = Loads::default();
        let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
        for wanted in [[0.3, 0.0, 0.3], [-0.2, 0.25, 0.25], [0.02, 0.0, -0.1]] {
            let wanted = Vector3::from(wanted);
            let targets = [Target::tip(&robot, wanted)];
            let found = controller.reach(&targets).unwrap();
            assert_honest(&robot, &loads, &targets, &found);
            let nearest = nearest_of_random(&robot, &loads, &wanted);
            assert!(
                found.errors[0] <= nearest,
                "{name} {wanted:?}: {} {nearest}",
                found.errors[0]
            );
            assert!(
                found.errors[0] > 0.7 * nearest,
                "{name} {wanted:?}: {} {nearest}",
                found.errors[0]
            );
            let Outcome::Unreachable { active, .. } = found.outcome else {
                panic!("{name} {wanted:?}: {:?}", found.outcome);
            };
            assert!(!active.is_empty());
        }
    }
}

/// Of 4,000 random commands, how near the tip comes (m).
fn nearest_of_random(robot: &Robot, loads: &Loads, wanted: &Vector3<f64>) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(75);
    let commands: Vec<_> = (0..4000).map(|_| robot.random_command(&mut rng)).collect();
    let settled = robot.settle_batch(&commands, loads);
    let left = |s: &Equilibrium| (s.positions[s.positions.len() - 1] - wanted).norm();
    settled.iter().map(left).fold(f64::INFINITY, f64::min)
}

/// The highest tips are those of upright straight poses, which fall over before they are straight: the
/// nearest command is where stability ends, and is not stationary.
#[test]
fn a_search_that_ends_where_stability_does_says_so() {
    let robot = Robot::load("2m").unwrap();
    let loads = Loads::default();
    let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
    let wanted = Vector3::new(0.0, 0.0, 0.6);
    let targets = [Target::tip(&robot, wanted)];
    let found = controller.reach(&targets).unwrap();
    assert_honest(&robot, &loads, &targets, &found);
    assert!(found.errors[0] <= nearest_of_random(&robot, &loads, &wanted));
    assert!(matches!(found.outcome, Outcome::Stalled { gap } if gap > 1e-6));
}

/// From one target to the next along a line, commands change little and errors not at all.
#[test]
fn moving_targets_are_followed_without_jumps() {
    let robot = Robot::load("3m").unwrap();
    let loads = Loads::payload(0.01).unwrap();
    let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
    let at = |k: u32| Vector3::new(0.10, -0.03 + 0.002 * f64::from(k), 0.30);
    let mut last = controller.reach(&[Target::tip(&robot, at(0))]).unwrap();
    for k in 1..=30 {
        let targets = [Target::tip(&robot, at(k))];
        let found = controller.reach_from(&targets, &last.command).unwrap();
        assert_honest(&robot, &loads, &targets, &found);
        assert_eq!(found.outcome, Outcome::Reached, "target {k}");
        let pairs = found.command.as_slice().iter().zip(last.command.as_slice());
        let change = pairs.fold(0.0, |c: f64, (a, b)| c.max((a - b).abs()));
        assert!(change < 0.005, "target {k}: {change}");
        last = found;
    }
}

/// A heavy weight on the tip puts it nearer to its target than to the middle's.
#[test]
fn weights_decide_between_targets_that_exclude_each_other() {
    let robot = Robot::load("2m").unwrap();
    let controller = ShapeController::new(&robot, &Loads::default(), Search::default()).unwrap();
    let errors = |weight: f64| {
        let targets = [
            Target::position(4, [0.1, 0.0, 0.2].into()),
            Target {
                weight,
                ..Target::tip(&robot, [-0.1, 0.0, 0.2].into())
            },
        ];
        controller.reach(&targets).unwrap().errors
    };
    let (light, heavy) = (errors(0.1), errors(10.0));
    assert!(
        heavy[1] < 0.8 * light[1] && heavy[0] > light[0],
        "{light:?} {heavy:?}"
    );
}

#[test]
fn discs_along_a_curve_are_asked_for_at_their_distances() {
    let robot = Robot::load("2m").unwrap();
    let targets = Target::along(&robot, |s| Vector3::new(s, 0.0, 0.0));
    let Goal::Position(last) = targets[9].goal else {
        panic!("{:?}", targets[9]);
    };
    assert_eq!(targets.len(), 10);
    assert!((last.x - (0.00895 + 9.0 * 0.017)).abs() < 1e-15);
}

#[test]
fn what_makes_no_sense_is_refused_with_what_would() {
    let robot = Robot::load("2m").unwrap();
    let none = Loads::default();
    let controller = ShapeController::new(&robot, &none, Search::default()).unwrap();
    assert_eq!(
        controller.reach(&[]).unwrap_err(),
        ShapeControlError::NoTarget
    );
    let fine = Target::tip(&robot, Vector3::zeros());
    for (wrong, says) in [
        (Target { disc: 10, ..fine }, "no such disc"),
        (
            Target {
                weight: 0.0,
                ..fine
            },
            "weights",
        ),
        (
            Target::tip(&robot, Vector3::new(f64::NAN, 0.0, 0.0)),
            "finite",
        ),
    ] {
        let error = controller.reach(&[fine, wrong]).unwrap_err().to_string();
        assert!(
            error.starts_with("target 1") && error.contains(says),
            "{error}"
        );
    }
    let search = Search {
        tolerance: 0.0,
        ..Search::default()
    };
    let refused = ShapeController::new(&robot, &none, search).unwrap_err();
    assert_eq!(refused, ShapeControlError::Tolerance(0.0));
    let push = none.with_wrench(Wrench::none(12, Frame::World)).unwrap();
    let refused = ShapeController::new(&robot, &push, Search::default()).unwrap_err();
    assert!(matches!(
        refused,
        ShapeControlError::Loads(LoadsError::Disc {
            disc: 12,
            discs: 10
        })
    ));
    let other = Robot::load("3m").unwrap().mean_command();
    assert!(matches!(
        controller.reach_from(&[fine], &other),
        Err(ShapeControlError::Command(_))
    ));
}
