//! Friction between discs of one robot along paths.

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_sim::contact::{Contact, ContactEquilibrium, ContactSettler, Partner, Sliding};
use tdcr_sim::reactions::{JointReaction, joint_reactions, joint_reactions_with_friction};
use tdcr_sim::robot::{Command, Frame, Loads, Robot, RobotSpec, Wrench};
use tdcr_sim::scene::Obstacle;
use tdcr_sim::sensitivity::SensitivityError;
use tdcr_sim::tendon_friction::ContactPath;

use pressed_discs::{STIFFNESS, alone, beads, push, robot, tip};

#[path = "../../common/pressed_discs.rs"]
mod pressed_discs;

const FRICTION: f64 = 0.3;
const COMPLIANCE: f64 = 1e-6;

/// Forces of a contact along its normal and across it (N).
fn parts(contact: &Contact) -> (f64, Vector3<f64>) {
    let along = contact.force.dot(&contact.normal);
    (along, contact.force - contact.normal * along)
}

/// The only contact.
fn only(found: &ContactEquilibrium) -> Contact {
    assert!(found.equilibrium.converged && found.equilibrium.residual <= 1e-9);
    let [contact] = found.contacts.as_slice() else {
        panic!("{:?}", found.contacts);
    };
    *contact
}

/// The loads with the contacts' forces on one disc and on the other.
fn pressed(loads: &Loads, contacts: &[Contact], found: Pose) -> Loads {
    let (positions, orientations) = found;
    let mut out = loads.clone();
    for contact in contacts {
        let mut push = |disc: usize, force: Vector3<f64>| {
            let point = orientations[disc].inverse() * (contact.point - positions[disc]);
            let wrench = Wrench {
                point: point.into(),
                force: force.into(),
                ..Wrench::none(disc, Frame::World)
            };
            out = std::mem::take(&mut out).with_wrench(wrench).unwrap();
        };
        push(contact.disc, contact.force);
        if let Partner::Disc(other) = contact.partner {
            push(other, -contact.force);
        }
    }
    out
}

type Pose<'a> = (&'a [Vector3<f64>], &'a [UnitQuaternion<f64>]);

fn pose(found: &ContactEquilibrium) -> Pose<'_> {
    let at = &found.equilibrium;
    (&at.positions, &at.orientations)
}

/// Largest moment at the joints of a robot that has no springs (N m).
fn unbalanced(reactions: &[JointReaction]) -> f64 {
    let moments = reactions.iter().map(|reaction| reaction.moment.norm());
    moments.fold(0.0, f64::max)
}

/// The last disc pressed on the first, and pushed aside.
#[test]
fn a_disc_sticks_to_another_below_the_angle_of_friction_and_slips_above() {
    let robot = robot();
    let scene = alone(COMPLIANCE, FRICTION);
    let mut settler = ContactSettler::with_beads(&robot, &scene, beads(&robot));
    let command = robot.command(&[]).unwrap();
    settler.settle(&command, &push(0.0)).unwrap();
    let start = only(settler.found());
    assert_eq!(start.sliding, Sliding::Free);
    let (normal, _) = parts(&start);
    assert!((normal - 1.0).abs() < 0.1, "{normal} N");
    // How far the last disc has been displaced along x, as the first one sees it.
    let aside = |found: &ContactEquilibrium| {
        let at = &found.equilibrium;
        let tip = tip(at.positions[2], at.orientations[2]);
        (at.orientations[0].inverse() * (tip - at.positions[0])).x
    };
    let mut before = aside(settler.found());
    for share in [0.5, 0.9, 0.99, 1.01, 1.02, 1.05] {
        let loads = push(share * FRICTION * normal);
        let found = settler.follow(&command, &loads).unwrap();
        let contact = only(found);
        let (along, across) = parts(&contact);
        match share > 1.0 {
            true => {
                assert_eq!(contact.sliding, Sliding::Slips, "{share}");
                assert!((across.norm() - FRICTION * along).abs() < 1e-9 * along);
                // The second disc moves along x, and takes the first along.
                assert!(aside(found) > before + 2e-5 && across.x > 0.999 * across.norm());
            }
            false => {
                assert_eq!(contact.sliding, Sliding::Sticks, "{share}");
                assert!((aside(found) - before).abs() < 1e-6, "{share}");
                assert!((across.x - share * FRICTION * normal).abs() < 1e-3);
            }
        }
        // The last joint bears what the contact does not, and the first ones nothing but what is pushed from outside.
        let at = found.equilibrium.pose();
        let forced = pressed(&loads, &found.contacts, pose(found));
        let inside = joint_reactions(&robot, &at, &forced).unwrap();
        let spring =
            found.equilibrium.orientations[1].inverse() * found.equilibrium.orientations[2];
        let moment = found.equilibrium.orientations[1] * spring.scaled_axis() * -STIFFNESS;
        let left = (inside[2].moment - moment).norm();
        assert!(left < 3e-9, "{left} N m");
        let outside = joint_reactions(&robot, &at, &loads).unwrap();
        assert!((inside[0].force - outside[0].force).norm() < 1e-12);
        assert!((inside[0].moment - outside[0].moment).norm() < 1e-12);
        before = aside(found);
    }
    let loads = push(1.05 * FRICTION * normal);
    let error = settler.sensitivity(&command, &loads).unwrap_err();
    assert_eq!(error, SensitivityError::SelfFriction { disc: 0, other: 2 });
    // Pushed straight again it stays where it slipped to: friction now bears the spring.
    let found = settler.follow(&command, &push(0.0)).unwrap();
    let contact = only(found);
    assert_eq!(contact.sliding, Sliding::Sticks);
    assert!((aside(found) - before).abs() < 2e-6 && parts(&contact).1.x < 0.0);
}

