//! What the statics promise under loads, drives and routes of every kind.

use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{
    Body, Drive, Frame, Loads, Payload, Pull, Robot, RobotSpec, TendonSpec, Waypoint, Wrench,
};
use tdcr_sim::statics::{Equilibrium, Settler};

use crate::random_robot::{Kind, random_robot, random_spec, within};

/// Loads of every kind.
fn random_loads(robot: &Robot, rng: &mut impl Rng) -> Loads {
    let mut three = |size: f64| std::array::from_fn(|_| within(-size, size, rng));
    let payload = Payload {
        mass: 0.01,
        offset: three(0.02),
    };
    let last = robot.discs().len() - 1;
    let mut loads = Loads::default()
        .with_payload(payload)
        .and_then(|loads| loads.with_line_load(three(0.1)))
        .unwrap();
    for (disc, frame) in [
        (last, Frame::Disc),
        (last / 2, Frame::World),
        (last, Frame::World),
    ] {
        let wrench = Wrench {
            disc,
            point: three(0.02),
            force: three(0.05),
            moment: three(2e-3),
            frame,
        };
        loads = loads.with_wrench(wrench).unwrap();
    }
    loads
}

/// A hole in the world (m).
fn hole(robot: &Robot, settled: &Equilibrium, waypoint: Waypoint) -> Vector3<f64> {
    let spec = robot.spec();
    let [x, y] = spec.holes(waypoint.0).unwrap().positions()[waypoint.1];
    match waypoint.0 {
        Body::Base => {
            let [w, i, j, k] = spec.base.orientation;
            let orientation =
                nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k));
            Vector3::from(spec.base.position)
                + orientation * Vector3::new(x, y, spec.base.hole_height)
        }
        Body::Disc(disc) => {
            settled.positions[disc] + settled.orientations[disc] * Vector3::new(x, y, 0.0)
        }
    }
}

/// The moment that backbone and limit put on a disc, world frame, written again from their
/// definition by the rotation vector `phi` from rest: the moment's work is the energy's change.
fn elastic_moment(robot: &Robot, settled: &Equilibrium, disc: usize) -> Vector3<f64> {
    let q = settled.configuration.0[disc];
    let body = &robot.discs()[disc];
    let energy = |turn: Vector3<f64>| {
        let q = q * nalgebra::UnitQuaternion::from_scaled_axis(turn);
        let mut energy = 0.0;
        if let Some(backbone) = &body.backbone {
            let rest = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::from(backbone.rest));
            let phi = (rest.inverse() * q).scaled_axis();
            let [x, y] = backbone.bending;
            energy +=
                0.5 * (x * phi.x.powi(2) + y * phi.y.powi(2) + backbone.torsion * phi.z.powi(2));
        }
        if let Some(limit) = &body.limit {
            energy += 0.5 * limit.stiffness * (q.angle() - limit.angle).max(0.0).powi(2);
        }
        energy
    };
    let h = 1e-5;
    let moment = Vector3::from_fn(|axis, _| {
        let turn = Vector3::ith(axis, h);
        (energy(-turn) - energy(turn)) / (2.0 * h)
    });
    settled.orientations[disc] * moment
}

/// The moment about the joint of `disc` of everything that acts on it and on the discs above, except
/// the joint itself.
fn moment_about_joint(
    robot: &Robot,
    settled: &Equilibrium,
    loads: &Loads,
    disc: usize,
) -> Vector3<f64> {
    let place = |i: usize| settled.positions[i];
    let joint = place(disc) - settled.orientations[disc] * robot.discs()[disc].origin;
    let gravity = Vector3::from(robot.spec().gravity);
    let count = robot.discs().len();
    let mut moment = elastic_moment(robot, settled, disc);
    for i in disc..count {
        let half = |i: usize| robot.discs().get(i).map_or(0.0, |d| d.offset.norm() / 2.0);
        let line = loads.line_load() * (half(i) + half(i + 1));
        moment += (place(i) - joint).cross(&line);
        let heavy = &robot.discs()[i];
        let centre = place(i) + settled.orientations[i] * heavy.centre_of_mass;
        moment += (centre - joint).cross(&(gravity * heavy.mass));
    }
    let payload = loads.tip_payload();
    let hung = place(count - 1) + settled.orientations[count - 1] * Vector3::from(payload.offset);
    moment += (hung - joint).cross(&(gravity * payload.mass));
    for wrench in loads.wrenches().iter().filter(|wrench| wrench.disc >= disc) {
        let turn = match wrench.frame {
            Frame::World => nalgebra::UnitQuaternion::identity(),
            Frame::Disc => settled.orientations[wrench.disc],
        };
        let point =
            place(wrench.disc) + settled.orientations[wrench.disc] * Vector3::from(wrench.point);
        moment += turn * Vector3::from(wrench.moment)
            + (point - joint).cross(&(turn * Vector3::from(wrench.force)));
    }
    let above = |waypoint: Waypoint| matches!(waypoint.0, Body::Disc(i) if i >= disc);
    for (tendon, tension) in robot.tendons().iter().zip(&settled.tendon_tensions) {
        for pair in tendon.route.windows(2) {
            let ends = [hole(robot, settled, pair[0]), hole(robot, settled, pair[1])];
            if above(pair[0]) == above(pair[1]) || (ends[1] - ends[0]).norm() == 0.0 {
                continue;
            }
            let (here, there) = if above(pair[0]) { (0, 1) } else { (1, 0) };
            let pull = (ends[there] - ends[here]).normalize() * *tension;
            moment += (ends[here] - joint).cross(&pull);
        }
    }
    moment
}

