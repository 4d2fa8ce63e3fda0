//! Stability of motion under loads without a potential: closed forms, and the robot's own motion.

use std::f64::consts::PI;

use tdcr_sim::chain::Configuration;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::robot::{
    Backbone, Disc, Frame, Holes, Loads, MassSpec, PerDisc, RigidMass, Robot, RobotSpec,
    RodDamping, RodSpec, Wrench,
};
use tdcr_sim::statics::{Equilibrium, Examined, Stability};

/// A straight robot of one module without weight, tendons, damping and armature.
fn straight(discs: usize, pitch: f64, joint_below: f64) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.gravity = [0.0; 3];
    spec.base.position = [0.0; 3];
    spec.base.hole_height = 0.0;
    spec.base.holes = Holes::At(Vec::new());
    spec.modules.truncate(1);
    let module = &mut spec.modules[0];
    (module.discs, module.pitch, module.first_offset) = (discs, pitch, pitch);
    module.joint_below = joint_below;
    (module.radius, module.half_height) = (0.004, pitch / 8.0);
    module.holes = Holes::At(Vec::new());
    module.tendons = None;
    module.damping = PerDisc::Uniform(0.0);
    module.armature = PerDisc::Uniform(0.0);
    spec
}

/// Length of the column (m), its bending stiffness (N m²), and its mass per length (kg/m): a steel wire.
const LENGTH: f64 = 0.5;
const STIFFNESS: f64 = 50e9 * PI * 1e-12 / 4.0;

/// A column of so many discs, whose joints are damped by the rod's relaxation time (s).
fn column(discs: usize, relaxation: f64) -> Robot {
    let pitch = LENGTH / discs as f64;
    let mut spec = straight(discs, pitch, pitch / 2.0);
    let module = &mut spec.modules[0];
    module.mass = MassSpec::Density(PerDisc::Uniform(0.0));
    module.rod = Some(RodSpec {
        youngs: 50e9,
        poisson: 0.3,
        radius: 1e-3,
        density: 7800.0,
        damping: RodDamping {
            bending: relaxation,
            torsion: relaxation,
        },
    });
    Robot::new(spec).unwrap()
}

/// A push along the axis of the tip disc, which turns with it; in units of `E I / L²`.
fn follower(robot: &Robot, load: f64) -> Loads {
    push(
        robot,
        [0.0, 0.0, -load * STIFFNESS / (LENGTH * LENGTH)],
        Frame::Disc,
    )
}

fn push(robot: &Robot, force: [f64; 3], frame: Frame) -> Loads {
    let tip = Wrench {
        force,
        ..Wrench::none(robot.discs().len() - 1, frame)
    };
    Loads::default().with_wrench(tip).unwrap()
}

fn is_undamped(disc: &Disc) -> bool {
    disc.damping == 0.0 && disc.extra_damping.iter().all(|damping| *damping == 0.0)
}

fn settle(robot: &Robot, loads: &Loads) -> Equilibrium {
    let settled = robot.settle(&robot.command(&[]).unwrap(), loads);
    assert!(settled.residual < 1e-9, "{}", settled.residual);
    let examined = if loads.wrenches().iter().any(|w| w.frame == Frame::Disc) {
        Examined::Motion
    } else {
        Examined::Energy
    };
    assert_eq!(settled.examined, Some(examined));
    match settled.stability {
        Some(Stability::Stable | Stability::Neutral) => assert!(settled.converged),
        Some(Stability::Flutter) if robot.discs().iter().all(is_undamped) => {
            assert!(settled.converged);
        }
        _ => assert!(!settled.converged),
    }
    settled
}