/// A motion of both discs makes no slip, and turns what holds them with them: the robot's base joint turns by a radian about its axis under a
/// force, and the discs above move with it, the force between them as well.
#[test]
fn what_sticks_is_carried_along() {
    let robot = robot();
    let (compliance, aside) = (1e-4, 0.2);
    let scene = alone(compliance, FRICTION);
    let mut settler = ContactSettler::with_beads(&robot, &scene, beads(&robot));
    let command = robot.command(&[]).unwrap();
    settler.settle(&command, &push(0.0)).unwrap();
    settler.follow(&command, &push(aside)).unwrap();
    // The same force on the last disc, the opposite one on the first, and one that turns this.
    let at = &settler.found().equilibrium;
    let [own, other] = [2, 0].map(|disc| (at.positions[disc], at.orientations[disc]));
    let pushed = push(aside).wrenches()[0];
    let place = own.0 + own.1 * Vector3::from(pushed.point);
    let loads = |angle: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        let wrench = |disc: usize, point: Vector3<f64>, force: Vector3<f64>| Wrench {
            point: point.into(),
            force: (turn * force).into(),
            ..Wrench::none(disc, Frame::World)
        };
        let force = Vector3::from(pushed.force);
        let centre = Vector3::new(0.0, 0.0, -other.0.z);
        let lever = 100.0 * STIFFNESS * angle;
        [
            wrench(2, pushed.point.into(), force),
            wrench(0, other.1.inverse() * (place - other.0), -force),
            wrench(0, centre + Vector3::x(), Vector3::y() * lever),
            wrench(0, centre, Vector3::y() * -lever),
        ]
        .into_iter()
        .fold(Loads::default(), |loads, wrench| {
            loads.with_wrench(wrench).unwrap()
        })
    };
    let apart = |found: &ContactEquilibrium| {
        let at = &found.equilibrium;
        let turned = at.orientations[0].inverse();
        let contact = only(found);
        assert_eq!(contact.sliding, Sliding::Sticks);
        let place = turned * (at.positions[2] - at.positions[0]);
        (place, turned * contact.force, turned * at.orientations[2])
    };
    let (place, force, turn) = apart(settler.follow(&command, &loads(0.0)).unwrap());
    assert!(parts(&only(settler.found())).1.norm() > 0.15);
    for step in 1..=10 {
        let angle = 0.1 * f64::from(step);
        let found = settler.follow(&command, &loads(angle)).unwrap();
        let now = apart(found);
        assert!(
            (now.0 - place).norm() < 1e-9,
            "{angle}: {:e} m",
            (now.0 - place).norm()
        );
        assert!(
            (now.1 - force).norm() < 1e-6,
            "{angle}: {:e} N",
            (now.1 - force).norm()
        );
        assert!(
            now.2.angle_to(&turn) < 1e-8,
            "{angle}: {:e}",
            now.2.angle_to(&turn)
        );
        let turned = found.equilibrium.orientations[0].scaled_axis();
        assert!((turned.z - angle).abs() < 1e-3, "{turned}");
    }
}

/// All modules pulled to one side, so that the tip curls onto the lower discs.
fn curled(robot: &Robot, by: f64) -> Command {
    let pull = |tendon: usize| match tendon % 3 {
        0 => 0.02 + 0.018 * by,
        _ => 0.02 - 0.017 * by,
    };
    let values: Vec<f64> = (0..robot.tendons().len()).map(pull).collect();
    robot.command(&values).unwrap()
}

