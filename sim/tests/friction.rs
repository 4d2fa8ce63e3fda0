//! What paths with friction promise, checked from outside through the public interface.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use nalgebra::Vector3;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::friction::{Contact, FrictionPath, FrictionState, TendonProfile};
use tdcr_sim::robot::{
    Backbone, Body, Drive, Frame, Friction, Loads, PerDisc, Pull, Robot, RobotSpec, RouteSpec,
    TendonSpec, Waypoint, Wrench,
};

#[path = "common/random_robot.rs"]
#[allow(dead_code, reason = "shared with tests that draw other robots")]
mod random_robot;
use random_robot::{Kind, random_spec};

/// Stiffness of every joint's backbone (N m/rad).
const BACKBONE: f64 = 0.2;
/// Stiffness of the contacts (N/m).
const CONTACT: f64 = 1e5;

fn rough(coefficient: f64) -> Option<Friction> {
    Some(Friction {
        coefficient,
        contact_stiffness: CONTACT,
    })
}

/// The 2m robot on an elastic backbone, with friction in every hole.
fn rough_spec(coefficient: f64) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(BACKBONE)));
        module.tendons.as_mut().unwrap().friction = rough(coefficient);
    }
    spec
}

fn rough_robot(coefficient: f64) -> Robot {
    Robot::new(rough_spec(coefficient)).unwrap()
}

/// All tendons at 0.03 m, but the first.
fn pull_first(robot: &Robot, first: f64) -> tdcr_sim::robot::Command {
    robot
        .command(&[first, 0.03, 0.03, 0.03, 0.03, 0.03])
        .unwrap()
}

fn tip(state: &FrictionState) -> Vector3<f64> {
    *state.equilibrium.positions.last().unwrap()
}

/// Weight and backbones (J), written here again from the specification.
fn potential(robot: &Robot, state: &FrictionState) -> f64 {
    let weight: f64 = (robot.discs().iter().zip(&state.equilibrium.positions))
        .map(|(disc, position)| disc.mass * 9.81 * position.z)
        .sum();
    let joints = state.equilibrium.configuration.0.iter();
    let bends: f64 = joints.map(|q| 0.5 * BACKBONE * q.angle().powi(2)).sum();
    weight + bends
}

/// Whether each contact is within the capstan cone, and at its edge where it slips; a tendon that
/// does not pull has no friction.
fn assert_capstan(profile: &TendonProfile, coefficient: f64) {
    for (hole, contact) in profile.contacts.iter().enumerate() {
        let [before, after] = [profile.tensions[hole], profile.tensions[hole + 1]];
        if before <= 0.0 {
            assert_eq!(before, after);
            continue;
        }
        let bound = (coefficient * profile.wrap_angles[hole]).exp();
        let (low, high) = (before / bound, before * bound);
        let rounding = 1e-13 * before;
        match contact {
            Contact::Sticks => {
                assert!(after >= low - rounding && after <= high + rounding);
            }
            Contact::SlipsToServo => assert!((after - low).abs() < rounding),
            Contact::SlipsToEnd => assert!((after - high).abs() < rounding),
        }
    }
}

#[test]
fn without_friction_a_path_is_the_settler_bit_for_bit() {
    for friction in [None, rough(0.0)] {
        let mut spec = RobotSpec::standard("3m").unwrap();
        for module in &mut spec.modules {
            module.tendons.as_mut().unwrap().friction = friction;
        }
        let robot = Robot::new(spec).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut path = FrictionPath::new(&robot);
        for _ in 0..20 {
            let command = robot.random_command(&mut rng);
            let loads = Loads::payload(0.03 * rng.random::<f64>()).unwrap();
            let state = path.advance(&command, &loads);
            assert_eq!(state.equilibrium, robot.settle(&command, &loads));
            assert_eq!((state.dissipated, state.stored), (0.0, 0.0));
            for (profile, tension) in (state.tendons.iter()).zip(&state.equilibrium.tendon_tensions)
            {
                assert!(profile.tensions.iter().all(|t| t == tension));
            }
        }
    }
}

