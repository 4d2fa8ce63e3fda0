//! Derivatives of motions among obstacles, in fluids and of late servos, against differences of motions.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{ContactStepper, Sliding};
use tdcr_sim::dynamics::{DynamicsError, Integrator, Lineariser, Rollout, State, Stepper};
use tdcr_sim::robot::{
    Fluid, Frame, Loads, Parameter, Payload, PerDisc, Robot, RobotSpec, RodDamping, RodSpec,
    ServoSpec, Wrench,
};
use tdcr_sim::scene::{ContactLaw, Obstacle, Scene};

use super::super::derivatives::{nudged, nudged_command, random_rollout};
use super::super::difference;
use super::by_obstacles::{assert_derivatives_by_obstacles, assert_refuses_others};
use super::case::{Case, TIMESTEP, all_parameters, assert_base, assert_near};
use super::tangents::assert_adjoint;
use crate::random_robot::within;

pub const STEPS: usize = 15;
/// Tendons that bend a robot sideways; those above are at rest.
const BENT: [f64; 6] = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];

/// An obstacle that is pressed in far enough for differences to stay on one side.
fn soft(obstacle: Obstacle, friction: f64) -> Obstacle {
    let soft = obstacle.with_compliance(1e-5).unwrap();
    soft.with_friction(friction).unwrap()
}

pub fn post(friction: f64) -> Scene {
    let post = Obstacle::cylinder("post", 0.01, 0.4).unwrap();
    Scene::new(vec![soft(post.at([-0.06, 0.0, 0.25]), friction)]).unwrap()
}

/// A motion of a robot that has come to lean on something in `steps` steps of `timestep` (s) from the straight pose.
pub fn leaning(robot: &Robot, scene: &Scene, (steps, timestep): (usize, f64)) -> Case {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let payload = Payload {
        mass: 1e-3,
        offset: [0.0, 0.0, 0.01],
    };
    let loads = Loads::default().with_payload(payload).unwrap();
    let tendons = robot.tendons().len();
    let bent: Vec<f64> = match tendons {
        // Curled up, all modules pulled to one side.
        15 => (0..15)
            .map(|t| if t % 3 == 0 { 0.036 } else { 0.004 })
            .collect(),
        _ => (0..tendons)
            .map(|t| BENT.get(t).map_or(0.02, |l| *l))
            .collect(),
    };
    let mut start = State::straight(robot);
    let stepper = Stepper::new(robot, timestep, Integrator::ImplicitEuler).unwrap();
    let mut stepper = ContactStepper::new(stepper, scene).unwrap();
    let command = robot.command(&bent).unwrap();
    for _ in 0..steps {
        stepper.step(&mut start, &command, &loads).unwrap();
    }
    let mut near = || {
        let values: Vec<f64> = bent
            .iter()
            .map(|l| l + within(0.0, 3e-4, &mut rng))
            .collect();
        robot.command(&values).unwrap()
    };
    let rollout = Rollout {
        start,
        commands: (0..STEPS).map(|_| near()).collect(),
        loads,
        wrenches: Vec::new(),
    };
    let mut case = Case::of(robot, rollout, &mut rng);
    case.scene = Some(scene.clone());
    case
}

/// The gradient by every `stride`th parameter and number of the start, and by some commands, beside differences whose steps are
/// `share` of the usual ones.
pub fn assert_gradient(case: &Case, (stride, share): (usize, f64), label: &str) {
    let robot = Robot::new(case.spec.clone()).unwrap();
    let parameters = all_parameters(&case.spec).into_iter().step_by(stride);
    let parameters: Vec<Parameter> = parameters.collect();
    let (gradient, by_parameters) = case.gradient_by(&parameters);
    for (&parameter, &found) in parameters.iter().zip(&by_parameters) {
        let size = share * case.step(parameter);
        let expected = case.numeric(size, |by| case.moved(parameter, by));
        assert_near(found, expected, size, &format!("{label}: {parameter}"));
    }
    // Contacts that stick are stiff: a smaller step keeps them sticking.
    assert_base(case, &gradient.base, f64::min(share * 1e-3, 5e-7), label);
    // What joints of fewer than three hinges do not have stands still.
    let moves = |index: usize| {
        let hinges = &robot.discs()[index % robot.dof() / 3].hinges;
        hinges.as_ref().is_none_or(|own| index % 3 < own.count)
    };
    let numbers = gradient.start.iter().enumerate().step_by(3 * stride + 1);
    for (index, &found) in numbers.filter(|(index, _)| moves(*index)) {
        let size = share * 1e-3;
        let expected = case.numeric(size, |by| {
            let mut moved = case.rollout.clone();
            moved.start = nudged(&robot, &moved.start, index, by);
            case.with(moved)
        });
        assert_near(found, expected, size, &format!("{label}: start {index}"));
    }
    let commands = [(0, 0), (3, 2), (7, 5), (STEPS - 1, 1)];
    let has = |(_, tendon): &(usize, usize)| *tendon < robot.tendons().len();
    for (step, tendon) in commands.into_iter().filter(has) {
        let size = share * 1e-3;
        let expected = case.numeric(size, |by| {
            let mut moved = case.rollout.clone();
            let command = &mut moved.commands[step];
            *command = nudged_command(&robot, command, tendon, by);
            case.with(moved)
        });
        let found = gradient.commands[step][tendon];
        assert_near(found, expected, size, &format!("{label}: command {step}"));
    }
}

