//! Objects that the robot touches: momentum, weights, pushes.

use nalgebra::Vector3;
use tdcr_sim::contact::Sliding;
use tdcr_sim::dynamics::State;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::{HingeSpec, JointSpec, Obstacle, SliderSpec};

use super::{LEFT, STEP, among, drive, towards, weightless};

/// Balls and a box that fly at a robot without gravity: what the contacts put on the robot is what they lose.
#[test]
fn an_impact_in_free_space_keeps_momentum() {
    let robot = weightless();
    for (name, friction) in [("smooth", 0.0), ("rough", 0.6)] {
        let ball = Obstacle::sphere("ball", 0.02)
            .unwrap()
            .with_mass(0.03)
            .unwrap();
        let ball = ball.with_friction(friction).unwrap().at([0.09, 0.0, 0.3]);
        let ball = ball
            .with_velocity([-0.4, 0.01, 0.0], [0.0, 3.0, 0.0])
            .unwrap();
        let parcel = Obstacle::cuboid("box", [0.03, 0.04, 0.05])
            .unwrap()
            .with_mass(0.1)
            .unwrap();
        let parcel = parcel
            .with_friction(friction)
            .unwrap()
            .at([-0.02, 0.11, 0.27]);
        let parcel = parcel
            .with_velocity([0.0, -0.5, 0.0], [1.0, 0.0, 2.0])
            .unwrap();
        let mut stepper = among(&robot, vec![ball, parcel]);
        let mut state = State::straight(&robot);
        let masses = [0.03, 0.1];
        let mut momenta = [0, 1].map(|k| masses[k] * stepper.objects()[k].velocity);
        let (mut largest, mut worst, mut touched) = ([0.0_f64; 2], [0.0_f64; 2], [0; 2]);
        let still = towards(&robot, robot.mean_command().as_slice());
        drive(&mut stepper, &mut state, 400, still, |stepper, _| {
            for k in 0..2 {
                let contacts = stepper.contacts().iter();
                let own = contacts.filter(|contact| contact.partner.obstacle() == Some(k));
                let impulse: Vector3<f64> = own.map(|contact| contact.force * STEP).sum();
                touched[k] += usize::from(impulse != Vector3::zeros());
                let now = masses[k] * stepper.objects()[k].velocity;
                let lost = momenta[k] - now;
                worst[k] = worst[k].max((lost - impulse).norm());
                largest[k] = largest[k].max(now.norm());
                momenta[k] = now;
            }
        });
        eprintln!("{name}: momentum within {worst:?} N s of {largest:?}, {touched:?} steps");
        for k in 0..2 {
            assert!(touched[k] > 0, "{name}: {touched:?}");
            assert!(
                worst[k] <= 1e-12 * largest[k],
                "{name}: {worst:?} {largest:?}"
            );
            assert!(momenta[k].norm() > 1e-3);
        }
    }
}

/// A plate on the top of the robot presses it by its weight, and is pressed in as the compliance says.
#[test]
fn a_resting_plate_weighs_what_it_weighs() {
    let robot = Robot::load("2m").unwrap();
    let mut state = State::straight(&robot);
    let top = state.positions(&robot)[9].z + robot.discs()[9].half_height;
    for (mass, compliance) in [(0.002, 1e-6), (0.02, 1e-6), (0.02, 1e-4), (0.2, 1e-5)] {
        let plate = Obstacle::cuboid("plate", [0.1, 0.1, 0.01]).unwrap();
        let plate = plate.with_mass(mass).unwrap().at([0.0, 0.0, top + 0.0052]);
        let plate = plate.with_compliance(compliance).unwrap();
        // Up and down alone.
        let rail = SliderSpec {
            axis: [0.0, 0.0, 1.0],
            limits: None,
            damping: 0.0,
        };
        let guided = plate.with_joint(JointSpec::Slider(rail)).unwrap();
        let mut stepper = among(&robot, vec![guided]);
        state = State::straight(&robot);
        let still = towards(&robot, robot.mean_command().as_slice());
        drive(&mut stepper, &mut state, 1_500, still, |_, _| {});
        let weight = mass * 9.81;
        let force: f64 = stepper
            .contacts()
            .iter()
            .map(|contact| contact.force.z)
            .sum();
        let pressed: f64 = stepper.contacts().iter().map(|contact| -contact.gap).sum();
        eprintln!(
            "{mass} kg, {compliance} m/N: {force} N of {weight} N, {pressed:e} m of {:e} m",
            weight * compliance
        );
        assert!(
            (force / -weight - 1.0).abs() < 1e-3,
            "{mass}: {force} {weight}"
        );
        assert!(
            (pressed / (weight * compliance) - 1.0).abs() < 0.1,
            "{mass}: {pressed:e}"
        );
    }
}