#[test]
fn a_path_starts_from_the_equilibrium_without_friction() {
    let (robot, smooth) = (rough_robot(0.3), rough_robot(0.0));
    let command = pull_first(&robot, 0.01);
    let mut path = FrictionPath::new(&robot);
    let state = path.start(&command, &Loads::default());
    assert_eq!(
        state.equilibrium,
        smooth.settle(&command, &Loads::default())
    );
    let again = path.advance(&command, &Loads::default());
    assert!(again.equilibrium.converged && again.equilibrium.iterations == 0);
}

/// A robot whose last tendon goes around two holes of the base before it goes up.
fn robot_with_a_fixed_wrap(coefficient: f64) -> (Robot, f64) {
    let mut spec = rough_spec(0.0);
    let up = (0..5).map(|disc| Waypoint(Body::Disc(disc), 2));
    spec.routes.push(RouteSpec {
        through: (0..3)
            .map(|hole| Waypoint(Body::Base, hole))
            .chain(up)
            .collect(),
        tendon: TendonSpec {
            drive: Drive::Tension,
            range: [0.0, 20.0],
            pull: Pull::Bilateral,
            axial_stiffness: None,
            friction: rough(coefficient),
        },
    });
    let holes = spec.base.holes.positions();
    let side = |a: usize, b: usize| {
        Vector3::new(holes[b][0] - holes[a][0], holes[b][1] - holes[a][1], 0.0)
    };
    let wrap = side(0, 1).angle(&side(1, 2));
    (Robot::new(spec).unwrap(), wrap)
}

#[test]
fn a_fixed_wrap_in_full_slip_has_the_capstan_ratio() {
    let coefficient = 0.25;
    let (robot, wrap) = robot_with_a_fixed_wrap(coefficient);
    let pull = |tension: f64| {
        robot
            .command(&[0.03, 0.03, 0.03, 0.03, 0.03, 0.03, tension])
            .unwrap()
    };
    let mut path = FrictionPath::new(&robot);
    path.start(&pull(4.0), &Loads::default());
    for (tension, contact, ratio) in [
        (16.0, Contact::SlipsToServo, (-coefficient * wrap).exp()),
        (1.0, Contact::SlipsToEnd, (coefficient * wrap).exp()),
    ] {
        let state = path.advance(&pull(tension), &Loads::default());
        assert!(state.equilibrium.converged);
        let profile = &state.tendons[6];
        assert_eq!(profile.tensions[0], tension);
        assert_eq!(profile.contacts[0], contact);
        assert!((profile.wrap_angles[0] - wrap).abs() < 1e-12);
        let found = profile.tensions[1] / profile.tensions[0];
        assert!((found / ratio - 1.0).abs() < 1e-14, "{found} for {ratio}");
    }
}

#[test]
fn loading_and_unloading_differ() {
    let robot = rough_robot(0.2);
    let mut path = FrictionPath::new(&robot);
    path.start(&pull_first(&robot, 0.03), &Loads::default());
    let mut at_half = Vec::new();
    for first in [0.015, 0.0, 0.015] {
        let state = path.advance(&pull_first(&robot, first), &Loads::default());
        assert!(state.equilibrium.converged);
        at_half.push((tip(state), state.tendons[0].clone()));
    }
    let (loading, unloading) = (&at_half[0], &at_half[2]);
    assert!((loading.0 - unloading.0).norm() > 1e-3);
    // Pulled, less of the tension arrives at the tendon's end.
    let arrives = |profile: &TendonProfile| profile.tensions[4] / profile.tensions[0];
    assert!(arrives(&loading.1) < arrives(&unloading.1) - 0.01);
    assert_eq!(loading.1.contacts[0], Contact::SlipsToServo);
}

