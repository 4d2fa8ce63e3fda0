//! What runs in inner loops allocates nothing after its first call.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::robot::{Command, Frame, Loads, Robot, RobotSpec, Wrench};
use tdcr_sim::simulation::{MovingRobot, Simulation};
use tdcr_sim::statics::Settler;

#[test]
fn settling_allocates_nothing_after_the_first_call() {
    let push = Wrench {
        force: [0.01, 0.02, -0.03],
        ..Wrench::none(3, Frame::World)
    };
    let loads = Loads::payload(0.01).unwrap().with_wrench(push).unwrap();
    for name in RobotSpec::STANDARD {
        let robot = Robot::load(name).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let commands: Vec<_> = (0..500).map(|_| robot.random_command(&mut rng)).collect();
        let mut settler = Settler::new(&robot);
        let start = settler.settle(&commands[0], &loads).configuration.clone();
        let counted = allocation_counter::measure(|| {
            for command in &commands {
                assert!(settler.settle(command, &loads).converged);
            }
            for command in &commands {
                assert!(settler.follow(command, &loads).converged);
            }
            assert!(settler.settle_from(&start, &commands[1], &loads).converged);
        });
        assert_eq!(counted.count_total, 0, "{name}");
    }
}

#[test]
fn stepping_allocates_nothing_after_the_first_step() {
    let push = Wrench {
        force: [0.01, 0.02, -0.03],
        ..Wrench::none(3, Frame::Disc)
    };
    let loads = Loads::payload(0.01).unwrap().with_wrench(push).unwrap();
    for name in RobotSpec::STANDARD {
        let robot = Robot::load(name).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let commands: Vec<_> = (0..500).map(|_| robot.random_command(&mut rng)).collect();
        for integrator in [
            Integrator::SemiImplicitEuler,
            Integrator::RungeKutta4,
            Integrator::ImplicitMidpoint,
        ] {
            let mut stepper = Stepper::new(&robot, 0.002, integrator).unwrap();
            let mut state = State::straight(&robot);
            stepper.step(&mut state, &commands[0], &loads).unwrap();
            let counted = allocation_counter::measure(|| {
                for command in &commands {
                    stepper.step(&mut state, command, &loads).unwrap();
                }
            });
            assert_eq!(counted.count_total, 0, "{name}, {integrator:?}");
        }
    }
}

/// The pose is a view, and settling and stepping reuse their memory.
#[test]
fn after_the_first_advance_nothing_is_allocated() {
    let robot = Robot::load("2m").unwrap();
    // From the mean on, both modules bend more and more.
    let pulls = [-0.012, 0.004, 0.006, 0.01, -0.008, 0.0];
    let mean = robot.mean_command();
    let bent = |part: f64| -> Vec<f64> {
        let values = mean.as_slice().iter().zip(pulls);
        values.map(|(mean, pull)| mean + part * pull).collect()
    };
    let commands: Vec<Command> = (0..20)
        .map(|step| robot.command(&bent(f64::from(step) / 20.0)).unwrap())
        .collect();
    let loads = Loads::default();
    let settler: Box<dyn Simulation> = Box::new(Settler::new(&robot));
    let moving = MovingRobot::new(&robot, 0.002, Integrator::default(), 5).unwrap();
    for mut simulation in [settler, Box::new(moving)] {
        simulation.reset(&commands[0], &loads).unwrap();
        simulation.advance(&commands[1], &loads).unwrap();
        let mut height = 0.0;
        let counts = allocation_counter::measure(|| {
            for command in &commands {
                simulation.advance(command, &loads).unwrap();
                height += simulation.pose().tip().translation.z;
            }
        });
        assert_eq!(counts.count_total, 0);
        assert!(height > 0.0);
    }
}