/// Between the robot and a wall, where a light object that resists by its inertia alone would give way.
#[test]
fn a_box_pressed_on_a_wall_passes_on_what_the_wall_alone_would_take() {
    let robot = Robot::load("2m").unwrap();
    let wall = |x: f64| {
        Obstacle::cuboid("wall", [0.02, 0.3, 0.3])
            .unwrap()
            .at([x - 0.01, 0.0, 0.25])
    };
    let force = |obstacles: Vec<Obstacle>| {
        let mut stepper = among(&robot, obstacles);
        let mut state = State::straight(&robot);
        let (mut last, mut rough) = (0.0, 0.0_f64);
        drive(
            &mut stepper,
            &mut state,
            2_000,
            towards(&robot, &LEFT),
            |stepper, _| {
                let now: f64 = stepper
                    .contacts()
                    .iter()
                    .map(|contact| contact.force.x)
                    .sum();
                rough = 0.99 * rough.max((now - last).abs());
                last = now;
            },
        );
        (last, rough, state.positions(&robot)[9])
    };
    // The same face to the robot: of a fixed block, and of a thin plate on a rail before a wall.
    let (fixed, _, tip) = force(vec![wall(-0.05)]);
    for mass in [0.001, 0.01, 1.0] {
        let plate = Obstacle::cuboid("plate", [0.01, 0.3, 0.3]).unwrap();
        let plate = plate.with_mass(mass).unwrap().at([-0.055, 0.0, 0.25]);
        let rail = SliderSpec {
            axis: [1.0, 0.0, 0.0],
            limits: None,
            damping: 0.0,
        };
        let plate = plate.with_joint(JointSpec::Slider(rail)).unwrap();
        let (found, rough, there) = force(vec![wall(-0.06), plate]);
        eprintln!(
            "{mass} kg: {found} N beside {fixed} N; {rough:e} N from step to step, tip off {:e} m",
            (there - tip).norm()
        );
        assert!(
            (found / fixed - 1.0).abs() < 0.01,
            "{mass}: {found} {fixed}"
        );
        assert!(rough < 0.01 * fixed, "{mass}: {rough}");
        assert!((there - tip).norm() < 1e-4, "{mass}: {there:?} {tip:?}");
    }
}

/// Boxes up to a thousand times as heavy as the robot, which strikes them.
#[test]
fn heavy_boxes_do_not_blow_up() {
    let robot = Robot::load("2m").unwrap();
    let own: f64 = robot.discs().iter().map(|disc| disc.mass).sum();
    for factor in [0.01, 1.0, 10.0, 1_000.0] {
        let parcel = Obstacle::cuboid("box", [0.04, 0.04, 0.04]).unwrap();
        let parcel = parcel
            .with_mass(factor * own)
            .unwrap()
            .with_friction(0.3)
            .unwrap();
        let table = Obstacle::cuboid("table", [0.2, 0.3, 0.02])
            .unwrap()
            .at([-0.15, 0.0, 0.23]);
        let mut stepper = among(&robot, vec![table, parcel.at([-0.072, 0.0, 0.26])]);
        let mut state = State::straight(&robot);
        let (mut fastest, mut strongest) = (0.0_f64, 0.0_f64);
        let there_and_back = |time: f64| {
            let share = 0.5 - 0.5 * f64::cos(6.0 * time);
            LEFT.iter()
                .map(|value| 0.02 + (value - 0.02) * share)
                .collect()
        };
        drive(
            &mut stepper,
            &mut state,
            1_500,
            there_and_back,
            |stepper, _| {
                fastest = fastest.max(stepper.objects()[0].velocity.norm());
                for contact in stepper.contacts() {
                    strongest = strongest.max(contact.force.norm());
                }
            },
        );
        let way = (stepper.objects()[0].pose.translation.vector.x + 0.072).abs();
        let unsolved = stepper.unsolved();
        eprintln!(
            "{factor} times: {fastest} m/s, {strongest} N, moved {way} m, {unsolved} steps not to full precision"
        );
        // Bounds of friction follow the forces, of which they have a share in nearly every step.
        assert!(unsolved < 60, "{factor}: {unsolved}");
        assert!(strongest > 0.0 && state.is_finite());
        // The tip itself moves at less than half a metre a second; a box may fall off the table besides.
        assert!(fastest < 2.0, "{factor}: {fastest}");
        // The tip resists with about 0.35 kg: at half a metre a second an impact within a step is of 90 N.
        assert!(strongest < 100.0, "{factor}: {strongest}");
    }
}

/// A door that the robot opens turns by what the robot's way says, and the force is that of its damper.
#[test]
fn a_pushed_door_opens_about_its_hinge() {
    let robot = Robot::load("2m").unwrap();
    let door = Obstacle::cuboid("door", [0.006, 0.2, 0.2]).unwrap();
    let door = door.with_mass(0.05).unwrap().at([-0.04, 0.1, 0.28]);
    let hinge = HingeSpec {
        axis: [0.0, 0.0, 1.0],
        anchor: [0.0, 0.1, 0.0],
        limits: Some([-1.5, 1.5]),
        damping: 0.05,
    };
    let door = door.with_joint(JointSpec::Hinge(hinge)).unwrap();
    let mut stepper = among(&robot, vec![door]);
    let mut state = State::straight(&robot);
    let mut steps = 0;
    drive(
        &mut stepper,
        &mut state,
        1_000,
        towards(&robot, &LEFT),
        |stepper, _| {
            steps += usize::from(!stepper.contacts().is_empty());
            assert!(
                stepper
                    .contacts()
                    .iter()
                    .all(|contact| contact.sliding == Sliding::Free)
            );
        },
    );
    let door = &stepper.objects()[0];
    let turn = door.pose.rotation.scaled_axis();
    let pin = door.pose.transform_point(&[0.0, 0.1, 0.0].into()).coords;
    eprintln!(
        "turned by {turn:?} in {steps} steps with contacts, pin off by {:e} m",
        (pin - Vector3::new(-0.04, 0.2, 0.28)).norm()
    );
    assert!(turn.z.abs() > 0.1 && turn.xy().norm() < 1e-3, "{turn:?}");
    assert!(
        (pin - Vector3::new(-0.04, 0.2, 0.28)).norm() < 1e-4,
        "{pin:?}"
    );
    assert!(steps > 100);
}