/// Servo work and dissipation (J) of the third round of a loop of the first tendon, and how much
/// energy the robot's potential gains over it.
fn loop_energies(coefficient: f64, resolution: f64) -> [f64; 3] {
    let robot = rough_robot(coefficient);
    let mut path = FrictionPath::new(&robot).with_resolution(resolution);
    path.start(&pull_first(&robot, 0.02), &Loads::default());
    let mut rounds = Vec::new();
    for _ in 0..3 {
        path.advance(&pull_first(&robot, 0.0), &Loads::default());
        let state = path.advance(&pull_first(&robot, 0.03), &Loads::default());
        assert!(state.equilibrium.converged);
        let potential = potential(&robot, state) + state.stored;
        rounds.push([state.servo_work, state.dissipated, potential]);
    }
    std::array::from_fn(|i| rounds[2][i] - rounds[1][i])
}

#[test]
fn the_work_around_a_closed_loop_is_dissipated_and_grows_with_friction() {
    let mut last = 0.0;
    for coefficient in [0.01, 0.02, 0.04, 0.08] {
        let [work, dissipated, gained] = loop_energies(coefficient, 1e-3);
        assert!(gained.abs() < 1e-9 * dissipated, "the loop is closed");
        assert!((work / dissipated - 1.0).abs() < 1e-4);
        assert!(dissipated > 1.2 * last);
        last = dissipated;
    }
}

#[test]
fn the_energy_balance_is_second_order_in_the_resolution() {
    let error = |resolution| {
        let [work, dissipated, gained] = loop_energies(0.2, resolution);
        (work - dissipated - gained).abs() / dissipated
    };
    let (coarse, fine) = (error(0.02), error(0.005));
    assert!(coarse < 5e-3 && fine < coarse / 8.0, "{coarse} {fine}");
}

