//! Where paths start, what they tend to, and which robots they lead.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{Drive, Frame, Loads, Pull, Robot, RobotSpec, Wrench};
use tdcr_sim::tendon_friction::{FrictionPath, SlipState};

use super::{assert_capstan, pull_first, rough, rough_robot, rough_spec, tip};
use crate::random_robot::{Kind, random_spec};

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
                let slipping = profile
                    .slip_states
                    .iter()
                    .filter(|c| **c != SlipState::Sticks);
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
