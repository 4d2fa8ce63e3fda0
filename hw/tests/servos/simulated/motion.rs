//! What motors, tendons and the robot do.

use std::f64::consts::TAU;

use tdcr_hw::dynamixel::{Fault as Refusal, Instruction, Item, PacketId};
use tdcr_hw::simulated::{Physics, Simulator, Truth, Winding};
use tdcr_sim::robot::{Drive, Loads, Pull, Robot, RobotSpec};

use super::{CURRENT_BASED, Desk, EXTENDED, VELOCITY, setup};

/// Torque (N m) per current (A) of an XC330-M288, and its friction (N m): 5 % of the stall torque.
const TORQUE_CONSTANT: f64 = 0.93 / 1.80;
const FRICTION: f64 = 0.05 * 0.93;
const RADIUS: f64 = 0.005;

/// Stiff position control without a remaining error: as owners of such servos tune them.
fn tune(desk: &mut Desk, id: u8) {
    desk.write(id, Item::PositionPGain, 1500);
    desk.write(id, Item::PositionIGain, 1200);
}

#[test]
fn winding_pulls_the_tendon_and_bends_the_robot() {
    let mut desk = Desk::of("3m");
    let before = desk.simulator.truth();
    for servo in 1..=9 {
        desk.drive(servo, EXTENDED);
        tune(&mut desk, servo);
    }
    // 1,500 ticks of a spool of 5 mm: 11.5 mm.
    desk.write(1, Item::GoalPosition, 2048 + 1500);
    desk.wait(3.0);
    let position = desk.read(1, Item::PresentPosition);
    assert!((position - 3548).abs() <= 5, "{position}");
    let after = desk.simulator.truth();
    let wound = TAU * RADIUS * (after.horns[0] - before.horns[0]) / 4096.0;
    let let_in = before.tendons[0].rest_length - after.tendons[0].rest_length;
    // But for half of the play of a third of a degree, either way.
    let play = RADIUS * f64::to_radians(1.0 / 6.0);
    assert!(
        (wound - let_in).abs() < play + 1e-9,
        "{wound} m and {let_in} m"
    );
    assert!(after.tendons[0].length < before.tendons[0].length - 0.005);
    assert!(after.tendons[0].tension > 2.0 && after.settled);
    let tip = |truth: &Truth| truth.discs[14].translation.vector;
    assert!((tip(&after) - tip(&before)).norm() > 0.02);
}

#[test]
fn the_robot_rests_where_statics_says_for_the_rest_lengths() {
    let mut desk = Desk::of("2m");
    for (servo, way) in [(1, 900), (2, 500), (3, 300), (4, 700), (5, 1000), (6, 400)] {
        desk.drive(servo, EXTENDED);
        tune(&mut desk, servo);
        desk.write(servo, Item::ProfileVelocity, 100);
        desk.write(servo, Item::GoalPosition, 2048 + way);
    }
    desk.wait(3.0);
    let truth = desk.simulator.truth();
    let mut spec = RobotSpec::standard("2m").expect("a standard robot");
    for module in &mut spec.modules {
        let tendons = module.tendons.as_mut().expect("tendons");
        assert_eq!(tendons.drive, Drive::Gain(500.0));
        tendons.range = [0.0, 1.0];
        tendons.pull = Pull::TensionOnly;
    }
    let robot = Robot::new(spec).expect("a valid robot");
    let rest: Vec<f64> = truth.tendons.iter().map(|t| t.rest_length).collect();
    let command = robot.command(&rest).expect("in range");
    let equilibrium = robot.settle(&command, &Loads::default());
    assert!(equilibrium.converged);
    for (disc, frame) in truth.discs.iter().enumerate() {
        let expected = equilibrium.disc_pose(disc);
        let apart = (frame.translation.vector - expected.translation.vector).norm();
        assert!(apart < 1e-6, "disc {disc} is {apart} m away");
    }
    for (tendon, expected) in truth.tendons.iter().zip(&equilibrium.tendon_tensions) {
        assert!((tendon.tension - expected).abs() < 1e-4 && tendon.slack == 0.0);
    }
}