#[test]
fn finer_substeps_converge_to_one_path() {
    let end = |resolution: f64| {
        let robot = rough_robot(0.2);
        let mut path = FrictionPath::new(&robot).with_resolution(resolution);
        for values in [
            [0.03, 0.03, 0.03, 0.03, 0.03, 0.03],
            [0.0, 0.03, 0.03, 0.03, 0.01, 0.03],
            [0.02, 0.01, 0.03, 0.03, 0.03, 0.02],
            [0.02, 0.02, 0.02, 0.03, 0.03, 0.0],
        ] {
            path.advance(&robot.command(&values).unwrap(), &Loads::default());
            assert!(path.state().equilibrium.converged);
        }
        tip(path.state())
    };
    let finest = end(0.001);
    let errors = [0.16, 0.02, 0.0025].map(|resolution| (end(resolution) - finest).norm());
    assert!(errors[2] < 1e-6 && errors[1] < 2e-5 && errors[2] < 0.1 * errors[0]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_path_creates_energy(seed in any::<u64>(), coefficient in 0.01..0.4) {
        let robot = rough_robot(coefficient);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut path = FrictionPath::new(&robot).with_resolution(5e-3);
        let first = robot.random_command(&mut rng);
        let state = path.start(&first, &Loads::default());
        prop_assert!(state.equilibrium.converged);
        let start = potential(&robot, state);
        let mut dissipated = 0.0;
        for round in 0..5 {
            let command = if round == 4 { first.clone() } else { robot.random_command(&mut rng) };
            let state = path.advance(&command, &Loads::default());
            prop_assert!(state.dissipated >= dissipated);
            dissipated = state.dissipated;
            let gained = potential(&robot, state) - start + state.stored;
            let lost = state.servo_work - gained - dissipated - state.snapped;
            prop_assert!(lost.abs() < 1e-3 * dissipated + 1e-5, "{lost} of {dissipated} J");
            for profile in &state.tendons {
                assert_capstan(profile, coefficient);
            }
        }
    }

    #[test]
    fn no_contact_slips_against_its_motion(seed in any::<u64>(), coefficient in 0.01..0.4) {
        let robot = rough_robot(coefficient);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut path = FrictionPath::new(&robot).with_resolution(1.0);
        let mut values = [0.02; 6];
        path.start(&robot.command(&values).unwrap(), &Loads::default());
        let mut slipping = 0;
        for _ in 0..20 {
            let before = path.state().clone();
            for value in &mut values {
                *value = f64::clamp(*value + 2e-3 * (rng.random::<f64>() - 0.5), 0.0, 0.04);
            }
            let state = path.advance(&robot.command(&values).unwrap(), &Loads::default());
            prop_assert!(state.equilibrium.converged);
            if state.substeps != 1 {
                continue;
            }
            for (now, was) in state.tendons.iter().zip(&before.tendons) {
                for (hole, contact) in now.contacts.iter().enumerate() {
                    let beyond = |profile: &TendonProfile| -> f64 {
                        profile.lengths[hole + 1..].iter().sum()
                    };
                    let force = now.tensions[hole] - now.tensions[hole + 1];
                    let held = force / CONTACT - was.deflections[hole];
                    let slip = beyond(was) - beyond(now) - held;
                    match contact {
                        Contact::Sticks => prop_assert!(slip.abs() < 1e-15),
                        Contact::SlipsToServo => prop_assert!(slip > -1e-15 && force >= 0.0),
                        Contact::SlipsToEnd => prop_assert!(slip < 1e-15 && force <= 0.0),
                    }
                    slipping += usize::from(*contact != Contact::Sticks);
                }
            }
        }
        prop_assert!(slipping > 50);
    }
}

#[test]
fn little_friction_changes_little() {
    let smooth = rough_robot(0.0);
    let goal = smooth
        .command(&[0.0, 0.02, 0.03, 0.03, 0.01, 0.02])
        .unwrap();
    let without = smooth.settle(&goal, &Loads::default()).positions[9];
    let apart = |coefficient: f64| {
        let robot = rough_robot(coefficient);
        let mut path = FrictionPath::new(&robot);
        path.start(&pull_first(&robot, 0.03), &Loads::default());
        let state = path.advance(&goal, &Loads::default());
        assert!(state.equilibrium.converged);
        (tip(state) - without).norm()
    };
    let apart = [4e-3, 2e-3, 1e-3].map(apart);
    assert!(apart[0] > 1e-5);
    for pair in apart.windows(2) {
        assert!((pair[0] / pair[1] - 2.0).abs() < 0.05, "{apart:?}");
    }
}

/// Force and moment balance of every disc, cut free from its neighbours.
#[test]
fn the_tension_profiles_weight_and_backbones_balance_at_every_disc() {
    let robot = rough_robot(0.3);
    let mut path = FrictionPath::new(&robot);
    path.start(&pull_first(&robot, 0.03), &Loads::default());
    let goal = robot
        .command(&[0.0, 0.03, 0.02, 0.03, 0.015, 0.03])
        .unwrap();
    let payload = 0.02;
    let state = path.advance(&goal, &Loads::payload(payload).unwrap());
    let equilibrium = &state.equilibrium;
    assert!(equilibrium.converged);
    let spec = robot.spec();
    let hole = |disc: Option<usize>, number: usize| {
        let [x, y] = spec.base.holes.positions()[number];
        match disc {
            None => Vector3::new(x, y, spec.base.position[2] + spec.base.hole_height),
            Some(disc) => {
                let local = Vector3::new(x, y, 0.0);
                equilibrium.positions[disc] + equilibrium.orientations[disc] * local
            }
        }
    };
    // Every module has the base's holes.
    let mut forces = [Vector3::zeros(); 10];
    let mut moments = [Vector3::zeros(); 10];
    for (tendon, profile) in state.tendons.iter().enumerate() {
        assert_eq!(profile.tensions.len(), 5);
        for (segment, tension) in profile.tensions.iter().enumerate() {
            let upper = 5 * (tendon / 3) + segment;
            let lower = upper.checked_sub(1);
            let (a, b) = (hole(lower, tendon % 3), hole(Some(upper), tendon % 3));
            let pull = (b - a).normalize() * *tension;
            forces[upper] -= pull;
            moments[upper] -= (b - equilibrium.positions[upper]).cross(&pull);
            if let Some(lower) = lower {
                forces[lower] += pull;
                moments[lower] += (a - equilibrium.positions[lower]).cross(&pull);
            }
        }
    }
    let mut from_above = Vector3::zeros();
    let mut bend_above = Vector3::zeros();
    for disc in (0..10).rev() {
        let hung = if disc == 9 { payload } else { 0.0 };
        let weight = Vector3::z() * -9.81 * (robot.discs()[disc].mass + hung);
        let joint = &equilibrium.configuration.0[disc];
        // The backbone below turns the disc back by its stiffness times the rotation vector.
        let bend = equilibrium.orientations[disc] * (joint.scaled_axis() * -BACKBONE);
        let mut moment = moments[disc] + bend - bend_above;
        if disc < 9 {
            let arm = equilibrium.positions[disc + 1] - equilibrium.positions[disc];
            moment += arm.cross(&from_above);
        }
        assert!(moment.norm() < 1e-9, "disc {disc}: {moment:?}");
        from_above += forces[disc] + weight;
        bend_above = bend;
    }
}

/// Tendons that pass discs by, turn back, only pull, or hold a tension.
#[test]
fn paths_of_random_robots_keep_to_the_capstan_law() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let (mut reached, mut slips, mut asked) = (0, 0, 0);
    for _ in 0..30 {
        let mut spec = random_spec(Kind::Elastic, &mut rng);
        (spec.modules.iter_mut().filter_map(|m| m.tendons.as_mut()))
            .chain(spec.routes.iter_mut().map(|route| &mut route.tendon))
            .for_each(|tendon| tendon.friction = rough(0.1));
        let robot = Robot::new(spec).unwrap();
        let mut path = FrictionPath::new(&robot);
        let start = path.start(&robot.random_command(&mut rng), &Loads::default());
        if !start.equilibrium.converged {
            continue;
        }
        for _ in 0..4 {
            let state = path.advance(&robot.random_command(&mut rng), &Loads::default());
            asked += 1;
            reached += usize::from(state.equilibrium.converged);
            for profile in &state.tendons {
                assert_capstan(profile, 0.1);
                let slipping = profile.contacts.iter().filter(|c| **c != Contact::Sticks);
                slips += slipping.count();
            }
        }
    }
    assert!(reached * 10 >= asked * 9, "{reached} of {asked} commands");
    assert!(slips > 500);
}