#[test]
fn everything_that_acts_above_a_joint_balances_about_it() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let mut settled_count = 0;
    for _ in 0..60 {
        let robot = random_robot(Kind::Elastic, &mut rng);
        let command = robot.random_command(&mut rng);
        let loads = random_loads(&robot, &mut rng);
        loads.check(&robot).unwrap();
        let settled = robot.settle(&command, &loads);
        settled_count += usize::from(settled.converged);
        if settled.residual > 1e-9 {
            continue;
        }
        for disc in 0..robot.discs().len() {
            let moment = moment_about_joint(&robot, &settled, &loads, disc).norm();
            assert!(moment < 2e-9, "{moment} N m left on joint {disc}");
        }
    }
    assert!(settled_count >= 55, "{settled_count} of 60 robots settled");
}

#[test]
fn a_slack_tendon_does_not_push() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        let tendons = module.tendons.as_mut().unwrap();
        tendons.pull = Pull::TensionOnly;
        tendons.range = [0.0, 0.2];
    }
    spec.gravity[2] = 9.81;
    let robot = Robot::new(spec).unwrap();
    let command = robot.command(&[0.03, 0.2, 0.2, 0.03, 0.2, 0.02]).unwrap();
    let settled = robot.settle(&command, &Loads::default());
    assert!(settled.converged);
    for slack in [1, 2, 4] {
        assert_eq!(settled.tendon_tensions[slack], 0.0);
        assert!(settled.tendon_lengths[slack] < 0.2);
    }
    assert!(settled.tendon_tensions[0] > 1.0);
}

/// The 2m robot on an elastic backbone, with another drive.
fn driven(drive: Drive, range: [f64; 2], pull: Pull) -> Robot {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(tdcr_sim::robot::PerDisc::Uniform(
            tdcr_sim::robot::Backbone::isotropic(0.2),
        ));
        module.tendons = Some(TendonSpec {
            drive,
            range,
            pull,
            axial_stiffness: None,
            stiffening: 0.0,
            friction: None,
            servo: None,
        });
    }
    Robot::new(spec).unwrap()
}

#[test]
fn length_drives_give_the_length_and_tension_drives_the_tension() {
    let by_gain = driven(Drive::Gain(500.0), [0.0, 0.04], Pull::Bilateral);
    let by_length = driven(Drive::Length, [0.0, 0.2], Pull::Bilateral);
    let by_tension = driven(Drive::Tension, [0.0, 100.0], Pull::Bilateral);
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    for _ in 0..50 {
        let command = by_gain.random_command(&mut rng);
        let settled = by_gain.settle(&command, &Loads::default());
        let lengths = by_length.command(&settled.tendon_lengths).unwrap();
        let same = by_length.settle(&lengths, &Loads::default());
        assert!(same.converged, "{}", same.residual);
        // Three tendons hardly change their mean length with the shape, so an error of 1e-11 m in
        // length may be one of 1e-7 m in place.
        for (a, b) in same.tendon_lengths.iter().zip(&settled.tendon_lengths) {
            assert!((a - b).abs() <= 1e-11);
        }
        let tensions = by_tension.command(&same.tendon_tensions).unwrap();
        let again = by_tension.settle(&tensions, &Loads::default());
        assert!(again.converged);
        assert_eq!(again.tendon_tensions, tensions.as_slice());
        for (p, (q, r)) in settled
            .positions
            .iter()
            .zip(same.positions.iter().zip(&again.positions))
        {
            assert!(
                (p - q).norm() < 1e-6 && (p - r).norm() < 1e-6,
                "{p} {q} {r}"
            );
        }
    }
}

