//! The capstan law at each hole, and the balance of every disc.

use nalgebra::Vector3;
use tdcr_sim::robot::{Body, Drive, Loads, Pull, Robot, RouteSpec, TendonSpec, Waypoint};
use tdcr_sim::tendon_friction::{FrictionPath, SlipState, TendonProfile};

use super::{BACKBONE, pull_first, rough, rough_robot, rough_spec, tip};

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
            stiffening: 0.0,
            friction: rough(coefficient),
            servo: None,
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
        (16.0, SlipState::SlipsToServo, (-coefficient * wrap).exp()),
        (1.0, SlipState::SlipsToEnd, (coefficient * wrap).exp()),
    ] {
        let state = path.advance(&pull(tension), &Loads::default());
        assert!(state.equilibrium.converged);
        let profile = &state.tendons[6];
        assert_eq!(profile.tensions[0], tension);
        assert_eq!(profile.slip_states[0], contact);
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
    assert_eq!(loading.1.slip_states[0], SlipState::SlipsToServo);
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