#[test]
fn a_driven_length_is_held_against_friction() {
    let mut spec = rough_spec(0.2);
    for module in &mut spec.modules {
        let tendons = module.tendons.as_mut().unwrap();
        tendons.drive = Drive::Length;
        tendons.range = [0.05, 0.12];
        tendons.pull = Pull::TensionOnly;
    }
    let robot = Robot::new(spec).unwrap();
    let slack = robot.command(&[0.087; 6]);
    let mut path = FrictionPath::new(&robot);
    path.start(&slack.unwrap(), &Loads::default());
    let pulled = [0.078, 0.095, 0.095, 0.087, 0.095, 0.08];
    let state = path.advance(&robot.command(&pulled).unwrap(), &Loads::default());
    assert!(state.equilibrium.converged);
    for (t, length) in pulled.iter().enumerate() {
        let profile = &state.tendons[t];
        let found: f64 = profile.lengths.iter().sum();
        if profile.tensions[0] > 0.0 {
            assert!((found - length).abs() < 2e-11, "tendon {t}: {found} m");
        } else {
            assert!(found <= *length);
        }
    }
    assert!(state.tendons[0].tensions[0] > state.tendons[0].tensions[4]);
    assert_capstan(&state.tendons[0], 0.2);
}

#[test]
fn a_force_that_turns_with_its_disc_pushes_a_path_as_it_does_the_settler() {
    let wrench = Wrench {
        force: [0.3, 0.0, 0.0],
        moment: [0.0, 0.01, 0.0],
        ..Wrench::none(9, Frame::Disc)
    };
    let push = Loads::default().with_wrench(wrench).unwrap();
    let smooth = rough_robot(0.0);
    let command = pull_first(&smooth, 0.03);
    let without = smooth.settle(&command, &push).positions[9];
    let pushed = |coefficient: f64| {
        let robot = rough_robot(coefficient);
        let mut path = FrictionPath::new(&robot);
        path.start(&command, &Loads::default());
        let start = tip(path.state());
        let state = path.advance(&command, &push);
        assert!(state.equilibrium.converged);
        ((tip(state) - without).norm(), (tip(state) - start).norm())
    };
    let ((missed, moved), (missed_more, moved_less)) = (pushed(1e-5), pushed(0.2));
    assert!(missed < 1e-5 && moved > 1e-2, "{missed} {moved}");
    assert!(missed_more > 1e-3 && moved_less < moved);
}