#[test]
fn a_length_drive_that_only_pulls_goes_slack() {
    let robot = driven(Drive::Length, [0.0, 0.2], Pull::TensionOnly);
    let command = robot.command(&[0.08, 0.2, 0.2, 0.2, 0.2, 0.2]).unwrap();
    let settled = robot.settle(&command, &Loads::default());
    assert!(settled.converged);
    assert!((settled.tendon_lengths[0] - 0.08).abs() <= 1e-11);
    assert!(settled.tendon_tensions[0] > 0.1);
    assert!(
        settled.tendon_tensions[1..]
            .iter()
            .all(|&tension| tension == 0.0)
    );
}

#[test]
fn one_to_twenty_modules_settle() {
    for modules in 1..=20 {
        let mut spec = RobotSpec::standard("2m").unwrap();
        spec.modules = vec![spec.modules[1].clone(); modules];
        spec.gravity = [0.0, 0.0, 9.81];
        let robot = Robot::new(spec).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(23);
        for _ in 0..5 {
            let settled = robot.settle(&robot.random_command(&mut rng), &Loads::default());
            assert!(settled.converged, "{modules} modules: {}", settled.residual);
        }
    }
}

#[test]
fn a_helical_tendon_twists_the_robot() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    let tendon = spec.modules[0].tendons.clone().unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(tdcr_sim::robot::PerDisc::Uniform(
            tdcr_sim::robot::Backbone::isotropic(0.2),
        ));
        module.tendons = None;
    }
    spec.gravity = [0.0; 3];
    let twist = |sense: usize| {
        let mut spec = spec.clone();
        let mut through = vec![Waypoint(Body::Base, 0)];
        through.extend((0..10).map(|d| Waypoint(Body::Disc(d), (sense * (d + 1)) % 3)));
        spec.routes = vec![tdcr_sim::robot::RouteSpec {
            through,
            tendon: tendon.clone(),
        }];
        let robot = Robot::new(spec).unwrap();
        let settled = robot.settle(&robot.command(&[0.04]).unwrap(), &Loads::default());
        assert!(settled.converged);
        settled
            .configuration
            .0
            .iter()
            .map(|q| q.scaled_axis().z)
            .sum::<f64>()
    };
    assert!(twist(0).abs() < 1e-9);
    // Through holes 1, 2, 0, ... it turns one way, through 2, 1, 0, ... the other.
    assert!(
        twist(1) < -0.05 && twist(2) > 0.05,
        "{} {}",
        twist(1),
        twist(2)
    );
}

#[test]
fn turning_the_base_and_gravity_turns_the_answer() {
    let mut rng = ChaCha8Rng::seed_from_u64(24);
    for _ in 0..10 {
        let spec = random_spec(Kind::Elastic, &mut rng);
        let robot = Robot::new(spec.clone()).unwrap();
        let command = robot.random_command(&mut rng);
        let settled = robot.settle(&command, &Loads::default());
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -1.2, 0.7));
        let mut turned = spec.clone();
        turned.gravity = (turn * Vector3::from(spec.gravity)).into();
        turned.base.position = (turn * Vector3::from(spec.base.position)).into();
        let [w, x, y, z] = spec.base.orientation;
        let base = turn.quaternion() * nalgebra::Quaternion::new(w, x, y, z);
        turned.base.orientation = [base.w, base.i, base.j, base.k];
        let other = Robot::new(turned)
            .unwrap()
            .settle(&command, &Loads::default());
        for (p, q) in settled.positions.iter().zip(&other.positions) {
            assert!((turn * p - q).norm() < 1e-8);
        }
    }
}

#[test]
fn cold_and_warm_solves_agree() {
    let mut rng = ChaCha8Rng::seed_from_u64(25);
    let mut settled = 0;
    for _ in 0..40 {
        let robot = random_robot(Kind::Elastic, &mut rng);
        let (from, to) = (
            robot.random_command(&mut rng),
            robot.random_command(&mut rng),
        );
        let mut settler = Settler::new(&robot);
        let start = settler
            .settle(&from, &Loads::default())
            .configuration
            .clone();
        let warm = settler.settle_from(&start, &to, &Loads::default()).clone();
        settler.settle(&from, &Loads::default());
        let followed = settler.follow(&to, &Loads::default()).clone();
        let cold = settler.settle(&to, &Loads::default());
        for other in [&warm, &followed] {
            // Tendons that run to and fro may fold a robot until two of its holes meet.
            assert_eq!(other.converged, cold.converged);
            let pairs = other.positions.iter().zip(&cold.positions);
            for (p, q) in pairs.filter(|_| cold.converged) {
                assert!((p - q).norm() < 1e-8, "{p} {q}");
            }
        }
        settled += usize::from(cold.converged);
    }
    assert!(settled >= 38, "{settled} of 40 settle");
}