/// 5m curls up in steps, to and fro: forces are in balance on both discs of each contact, within their cones, and on their bounds where
/// contacts slip. Without friction the path is another.
#[test]
fn a_robot_that_curls_up_rubs_within_its_cones() {
    let robot = Robot::load("5m").unwrap();
    let loads = Loads::default();
    let settler = |friction: f64| ContactSettler::new(&robot, &alone(COMPLIANCE, friction));
    let (mut rough, mut smooth) = (settler(FRICTION), settler(0.0));
    let (mut stuck, mut slipped, mut unsettled, mut apart) = (0, 0, 0, 0.0_f64);
    for step in 0..400 {
        let by = 1.0 - 0.1 * (f64::from(step) * 0.1).sin().abs() - (-0.02 * f64::from(step)).exp();
        let command = curled(&robot, by);
        smooth.follow(&command, &loads).unwrap();
        let found = rough.follow(&command, &loads).unwrap();
        if !found.equilibrium.converged {
            unsettled += 1;
            continue;
        }
        assert!(found.equilibrium.residual <= 1e-9 && found.complementarity <= 1e-12);
        for contact in &found.contacts {
            let (along, across) = parts(contact);
            assert!(across.norm() <= FRICTION * along * (1.0 + 1e-9) + 1e-12);
            match contact.sliding {
                Sliding::Slips => {
                    assert!((across.norm() - FRICTION * along).abs() <= 1e-9 * along);
                    slipped += 1;
                }
                Sliding::Sticks => stuck += 1,
                Sliding::Free => {}
            }
        }
        let at = found.equilibrium.pose();
        let forced = pressed(&loads, &found.contacts, pose(found));
        let left = unbalanced(&joint_reactions(&robot, &at, &forced).unwrap());
        assert!(left < 3e-9, "{left} N m");
        let other = &smooth.found().equilibrium;
        if other.converged {
            let way = found.equilibrium.positions[24] - other.positions[24];
            apart = apart.max(way.norm());
        }
    }
    eprintln!("{stuck} stick, {slipped} slip, {unsettled} not settled, {apart} m apart");
    assert!(stuck > 100 && slipped > 100 && unsettled < 20 && apart > 1e-4);
}

/// With friction of tendons and of an obstacle as well, a ball that discs graze on their way.
#[test]
fn all_frictions_count_together() {
    let mut spec = RobotSpec::standard("5m").unwrap();
    for tendon in spec.tendon_specs_mut() {
        tendon.set_friction(0.05);
    }
    let robot = Robot::new(spec).unwrap();
    let aside = robot.discs()[12].radius + 0.018;
    let ball = Obstacle::sphere("ball", 0.02).unwrap();
    let ball = ball.at([-0.106, aside, 0.123]);
    let ball = ball.with_friction(FRICTION).unwrap();
    let scene = alone(COMPLIANCE, FRICTION);
    let scene = scene.with_obstacles(vec![ball]).unwrap();
    let mut path = ContactPath::new(&robot, &scene);
    let loads = Loads::default();
    let (mut between, mut beside, mut balanced) = (0, 0, 0);
    for step in 0..40 {
        let command = curled(&robot, 0.7 + 0.0075 * f64::from(step));
        let state = path.advance(&command, &loads).unwrap().clone();
        assert!(state.equilibrium.converged, "{step}");
        if step == 0 {
            continue;
        }
        for contact in path.contacts() {
            let (along, across) = parts(contact);
            assert!(across.norm() <= FRICTION * along * (1.0 + 1e-9) + 1e-12);
            assert_ne!(contact.sliding, Sliding::Free);
            match contact.partner {
                Partner::Disc(_) => between += 1,
                Partner::Obstacle(_) => beside += 1,
            }
        }
        // Friction with obstacles acts on the beads' centres.
        let mut contacts = path.contacts().iter();
        if contacts.any(|own| own.partner.obstacle().is_some()) {
            continue;
        }
        balanced += usize::from(!path.contacts().is_empty());
        let at = &state.equilibrium;
        let forced = pressed(&loads, path.contacts(), (&at.positions, &at.orientations));
        let reactions = joint_reactions_with_friction(&robot, &state, &forced).unwrap();
        let left = unbalanced(&reactions);
        assert!(left < 3e-9, "{step}: {left} N m");
    }
    let snaps = path.state().snaps;
    eprintln!("{between} between discs, {beside} on the ball, {balanced} balanced, {snaps} snaps");
    assert!(between > 30 && beside > 10 && balanced > 5);
}
