//! Snaps: where no equilibrium is near.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{Frame, Loads, Robot, Wrench};
use tdcr_sim::tendon_friction::FrictionPath;

use super::{assert_capstan, potential, pull_first, rough_robot, rough_spec, tip};

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