/// The load from which on the robot flutters, by bisection.
fn critical(robot: &Robot, mut low: f64, mut high: f64, load: impl Fn(f64) -> Loads) -> f64 {
    let flutters = |share: f64| settle(robot, &load(share)).stability == Some(Stability::Flutter);
    assert!(!flutters(low) && flutters(high));
    while high - low > 1e-5 * high {
        let middle = f64::midpoint(low, high);
        if flutters(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// Beck, Zeitschrift fuer angewandte Mathematik und Physik 3 (1952): 20.05 `E I / L²` without damping, where the two lowest
/// frequencies meet in 11.02 `(E I / m L⁴)^(1/2)`.
#[test]
fn a_column_flutters_above_becks_load() {
    let mut errors = Vec::new();
    for discs in [12, 24, 48] {
        let robot = column(discs, 0.0);
        let found = critical(&robot, 15.0, 25.0, |load| follower(&robot, load));
        errors.push((found / 20.0509 - 1.0).abs());
    }
    // Of second order in the pitch.
    assert!(
        errors[2] < 0.003 && errors[2] < 0.4 * errors[1],
        "{errors:?}"
    );
    let robot = column(48, 0.0);
    let growth = settle(&robot, &follower(&robot, 20.1)).growth.unwrap();
    let unit = (STIFFNESS / (7800.0 * PI * 1e-6)).sqrt() / (LENGTH * LENGTH);
    assert!(
        (growth.angular_frequency / unit / 11.02 - 1.0).abs() < 0.01,
        "{growth:?}"
    );
    assert!(growth.without_damping);
    // Far above, too, and in robots whose rates are not all computed.
    for (discs, load) in [(25, 21.0), (25, 40.0), (25, 80.0), (200, 21.0), (200, 40.0)] {
        let robot = column(discs, 0.0);
        let settled = settle(&robot, &follower(&robot, load));
        assert_eq!(
            settled.stability,
            Some(Stability::Flutter),
            "{discs}, {load}"
        );
        let failure = settled.failure(&robot, &robot.command(&[]).unwrap());
        assert!(failure.is_none(), "{failure:?}");
    }
    for (discs, load) in [(25, 5.0), (25, 15.0), (25, 19.0), (200, 19.0)] {
        let robot = column(discs, 0.0);
        let settled = settle(&robot, &follower(&robot, load));
        assert_eq!(
            settled.stability,
            Some(Stability::Stable),
            "{discs}, {load}"
        );
    }
}

/// Ziegler's paradox: however weak, internal damping makes the column flutter at 10.94 `E I / L²` already (Bolotin and Zhinzher,
/// International Journal of Solids and Structures 5, 1969), slowly.
#[test]
fn damping_of_the_column_itself_makes_it_flutter_earlier() {
    let robot = column(24, 1e-4);
    let found = critical(&robot, 5.0, 15.0, |load| follower(&robot, load));
    assert!((found / 10.94 - 1.0).abs() < 0.03, "{found}");
    let growth = settle(&robot, &follower(&robot, 15.0)).growth.unwrap();
    assert!(!growth.without_damping && growth.rate < 0.1, "{growth:?}");
    let growth = settle(&robot, &follower(&robot, 25.0)).growth.unwrap();
    assert!(growth.without_damping && growth.rate > 10.0, "{growth:?}");
}

/// Ziegler's double pendulum: masses 2 m and m on links of length l, springs c in the joints, a force that follows the upper
/// link. Flutter at `P l / c = 7/2 - sqrt 2` without damping, at 41/28 with equal and vanishing damping in both joints (Ziegler,
/// Ingenieur-Archiv 20, 1952; Herrmann and Jong, Journal of Applied Mechanics 32, 1965).
#[test]
fn zieglers_double_pendulum_flutters_at_the_known_loads() {
    for (damping, expected) in [(0.0, 3.5 - 2.0_f64.sqrt()), (0.01, 41.0 / 28.0)] {
        let mut spec = straight(2, 1.0, 1.0);
        let module = &mut spec.modules[0];
        let point = |mass: f64| RigidMass {
            mass,
            inertia: [1e-9; 3],
            ..RigidMass::default()
        };
        module.mass = MassSpec::Rigid(PerDisc::Each(vec![point(2.0), point(1.0)]));
        module.backbone = Some(PerDisc::Uniform(Backbone {
            bending: [1.0, 1.0],
            torsion: 1.0,
            rest: [0.0; 3],
        }));
        module.damping = PerDisc::Uniform(damping);
        let robot = Robot::new(spec).unwrap();
        let load = |load: f64| push(&robot, [0.0, 0.0, -load], Frame::Disc);
        let found = critical(&robot, 1.0, 3.0, load);
        assert!(
            (found / expected - 1.0).abs() < 5e-4,
            "{damping}: {found}, not {expected}"
        );
    }
}

/// The rate at which the robot's own motion grows is the one that is said, below the load that makes it grow and above.
#[test]
fn the_robots_own_motion_grows_as_said() {
    let robot = column(25, 1e-4);
    let command = robot.command(&[]).unwrap();
    for (load, settling) in [(9.0, 0.6), (21.0, 0.7), (25.0, 0.25)] {
        let loads = follower(&robot, load);
        let growth = settle(&robot, &loads).growth;
        let mut state = State::straight(&robot);
        let mut turns = vec![0.0; robot.dof()];
        turns[0] = 1e-10;
        Configuration::straight(&robot).retract(&robot, &turns, &mut state.configuration);
        let mut stepper = Stepper::new(&robot, 2e-4, Integrator::ImplicitMidpoint).unwrap();
        // Size of the tip's motion over some swings, early and late.
        let mut largest = |seconds: f64| {
            let mut most: f64 = 0.0;
            for _ in 0..(seconds / 2e-4) as usize {
                stepper.step(&mut state, &command, &loads).unwrap();
                most = most.max(state.positions(&robot)[24].xy().norm());
            }
            most
        };
        largest(settling);
        // Two swings each, so that both have their peaks at the same time.
        let period = growth.map_or(0.24, |growth| 4.0 * PI / growth.angular_frequency);
        let (early, late) = (largest(period), largest(period));
        let found = (late / early).ln() / period;
        match growth {
            None => assert!(found < 0.5, "{load}: {found} 1/s"),
            Some(growth) => {
                let expected = growth.rate;
                assert!(
                    (found / expected - 1.0).abs() < 0.05,
                    "{load}: {found}, not {expected} 1/s"
                );
            }
        }
    }
}

/// A buckled column turns freely about its axis: whatever the load, and however well it has settled, it is neutral.
#[test]
fn a_buckled_column_that_turns_freely_is_neutral() {
    for discs in [5, 20, 60] {
        let robot = column(discs, 1e-4);
        let euler = 0.25 * PI * PI * STIFFNESS / (LENGTH * LENGTH);
        for k in 0..24 {
            let share = 1.02 + 0.06 * f64::from(k);
            let settled = settle(
                &robot,
                &push(&robot, [0.0, 0.0, -share * euler], Frame::World),
            );
            let bent = settled.positions[discs - 1].xy().norm();
            assert!(bent > 0.01 * LENGTH, "{bent}");
            assert_eq!(
                settled.stability,
                Some(Stability::Neutral),
                "{discs} discs, {share}"
            );
        }
    }
}

/// A robot that cannot move is examined as if it moved slowly, and the answer says so.
#[test]
fn of_a_robot_without_inertia_statics_alone_is_examined() {
    let mut spec = straight(10, 0.05, 0.025);
    spec.modules[0].mass = MassSpec::Density(PerDisc::Uniform(0.0));
    spec.modules[0].backbone = Some(PerDisc::Uniform(Backbone::isotropic(1.0)));
    let robot = Robot::new(spec).unwrap();
    let loads = push(&robot, [0.0, 0.0, -0.5], Frame::Disc);
    let settled = robot.settle(&robot.command(&[]).unwrap(), &loads);
    assert_eq!(settled.stability, Some(Stability::Stable));
    assert_eq!(settled.examined, Some(Examined::Statics));
}