/// Strong friction makes contacts let go so suddenly that no equilibrium is near.
#[test]
fn where_no_equilibrium_is_near_the_robot_snaps_and_the_energy_is_accounted_for() {
    let robot = rough_robot(0.3);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut path = FrictionPath::new(&robot).with_resolution(5e-3);
    let first = robot.random_command(&mut rng);
    let start = potential(&robot, path.start(&first, &Loads::default()));
    let (mut snaps, mut snapped) = (0, 0.0);
    for _ in 0..20 {
        let command = robot.random_command(&mut rng);
        let state = path.advance(&command, &Loads::default());
        assert!(state.equilibrium.converged && state.equilibrium.residual < 1e-9);
        assert!(state.snapped >= snapped && (state.snapped > snapped) == (state.snaps > snaps));
        (snaps, snapped) = (state.snaps, state.snapped);
        for profile in &state.tendons {
            assert_capstan(profile, 0.3);
        }
        let gained = potential(&robot, state) - start + state.stored;
        let lost = state.servo_work - gained - state.dissipated - state.snapped;
        assert!(
            lost.abs() < 2e-3 * (state.dissipated + state.snapped),
            "{lost} J"
        );
    }
    assert!(snaps > 0);
}

/// Free joints have bends that only gravity holds: paths that fold back snap there.
#[test]
fn a_robot_without_a_backbone_follows_its_commands() {
    let mut spec = rough_spec(0.1);
    for module in &mut spec.modules {
        module.backbone = None;
    }
    let robot = Robot::new(spec).unwrap();
    let mut path = FrictionPath::new(&robot);
    for first in [0.04, 0.03, 0.02, 0.01, 0.0, 0.02, 0.04] {
        let command = robot.command(&[first, 0.02, 0.02, 0.02, 0.02, 0.02]);
        let state = path.advance(&command.unwrap(), &Loads::default());
        assert!(state.equilibrium.converged, "{first} m");
    }
}

/// A large moment that turns with the tip winds the robot up without end.
#[test]
fn a_path_that_comes_to_no_rest_says_so_and_stays() {
    let robot = rough_robot(0.1);
    let mut path = FrictionPath::new(&robot);
    let command = pull_first(&robot, 0.03);
    path.start(&command, &Loads::default());
    let before = path.state().clone();
    let twist = Wrench {
        moment: [0.0, 5.0, 0.0],
        ..Wrench::none(9, Frame::Disc)
    };
    let load = Loads::default().with_wrench(twist).unwrap();
    let state = path.advance(&command, &load).clone();
    assert!(!state.equilibrium.converged && state.equilibrium.residual > 1e-3);
    for profile in &state.tendons {
        assert_capstan(profile, 0.1);
    }
    // Straight back from there it goes on.
    let back = path.advance(&command, &Loads::default());
    assert!(back.equilibrium.converged);
    assert!((tip(back) - tip(&before)).norm() < 0.05);
}
