//! Whoever drives a simulated robot need not know by which physics it moves.

use tdcr_sim::cloud::{Observer, VoxelGrid};
use tdcr_sim::dynamics::{DynamicsError, Integrator, State, Stepper};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Command, Friction, Loads, Robot, RobotSpec};
use tdcr_sim::simulation::{MovingRobot, Simulation, SimulationError};
use tdcr_sim::statics::Settler;
use tdcr_sim::tendon_friction::FrictionPath;

const TIMESTEP: f64 = 0.002;

fn simulations(robot: &Robot) -> Vec<Box<dyn Simulation>> {
    vec![
        Box::new(Settler::new(robot)),
        Box::new(FrictionPath::new(robot)),
        Box::new(MovingRobot::new(robot, TIMESTEP, Integrator::default(), 50).unwrap()),
    ]
}

/// A command that bends both modules, part of the way from the mean.
fn bent(robot: &Robot, part: f64) -> Command {
    let pulls = [-0.012, 0.004, 0.006, 0.01, -0.008, 0.0];
    let mean = robot.mean_command();
    let values = mean.as_slice().iter().zip(pulls);
    let values: Vec<f64> = values.map(|(mean, pull)| mean + part * pull).collect();
    robot.command(&values).unwrap()
}

/// The same program drives all three; without friction, and given time to come to rest, they end in the same pose.
#[test]
fn every_simulation_ends_in_the_equilibrium_of_its_command() {
    let robot = Robot::load("2m").unwrap();
    let loads = Loads::payload(0.01).unwrap();
    for (kind, mut simulation) in simulations(&robot).into_iter().enumerate() {
        simulation.reset(&bent(&robot, 0.0), &loads).unwrap();
        for step in 1..=10 {
            simulation
                .advance(&bent(&robot, f64::from(step) / 10.0), &loads)
                .unwrap();
        }
        // Bends that keep the tendon lengths have little stiffness: at rest takes minutes of motion.
        for _ in 0..3000 {
            simulation.advance(&bent(&robot, 1.0), &loads).unwrap();
        }
        let pose = simulation.pose();
        let settled = robot.settle(&bent(&robot, 1.0), &loads);
        for disc in 0..10 {
            let apart = (pose.positions[disc] - settled.positions[disc]).norm();
            assert!(apart < 1e-4, "{kind}: disc {disc} is {apart} m off");
            assert!(pose.orientations[disc].angle_to(&settled.orientations[disc]) < 1e-2);
        }
        for tendon in 0..6 {
            let apart = pose.tendon_lengths[tendon] - settled.tendon_lengths[tendon];
            assert!(apart.abs() < 1e-5, "{kind}: tendon {tendon}");
            let apart = pose.tendon_tensions[tendon] - settled.tendon_tensions[tendon];
            assert!(apart.abs() < 1e-2, "{kind}: {apart} N");
        }
    }
}

#[test]
fn a_reset_forgets_what_was_before() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for tendon in spec
        .modules
        .iter_mut()
        .filter_map(|module| module.tendons.as_mut())
    {
        tendon.friction = Some(Friction {
            coefficient: 0.2,
            contact_stiffness: 1e5,
        });
    }
    let robot = Robot::new(spec).unwrap();
    for mut simulation in simulations(&robot) {
        let ends = [bent(&robot, 0.0), bent(&robot, 1.0)];
        simulation.reset(&ends[0], &Loads::default()).unwrap();
        let fresh = simulation.pose().positions.to_vec();
        simulation.advance(&ends[1], &Loads::default()).unwrap();
        assert_ne!(simulation.pose().positions, fresh);
        simulation.reset(&ends[0], &Loads::default()).unwrap();
        assert_eq!(simulation.pose().positions, fresh);
    }
}

#[test]
fn a_first_advance_is_a_reset() {
    let robot = Robot::load("2m").unwrap();
    for (mut fresh, mut reset) in simulations(&robot).into_iter().zip(simulations(&robot)) {
        fresh
            .advance(&bent(&robot, 1.0), &Loads::default())
            .unwrap();
        reset.reset(&bent(&robot, 1.0), &Loads::default()).unwrap();
        assert_eq!(fresh.pose(), reset.pose());
    }
}

#[test]
fn commands_of_another_robot_are_refused() {
    let [robot, other] = ["2m", "3m"].map(|name| Robot::load(name).unwrap());
    for mut simulation in simulations(&robot) {
        let refused = simulation.reset(&other.mean_command(), &Loads::default());
        assert!(matches!(refused, Err(SimulationError::Command(_))));
        simulation
            .reset(&robot.mean_command(), &Loads::default())
            .unwrap();
        let refused = simulation.advance(&other.mean_command(), &Loads::default());
        assert!(matches!(refused, Err(SimulationError::Command(_))));
    }
}

#[test]
fn cameras_see_a_robot_in_motion() {
    let robot = Robot::load("2m").unwrap();
    let mut moving = MovingRobot::new(&robot, TIMESTEP, Integrator::default(), 5).unwrap();
    moving.reset(&bent(&robot, 0.0), &Loads::default()).unwrap();
    let mut observer = Observer::new(&robot, BaseVisibility::Hidden, VoxelGrid::new(0.002));
    let still = observer.observe(moving.pose());
    assert_eq!(
        still,
        observer.observe(&robot.settle(&bent(&robot, 0.0), &Loads::default()))
    );
    moving
        .advance(&bent(&robot, 1.0), &Loads::default())
        .unwrap();
    assert_ne!(still, observer.observe(moving.pose()));
    assert_eq!(moving.time(), 5.0 * TIMESTEP);
}