#[test]
fn a_wrench_on_a_disc_that_is_not_there_is_refused() {
    let robot = Robot::load("2m").unwrap();
    let loads = Loads::default()
        .with_wrench(Wrench::none(10, Frame::World))
        .unwrap();
    assert_eq!(
        loads.check(&robot).unwrap_err().to_string(),
        "a wrench acts on disc 10; the robot has 10 discs, counted from 0"
    );
    let nan = Wrench {
        moment: [0.0, f64::NAN, 0.0],
        ..Wrench::none(0, Frame::Disc)
    };
    assert!(Loads::default().with_wrench(nan).is_err());
}

/// A force off a disc's origin is the force there and its moment about the origin, in either frame where the disc rests.
#[test]
fn a_force_on_a_point_is_a_force_and_a_moment_on_the_origin() {
    let robot = driven(Drive::Gain(500.0), [0.0, 0.04], Pull::Bilateral);
    let command = robot
        .command(&[0.01, 0.02, 0.02, 0.02, 0.01, 0.02])
        .unwrap();
    for frame in [Frame::World, Frame::Disc] {
        let push = Wrench {
            point: [0.01, -0.02, 0.015],
            force: [0.1, 0.05, -0.08],
            moment: [1e-3, 0.0, 2e-3],
            ..Wrench::none(7, frame)
        };
        let settled = robot.settle(&command, &Loads::default().with_wrench(push).unwrap());
        assert!(settled.converged);
        // Of a force that keeps its direction the moment is that of the disc where it rests.
        let [point, force] = [push.point, push.force].map(Vector3::from);
        let turned = match frame {
            Frame::World => settled.orientations[7] * point,
            Frame::Disc => point,
        };
        let same = Wrench {
            point: [0.0; 3],
            moment: (Vector3::from(push.moment) + turned.cross(&force)).into(),
            ..push
        };
        let loads = Loads::default().with_wrench(same).unwrap();
        let other = robot.settle(&command, &loads);
        assert!(other.converged);
        for (p, q) in settled.positions.iter().zip(&other.positions) {
            assert!((p - q).norm() < 1e-8, "{frame:?}: {p} {q}");
        }
    }
}

#[test]
fn a_wrench_on_the_backbone_is_shared_by_the_discs_about_it() {
    let robot = Robot::load("2m").unwrap();
    let origins = robot.arc_lengths();
    let (force, moment) = ([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]);
    let at = |arc_length: f64| {
        Loads::default().with_backbone_wrench(&robot, arc_length, force, moment, Frame::World)
    };
    let between = at(0.25 * origins[3] + 0.75 * origins[4]).unwrap();
    let [below, above] = between.wrenches() else {
        panic!("{between:?}")
    };
    assert_eq!((below.disc, above.disc), (3, 4));
    let pitch = origins[4] - origins[3];
    for (wrench, share, height) in [(below, 0.25, 0.75), (above, 0.75, -0.25)] {
        assert!((wrench.force[1] - 2.0 * share).abs() < 1e-12);
        assert!((wrench.moment[2] - 0.3 * share).abs() < 1e-12);
        assert!((wrench.point[2] - height * pitch).abs() < 1e-12);
    }
    // On a disc alone; below the first, the base bears its share.
    let on_disc = at(origins[9]).unwrap();
    assert_eq!(on_disc.wrenches().len(), 1);
    assert_eq!(on_disc.wrenches()[0].point, [0.0; 3]);
    let low = at(0.5 * origins[0]).unwrap();
    assert_eq!(low.wrenches().len(), 1);
    assert!((low.wrenches()[0].force[0] - 0.5).abs() < 1e-12);
    assert!(at(0.0).unwrap().wrenches().is_empty());
    let error = at(origins[9] + 0.1).unwrap_err().to_string();
    assert!(error.starts_with("a wrench acts at"), "{error}");
    assert!(at(f64::NAN).is_err() && at(-1e-3).is_err());
}