/// How the contacts after a motion slide.
fn sliding(case: &Case) -> Vec<Sliding> {
    let mut stepper = case.among(case.scene.as_ref().unwrap());
    stepper.rollout(&case.rollout).unwrap();
    assert_eq!(stepper.unsolved(), 0);
    let contacts = stepper.contacts().iter();
    contacts.map(|contact| contact.sliding).collect()
}

#[test]
fn gradients_through_contacts_are_differences_of_motions() {
    let robot = Robot::load("2m").unwrap();
    for (steps, friction, expected) in [
        (50, 0.0, Sliding::Free),
        (50, 0.2, Sliding::Slips),
        (1000, 0.8, Sliding::Sticks),
    ] {
        let case = leaning(&robot, &post(friction), (steps, TIMESTEP));
        assert_eq!(sliding(&case), [expected]);
        assert_gradient(&case, (2, 2e-3), &format!("{expected:?}"));
        assert_derivatives_by_obstacles(&case, &format!("{expected:?}"));
    }
    let robot = Robot::load("3m").unwrap();
    let wall = Obstacle::cuboid("wall", [0.1, 1.0, 1.0]).unwrap();
    let scene = Scene::new(vec![soft(wall.at([-0.08, 0.0, 0.5]), 0.3)]).unwrap();
    let case = leaning(&robot, &scene, (500, TIMESTEP));
    assert_eq!(sliding(&case), [Sliding::Slips; 2]);
    assert_gradient(&case, (5, 2e-3), "wall");
    assert_derivatives_by_obstacles(&case, "wall");
}

#[test]
fn gradients_of_a_robot_that_touches_itself_are_differences_of_motions() {
    let mut spec = RobotSpec::standard("5m").unwrap();
    for module in &mut spec.modules {
        module.damping = PerDisc::Uniform(2e-3);
    }
    let robot = Robot::new(spec).unwrap();
    let case = leaning(&robot, &Scene::new(Vec::new()).unwrap(), (300, 0.02));
    assert!(sliding(&case).len() > 2);
    assert_gradient(&case, (40, 2e-3), "curled");
}

fn in_fluid() -> Robot {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.fluid = Some(Fluid {
        density: 998.0,
        drag_coefficient: 1.1,
    });
    Robot::new(spec).unwrap()
}

#[test]
fn gradients_in_a_fluid_are_differences_of_motions_also_among_obstacles() {
    let robot = in_fluid();
    let mut rng = ChaCha8Rng::seed_from_u64(48);
    let alone = Case::random(&robot, STEPS, &mut rng);
    assert_gradient(&alone, (3, 2e-2), "fluid");
    let case = leaning(&robot, &post(0.2), (80, TIMESTEP));
    assert_eq!(sliding(&case), [Sliding::Slips]);
    assert_gradient(&case, (5, 2e-3), "post in a fluid");
}

#[test]
fn gradients_of_late_and_weak_servos_are_differences_of_motions() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    let servos = [
        (0.02, None, None),
        (0.02, Some(0.1), None),
        (0.0, Some(0.3), Some(2.0)),
    ];
    for (tendon, (lag, rate, largest_force)) in
        spec.tendon_specs_mut().zip(servos.into_iter().cycle())
    {
        tendon.servo = Some(ServoSpec {
            lag,
            rate,
            largest_force,
        });
    }
    let robot = Robot::new(spec).unwrap();
    let case = Case::random(&robot, STEPS, &mut ChaCha8Rng::seed_from_u64(49));
    assert_gradient(&case, (3, 2e-2), "servos");
    let mut rng = ChaCha8Rng::seed_from_u64(50);
    assert_adjoint(&case, &mut rng, "servos");
}