/// One that goes on from the state of another moves as that does, whatever it did before.
#[test]
fn a_moving_robot_starts_in_any_state() {
    let robot = Robot::load("2m").unwrap();
    let loads = Loads::payload(0.01).unwrap();
    let [mut first, mut second] = [5, 2]
        .map(|steps| MovingRobot::new(&robot, TIMESTEP, Integrator::default(), steps).unwrap());
    first.reset(&bent(&robot, 0.0), &loads).unwrap();
    second.reset(&bent(&robot, 0.7), &loads).unwrap();
    second.advance(&bent(&robot, 0.2), &loads).unwrap();
    first.advance(&bent(&robot, 1.0), &loads).unwrap();
    let state = first.state().clone();
    second.start_at(&state, &bent(&robot, 1.0)).unwrap();
    assert_eq!(second.pose(), first.pose());
    assert_eq!(second.time(), 0.0);
    first.advance(&bent(&robot, 0.5), &loads).unwrap();
    second.advance_by(&bent(&robot, 0.5), &loads, 5).unwrap();
    assert_eq!(second.pose(), first.pose());
    assert_eq!(second.time(), 5.0 * TIMESTEP);
    let other = State::straight(&Robot::load("3m").unwrap());
    let refused = second.start_at(&other, &bent(&robot, 0.0));
    let message = refused.unwrap_err().to_string();
    assert_eq!(
        message,
        "the configuration has 15 entries; robot `2m` needs 10"
    );
}

/// A time step by which small motions grow is refused where the motion starts, whichever way, and not where it goes on.
#[test]
fn time_steps_that_are_too_long_are_refused_at_the_start() {
    let robot = Robot::load("2m").unwrap();
    let (mean, loads) = (robot.mean_command(), Loads::default());
    let unstable = |refused: Result<(), SimulationError>| {
        matches!(
            refused,
            Err(SimulationError::Dynamics(DynamicsError::Unstable { .. }))
        )
    };
    let start = State::straight(&robot);
    let mut moving = MovingRobot::new(&robot, 0.5, Integrator::default(), 1).unwrap();
    assert!(unstable(moving.reset(&mean, &loads)));
    assert!(unstable(moving.advance(&mean, &loads)));
    moving.start_at(&start, &mean).unwrap();
    assert!(unstable(moving.advance(&mean, &loads)));
    assert_eq!(moving.state(), &start);
    // The same as of a stepper, and none of an implicit one.
    let stepper = Stepper::new(&robot, 0.5, Integrator::default()).unwrap();
    assert!(stepper.check_stable(&start, &mean, &loads).is_err());
    let mut implicit = MovingRobot::new(&robot, 0.5, Integrator::ImplicitEuler, 1).unwrap();
    implicit.reset(&mean, &loads).unwrap();
    // What goes on was checked where it started.
    moving.resume_at(&start, &mean, Some(1)).unwrap();
    assert!(!unstable(moving.advance(&mean, &loads)));
}

/// One that resumes where another was left does what that does, to the last bit.
#[test]
fn simulations_resume_where_others_were_left() {
    let robot = Robot::load("2m").unwrap();
    let loads = Loads::payload(0.01).unwrap();
    let mut first = Settler::new(&robot);
    let mut moving = MovingRobot::new(&robot, TIMESTEP, Integrator::default(), 5).unwrap();
    first.reset(&bent(&robot, 0.0), &loads).unwrap();
    moving.reset(&bent(&robot, 0.0), &loads).unwrap();
    for step in 1..20 {
        first
            .advance(&bent(&robot, f64::from(step) / 40.0), &loads)
            .unwrap();
        moving
            .advance(&bent(&robot, f64::from(step) / 40.0), &loads)
            .unwrap();
    }
    let mut second = Settler::new(&robot);
    second.resume(first.memory(), &loads);
    assert_eq!(second.memory(), first.memory());
    let mut other = MovingRobot::new(&robot, TIMESTEP, Integrator::default(), 5).unwrap();
    let (state, command) = (moving.state().clone(), bent(&robot, 19.0 / 40.0));
    other.resume_at(&state, &command, moving.taken()).unwrap();
    for step in 20..40 {
        let command = bent(&robot, f64::from(step) / 40.0);
        first.advance(&command, &loads).unwrap();
        second.advance(&command, &loads).unwrap();
        // With the number of Newton steps: the prediction is the same too.
        assert_eq!(second.equilibrium(), first.equilibrium());
        moving.advance(&command, &loads).unwrap();
        other.advance(&command, &loads).unwrap();
        assert_eq!(other.pose(), moving.pose());
        assert_eq!(other.time(), moving.time());
    }
    // Nothing was before.
    second.resume(Settler::new(&robot).memory(), &loads);
    assert_eq!(second.memory(), Settler::new(&robot).memory());
}