#[test]
fn tension_loads_the_motors_current() {
    let mut desk = Desk::of("3m");
    for servo in 1..=9 {
        desk.drive(servo, EXTENDED);
        tune(&mut desk, servo);
    }
    for servo in 1..=3 {
        desk.write(servo, Item::GoalPosition, 2048 + 2500);
    }
    desk.wait(4.0);
    let truth = desk.simulator.truth();
    for servo in 1..=3u8 {
        let tension = truth.tendons[usize::from(servo) - 1].tension;
        assert!(tension > 8.0, "{tension} N");
        let torque = tension * RADIUS;
        let current = desk.read(servo, Item::PresentCurrent) as f64 / 1000.0;
        let bounds = [torque - FRICTION, torque + FRICTION].map(|t| t / TORQUE_CONSTANT);
        assert!(
            (bounds[0] - 2e-3..bounds[1] + 2e-3).contains(&current),
            "{current} A, {bounds:?}"
        );
    }
}

#[test]
fn a_goal_current_bounds_the_tension() {
    let mut desk = Desk::of("3m");
    for servo in 1..=3 {
        desk.drive(servo, CURRENT_BASED);
        desk.write(servo, Item::GoalCurrent, 120);
    }
    for servo in 1..=3 {
        desk.write(servo, Item::GoalPosition, 2048 + 20_000);
    }
    for _ in 0..30 {
        desk.wait(0.1);
        for tendon in &desk.simulator.truth().tendons[..3] {
            // At speed the back-EMF takes the rest; kinetic energy is small.
            assert!(tendon.tension < (0.12 * TORQUE_CONSTANT + FRICTION) / RADIUS + 0.5);
        }
    }
    let tension = desk.simulator.truth().tendons[0].tension;
    assert!(
        tension > (0.12 * TORQUE_CONSTANT - FRICTION) / RADIUS - 0.5,
        "{tension} N"
    );
    assert_eq!(desk.read(1, Item::HardwareErrorStatus), 0);
    assert_eq!(desk.read(1, Item::MovingStatus) & 1, 0);
}

#[test]
fn windings_and_reversed_servos_turn_the_other_way() {
    let mut setup = setup("2m");
    setup.servos[0].winding = Winding::Clockwise;
    let mut desk = Desk::new(&setup);
    let rest = |desk: &Desk, index: usize| desk.simulator.truth().tendons[index].rest_length;
    desk.write(2, Item::DriveMode, 1);
    let before = [0, 1, 2].map(|index| rest(&desk, index));
    for servo in 1..=3 {
        desk.drive(servo, EXTENDED);
        tune(&mut desk, servo);
        let position = desk.read(servo, Item::PresentPosition);
        desk.write(servo, Item::GoalPosition, position + 400);
    }
    desk.wait(2.0);
    let change = [0, 1, 2].map(|index| rest(&desk, index) - before[index]);
    assert!(
        change[0] > 0.002 && change[1] > 0.002 && change[2] < -0.002,
        "{change:?}"
    );
}

#[test]
fn profiles_keep_to_their_velocity_and_time() {
    let mut desk = Desk::of("2m");
    desk.drive(1, EXTENDED);
    tune(&mut desk, 1);
    // 60 times 0.229 rev/min.
    desk.write(1, Item::ProfileVelocity, 60);
    desk.write(1, Item::ProfileAcceleration, 20);
    desk.write(1, Item::GoalPosition, 2048 + 1000);
    desk.wait(0.5);
    let velocity = desk.read(1, Item::PresentVelocity);
    assert!((55..=65).contains(&velocity), "{velocity}");
    assert_eq!(desk.read(1, Item::Moving), 1);
    desk.wait(1.5);
    assert_eq!(
        (
            desk.read(1, Item::Moving),
            desk.read(1, Item::PresentVelocity)
        ),
        (0, 0)
    );
    assert_eq!(desk.read(1, Item::MovingStatus) & 0b11, 0b01);
    // By time: 800 ms, ramps of 200 ms.
    desk.write(1, Item::TorqueEnable, 0);
    desk.write(1, Item::DriveMode, 4);
    desk.drive(1, EXTENDED);
    desk.write(1, Item::ProfileVelocity, 800);
    desk.write(1, Item::ProfileAcceleration, 200);
    let start = desk.read(1, Item::PresentPosition);
    desk.write(1, Item::GoalPosition, start - 1200);
    desk.wait(0.37);
    let middle = desk.read(1, Item::PositionTrajectory);
    assert!((middle - (start - 600)).abs() < 60, "{start} and {middle}");
    desk.wait(0.4);
    assert_eq!(desk.read(1, Item::PositionTrajectory), start - 1200);
}