#[test]
fn gradients_by_the_wrenches_of_each_step_are_differences_of_motions() {
    let robot = Robot::load("2m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(52);
    let mut case = Case::random(&robot, STEPS, &mut rng);
    let mut vector = |size: f64| Vector3::from_fn(|_, _| within(-size, size, &mut rng));
    let mut of_step = || (0..10).map(|_| [vector(0.1), vector(0.01)]).collect();
    case.rollout.wrenches = (0..STEPS).map(|_| of_step()).collect();
    assert_adjoint(&case, &mut rng, "wrenches");
    let gradient = case.gradient(&[]);
    for (step, disc, kind, axis) in [(0, 9, 0, 1), (4, 3, 1, 2), (STEPS - 1, 9, 0, 0)] {
        let expected = case.numeric(1e-3, |by| {
            let mut moved = case.rollout.clone();
            moved.wrenches[step][disc][kind][axis] += by;
            case.with(moved)
        });
        let found = gradient.wrenches[step][disc][kind][axis];
        assert!(found != 0.0);
        assert_near(found, expected, 1e-3, "wrench");
    }
    // Alike in all steps they are loads.
    case.rollout.wrenches = vec![vec![[Vector3::new(0.1, 0.0, 0.0), Vector3::zeros()]; 10]; STEPS];
    let steps = case.states().1;
    let pushes = (0..10).map(|disc| Wrench {
        force: [0.1, 0.0, 0.0],
        ..Wrench::none(disc, Frame::World)
    });
    case.rollout.wrenches.clear();
    let loads = case.rollout.loads.clone();
    case.rollout.loads = pushes.fold(loads, |loads, push| loads.with_wrench(push).unwrap());
    assert_eq!(steps, case.states().1);
    case.rollout.wrenches = vec![Vec::new()];
    let mut stepper = Stepper::new(&robot, TIMESTEP, Integrator::SemiImplicitEuler).unwrap();
    let refused = stepper.rollout(&case.rollout).unwrap_err().to_string();
    assert!(
        refused.contains("the list of wrenches has 1 entries"),
        "{refused}"
    );
}

#[test]
fn tangents_and_linearised_steps_have_the_contacts_and_the_fluid_in_them() {
    let robot = in_fluid();
    let scene = post(0.2);
    let case = leaning(&robot, &scene, (80, TIMESTEP));
    let mut rng = ChaCha8Rng::seed_from_u64(50);
    assert_adjoint(&case, &mut rng, "post in a fluid");
    assert_refuses_others(&case);
    let stepper = case.among(&scene);
    let (command, loads) = (&case.rollout.commands[0], &case.rollout.loads);
    let start = &case.rollout.start;
    let among = (stepper.lineariser().unwrap())
        .linearise(start, command, loads)
        .unwrap();
    let alone = (Lineariser::new(&robot, TIMESTEP).unwrap())
        .linearise(start, command, loads)
        .unwrap();
    let free = Stepper::new(&robot, TIMESTEP, Integrator::SemiImplicitEuler).unwrap();
    let none = Scene::new(Vec::new()).unwrap();
    let free = ContactStepper::new(free, &none).unwrap();
    let size = 1e-6;
    for (linear, mut stepper) in [(among, stepper), (alone, free)] {
        let mut step = |mut state: State, command: &_| {
            stepper.step(&mut state, command, loads).unwrap();
            state
        };
        let compare = |found: Vec<f64>, [back, ahead]: [State; 2]| {
            for (found, change) in found.iter().zip(difference(&robot, &back, &ahead)) {
                let expected = change / (2.0 * size);
                assert!(
                    (found - expected).abs() < 1e-6 * expected.abs() + 1e-6,
                    "{found} {expected}"
                );
            }
        };
        for column in 0..2 * robot.dof() {
            let ends = [-size, size].map(|by| step(nudged(&robot, start, column, by), command));
            compare(linear.a.column(column).as_slice().to_vec(), ends);
        }
        for column in 0..6 {
            let ends = [-size, size]
                .map(|by| step(start.clone(), &nudged_command(&robot, command, column, by)));
            compare(linear.b.column(column).as_slice().to_vec(), ends);
        }
    }
}

#[test]
fn what_has_no_derivatives_among_obstacles_is_refused_by_name() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.modules[1].rod = Some(RodSpec {
        youngs: 60e9,
        poisson: 0.3,
        radius: 6e-4,
        density: 7870.0,
        damping: RodDamping::default(),
    });
    let robot = Robot::new(spec).unwrap();
    let rollout = random_rollout(&robot, 1, &mut ChaCha8Rng::seed_from_u64(51));
    let refused = |integrator, law, parameters: &[Parameter]| {
        let stepper = Stepper::new(&robot, TIMESTEP, integrator).unwrap();
        let scene = post(0.0).with_contact_law(law).unwrap();
        let stepper = ContactStepper::new(stepper, &scene).unwrap();
        let states = [rollout.start.clone()];
        let gradient = stepper.rollout_gradient(&rollout, &states, parameters, |_, _, _| ());
        match gradient.map(|gradient| gradient.parameters.len()) {
            Err(DynamicsError::Underivable { what, .. }) => Err(what),
            other => Ok(other.unwrap()),
        }
    };
    let (first, law) = (Integrator::SemiImplicitEuler, ContactLaw::default());
    let pitches = [Parameter::Pitch(0), Parameter::Pitch(1)];
    assert_eq!(refused(first, law, &pitches[..1]), Ok(1));
    for (found, word) in [
        (refused(first, law, &pitches), "pitch"),
        (refused(Integrator::ImplicitEuler, law, &[]), "integrators"),
        (
            refused(first, ContactLaw::Impedance(Default::default()), &[]),
            "MuJoCo",
        ),
    ] {
        assert!(found.unwrap_err().contains(word), "{word}");
    }
}
