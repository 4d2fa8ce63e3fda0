//! Drag of a fluid around the discs.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{DynamicsError, Integrator, State, Stepper};
use tdcr_sim::robot::{Backbone, Fluid, Frame, Loads, PerDisc, Robot, RobotSpec, Routing, Wrench};
use tdcr_sim::scene::{Obstacle, Scene};

const WATER: Fluid = Fluid {
    density: 998.0,
    drag_coefficient: 1.1,
};

/// 2m in water, without gravity and tendons, and without damping but for the fluid's.
fn swimming(change: impl Fn(&mut RobotSpec)) -> Robot {
    let mut spec = RobotSpec::standard("2m").unwrap();
    (spec.gravity, spec.fluid) = ([0.0; 3], Some(WATER));
    for module in &mut spec.modules {
        module.tendons = None;
        module.damping = PerDisc::Uniform(0.0);
    }
    change(&mut spec);
    Robot::new(spec).unwrap()
}

/// One disc on an arm, of a moment of inertia that is that of its armature nearly.
fn paddle() -> Robot {
    swimming(|spec| {
        spec.routing = Routing::Base;
        spec.modules.truncate(1);
        let module = &mut spec.modules[0];
        (module.discs, module.pitch, module.first_offset) = (1, 0.2, 0.2);
        module.joint_below = ARM;
        module.mass = tdcr_sim::robot::MassSpec::Density(PerDisc::Uniform(0.0));
        module.armature = PerDisc::Uniform(INERTIA);
    })
}

const ARM: f64 = 0.15;
const INERTIA: f64 = 2e-4;

/// Moment of the drag by the square of the rate (N m s²).
fn resistance(robot: &Robot) -> f64 {
    let disc = &robot.discs()[0];
    let area = 2.0 * disc.radius * 2.0 * disc.half_height;
    0.5 * WATER.density * WATER.drag_coefficient * area * ARM.powi(3)
}

#[test]
fn drag_slows_a_disc_on_an_arm_as_the_closed_form_says() {
    let robot = paddle();
    let (start, duration, h) = (3.0, 1.0, 1e-4);
    for integrator in [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler] {
        let mut stepper = Stepper::new(&robot, h, integrator).unwrap();
        let mut state = State::straight(&robot);
        state.velocity[0] = start;
        for _ in 0..(duration / h) as usize {
            let command = robot.mean_command();
            stepper
                .step(&mut state, &command, &Loads::default())
                .unwrap();
        }
        // I dw/dt = -k w².
        let expected = start / (1.0 + resistance(&robot) / INERTIA * start * duration);
        let error = state.velocity[0] / expected - 1.0;
        eprintln!(
            "{integrator:?}: {} rad/s, off by {error:.1e}",
            state.velocity[0]
        );
        assert!(expected < 0.5 * start && error.abs() < 1e-3, "{error}");
    }
}

#[test]
fn a_constant_moment_leads_to_the_terminal_rate() {
    let robot = paddle();
    let moment = 0.01;
    let push = Wrench {
        moment: [moment, 0.0, 0.0],
        ..Wrench::none(0, Frame::Disc)
    };
    let loads = Loads::default().with_wrench(push).unwrap();
    // Steps several times as long as the drag takes, too.
    for h in [1e-3, 0.1] {
        let mut stepper = Stepper::new(&robot, h, Integrator::SemiImplicitEuler).unwrap();
        let mut state = State::straight(&robot);
        for _ in 0..2_000 {
            let command = robot.mean_command();
            stepper.step(&mut state, &command, &loads).unwrap();
        }
        let terminal = (moment / resistance(&robot)).sqrt();
        let error = state.velocity[0] / terminal - 1.0;
        eprintln!("{h} s: {error:.1e} of {terminal} rad/s");
        assert!(error.abs() < 1e-9, "{h}: {error}");
    }
}

#[test]
fn energy_does_not_rise_in_a_fluid() {
    let robot = swimming(|spec| {
        for module in &mut spec.modules {
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
        }
    });
    let mut rng = ChaCha8Rng::seed_from_u64(36);
    let mut stepper = Stepper::new(&robot, 0.002, Integrator::ImplicitEuler).unwrap();
    let command = robot.mean_command();
    let mut energies = Vec::new();
    let mut state = super::random_state(&robot, &mut rng);
    for _ in 0..500 {
        let energy = stepper.energy(&state, &command, &Loads::default()).unwrap();
        energies.push(energy.total());
        stepper
            .step(&mut state, &command, &Loads::default())
            .unwrap();
    }
    let rises = energies.windows(2).filter(|pair| pair[1] > pair[0]);
    assert_eq!(rises.count(), 0, "{energies:?}");
    eprintln!("{} J to {} J", energies[0], energies[499]);
    assert!(energies[499] < 0.9 * energies[0]);
}

#[test]
fn a_robot_far_from_obstacles_moves_as_without_a_scene_and_the_rest_is_refused() {
    let robot = swimming(|_| ());
    let far = Obstacle::sphere("far", 0.1).unwrap().at([10.0, 0.0, 0.0]);
    let scene = Scene::new(vec![far]).unwrap();
    let stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler).unwrap();
    let mut among = ContactStepper::new(stepper.clone(), &scene).unwrap();
    let (mut alone, command) = (stepper, robot.mean_command());
    let mut states = [State::straight(&robot), State::straight(&robot)];
    let push = Wrench {
        force: Vector3::new(0.2, 0.1, 0.0).into(),
        ..Wrench::none(9, Frame::World)
    };
    let loads = Loads::default().with_wrench(push).unwrap();
    for _ in 0..50 {
        alone.step(&mut states[0], &command, &loads).unwrap();
        among.step(&mut states[1], &command, &loads).unwrap();
    }
    assert_eq!(states[0], states[1]);
    let refused = Stepper::new(&robot, 0.002, Integrator::ImplicitMidpoint).unwrap_err();
    assert_eq!(refused, DynamicsError::InFluid);
}