#[test]
fn velocity_mode_reaches_its_velocity() {
    let mut desk = Desk::of("2m");
    desk.write(1, Item::OperatingMode, VELOCITY);
    desk.write(1, Item::TorqueEnable, 1);
    desk.write(1, Item::GoalVelocity, 40);
    desk.wait(0.7);
    let velocity = desk.read(1, Item::PresentVelocity);
    assert!((36..=44).contains(&velocity), "{velocity}");
}

#[test]
fn torque_off_holds_only_what_the_gear_holds() {
    let mut desk = Desk::of("3m");
    for servo in 1..=9 {
        desk.drive(servo, EXTENDED);
        tune(&mut desk, servo);
        desk.write(servo, Item::GoalPosition, 2048 + 2500);
    }
    desk.wait(4.0);
    assert!(desk.simulator.truth().tendons[0].tension > FRICTION / RADIUS + 1.0);
    let off = Instruction::Write {
        address: 64,
        data: &[0],
    };
    desk.ask_all(PacketId::Broadcast, &off);
    desk.wait(1.0);
    for tendon in desk.simulator.truth().tendons {
        assert!(tendon.tension <= FRICTION / RADIUS + 0.3, "{tendon:?}");
    }
}

#[test]
fn the_watchdog_stops_a_servo_that_hears_nothing() {
    let mut desk = Desk::of("2m");
    desk.drive(1, EXTENDED);
    desk.write(1, Item::ProfileVelocity, 50);
    desk.write(1, Item::BusWatchdog, 5); // 100 ms
    desk.write(1, Item::GoalPosition, 2048 + 8000);
    // Any instruction will do, to whomever.
    for _ in 0..10 {
        desk.wait(0.06);
        desk.ask(2, &Instruction::Ping);
    }
    assert_eq!(desk.read(1, Item::BusWatchdog), 5);
    desk.wait(0.5);
    assert_eq!(desk.read(1, Item::BusWatchdog), -1);
    assert_eq!(desk.read(1, Item::TorqueEnable), 1);
    let stopped = desk.read(1, Item::PresentPosition);
    desk.wait(1.0);
    assert!((desk.read(1, Item::PresentPosition) - stopped).abs() <= 3);
    for goal in [Item::GoalPosition, Item::GoalCurrent, Item::GoalPwm] {
        assert_eq!(desk.try_write(1, goal, 100), Some(Refusal::DataRange));
    }
    assert_eq!(
        desk.try_write(1, Item::BusWatchdog, 5),
        Some(Refusal::DataRange)
    );
    desk.write(1, Item::BusWatchdog, 0);
    desk.write(1, Item::GoalPosition, stopped + 200);
    desk.wait(1.0);
    assert!(desk.read(1, Item::PresentPosition) > stopped + 100);
}

#[test]
fn robots_in_motion_and_with_friction_follow_too() {
    for physics in [
        Physics::WithFriction { coefficient: 0.1 },
        Physics::InMotion {
            timestep: 0.004,
            friction: None,
        },
    ] {
        let mut setup = setup("2m");
        setup.plant.physics = physics;
        let mut desk = Desk::new(&setup);
        for servo in 1..=6 {
            desk.drive(servo, EXTENDED);
            tune(&mut desk, servo);
            desk.write(servo, Item::ProfileVelocity, 150);
            desk.write(servo, Item::GoalPosition, 2048 + 300 * i64::from(servo));
        }
        desk.wait(2.0);
        let truth: Truth = desk.simulator.truth();
        assert!(truth.settled, "{physics:?}");
        assert!(truth.tendons.iter().all(|tendon| tendon.tension >= 0.0));
        let tip = truth.discs[9].translation.vector;
        let straight = Simulator::new(&setup, desk.clock.clone())
            .expect("valid")
            .truth();
        assert!(
            (tip - straight.discs[9].translation.vector).norm() > 0.003,
            "{physics:?}"
        );
    }
}
