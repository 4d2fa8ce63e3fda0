//! Friction takes energy and never creates any.

use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::Loads;
use tdcr_sim::tendon_friction::{FrictionPath, SlipState, TendonProfile};

use super::{CONTACT, assert_capstan, potential, pull_first, rough_robot};

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
                for (hole, contact) in now.slip_states.iter().enumerate() {
                    let beyond = |profile: &TendonProfile| -> f64 {
                        profile.lengths[hole + 1..].iter().sum()
                    };
                    let force = now.tensions[hole] - now.tensions[hole + 1];
                    let held = force / CONTACT - was.deflections[hole];
                    let slip = beyond(was) - beyond(now) - held;
                    match contact {
                        SlipState::Sticks => prop_assert!(slip.abs() < 1e-15),
                        SlipState::SlipsToServo => prop_assert!(slip > -1e-15 && force >= 0.0),
                        SlipState::SlipsToEnd => prop_assert!(slip < 1e-15 && force <= 0.0),
                    }
                    slipping += usize::from(*contact != SlipState::Sticks);
                }
            }
        }
        prop_assert!(slipping > 50);
    }
}
