//! Time of one settled configuration from the straight pose, of one step in motion, and of one cloud
//! seen by the camera ring, on one thread: `cargo bench --bench sim`.
#![allow(missing_docs, reason = "criterion's macros make public functions")]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr::sim::cloud::{Observer, VoxelGrid};
use tdcr::sim::contact::{ContactSettler, ContactStepper};
use tdcr::sim::dynamics::{
    Integrator, Lineariser, Rollout, State, StateCotangent, Stepper, rollout_gradient,
};
use tdcr::sim::render::BaseVisibility;
use tdcr::sim::robot::{Command, Loads, Parameter, Robot};
use tdcr::sim::scene::{Obstacle, Scene};
use tdcr::sim::statics::Settler;

/// Steps of the motions whose gradients are timed.
const GRADIENT_STEPS: usize = 100;

/// Random commands, the same in every run.
fn commands(robot: &Robot) -> Vec<Command> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..256).map(|_| robot.random_command(&mut rng)).collect()
}

fn settle(criterion: &mut Criterion) {
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).expect("a standard robot");
        let mut settler = Settler::new(&robot);
        let mut commands = commands(&robot).into_iter().cycle();
        criterion.bench_function(&format!("settle a random command of {name}"), |bencher| {
            bencher.iter(|| {
                let command = commands.next().expect("an endless cycle");
                black_box(settler.settle(&command, &Loads::default()).residual)
            });
        });
    }
}

/// Two posts and a wall beside the robot, which a third of the commands or more lean on.
fn obstacles() -> Scene {
    let post = |name: &str, x: f64, y: f64| {
        let post = Obstacle::cylinder(name, 0.01, 0.6).expect("a valid post");
        post.at([x, y, 0.3])
    };
    let wall = Obstacle::cuboid("wall", [0.02, 1.0, 1.0]).expect("a valid box");
    let all = vec![
        post("left", -0.05, 0.03),
        post("right", 0.03, 0.05),
        wall.at([0.08, 0.0, 0.3]),
    ];
    Scene::new(all).expect("a valid scene")
}

fn touch(criterion: &mut Criterion) {
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).expect("a standard robot");
        let mut settler = ContactSettler::new(&robot, &obstacles());
        let touching = |settler: &mut ContactSettler, command: &Command| {
            let found = settler.settle(command, &Loads::default());
            found.is_ok_and(|found| found.equilibrium.converged && !found.contacts.is_empty())
        };
        let mut commands = commands(&robot);
        commands.retain(|command| touching(&mut settler, command));
        let mut cycle = commands.clone().into_iter().cycle();
        let name = format!("{name} in contact, {} commands", commands.len());
        criterion.bench_function(&format!("settle {name}"), |bencher| {
            bencher.iter(|| {
                let command = cycle.next().expect("an endless cycle");
                let found = settler.settle(&command, &Loads::default());
                black_box(found.map(|found| found.complementarity).ok())
            });
        });
        // To and fro about one of the commands.
        let command = &commands[0];
        let mut step = 0;
        let _ = settler.settle(command, &Loads::default());
        criterion.bench_function(&format!("follow a path of {name}"), |bencher| {
            bencher.iter(|| {
                step += 1;
                let along = 1e-4 * (f64::from(step % 40) - 20.0).abs();
                let values: Vec<f64> = (command.as_slice().iter())
                    .map(|value| (value + along).clamp(0.0, 0.04))
                    .collect();
                let command = robot.command(&values).expect("within the range");
                let found = settler.follow(&command, &Loads::default());
                black_box(found.map(|found| found.complementarity).ok())
            });
        });
        // From one to the next of them, in steps of a twentieth: beads begin and cease to touch.
        let (mut at, mut part) = (0, 0);
        let _ = settler.settle(&commands[0], &Loads::default());
        criterion.bench_function(&format!("follow coarse steps of {name}"), |bencher| {
            bencher.iter(|| {
                (at, part) = match part {
                    20 => ((at + 1) % commands.len(), 1),
                    _ => (at, part + 1),
                };
                let to = &commands[(at + 1) % commands.len()];
                let share = f64::from(part) / 20.0;
                let ways = commands[at].as_slice().iter().zip(to.as_slice());
                let values: Vec<f64> = ways.map(|(from, to)| from + share * (to - from)).collect();
                let command = robot.command(&values).expect("within the range");
                let found = settler.follow(&command, &Loads::default());
                black_box(found.map(|found| found.complementarity).ok())
            });
        });
    }
}

fn observe(criterion: &mut Criterion) {
    let robot = Robot::load("2m").expect("a standard robot");
    let mut settler = Settler::new(&robot);
    let equilibria: Vec<_> = commands(&robot)
        .iter()
        .map(|command| settler.settle(command, &Loads::default()).clone())
        .collect();
    for (base, name) in [
        (BaseVisibility::Hidden, "without base"),
        (BaseVisibility::Shown, "with base"),
    ] {
        let mut observer = Observer::new(&robot, base, VoxelGrid::new(0.002));
        let mut equilibria = equilibria.iter().cycle();
        criterion.bench_function(
            &format!("see 2m {name}, 8 cameras, fused, 2 mm voxels"),
            |bencher| {
                bencher.iter(|| {
                    black_box(observer.observe(equilibria.next().expect("an endless cycle")))
                });
            },
        );
    }
}

/// Steps of 2 ms along a moving command; MuJoCo 4.0 takes 14, 30 and 83 microseconds for them.
fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).expect("a standard robot");
        let sweep: Vec<_> = (0..1000)
            .map(|k| {
                let pull = |t: usize| 0.02 + 0.015 * (0.01 * f64::from(k) + t as f64).sin();
                let values: Vec<_> = (0..robot.tendons().len()).map(pull).collect();
                robot.command(&values).expect("within the range")
            })
            .collect();
        let mut stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler)
            .expect("a robot that can move");
        let mut state = State::straight(&robot);
        let mut commands = sweep.iter().cycle();
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let command = commands.next().expect("an endless cycle");
                stepper.step(&mut state, command, &Loads::default())
            });
        });
        // The same with friction of the tendons in their holes.
        let mut spec = robot.spec().clone();
        (spec.tendon_specs_mut()).for_each(|tendon| tendon.set_friction(0.2));
        let rough = Robot::new(spec).expect("a valid robot");
        let mut rubbing = Stepper::new(&rough, 0.002, Integrator::SemiImplicitEuler)
            .expect("a robot that can move");
        let mut rubbed = State::straight(&rough);
        group.bench_function(format!("{name} with friction of tendons"), |bencher| {
            bencher.iter(|| {
                let command = commands.next().expect("an endless cycle");
                rubbing.step(&mut rubbed, command, &Loads::default())
            });
        });
        let rollout = Rollout {
            start: State::straight(&robot),
            commands: sweep.iter().cycle().take(GRADIENT_STEPS).cloned().collect(),
            loads: Loads::default(),
            wrenches: Vec::new(),
        };
        for (robot, stepper, with) in [
            (&robot, &mut stepper, ""),
            (&rough, &mut rubbing, " with friction of tendons"),
        ] {
            let states = stepper.rollout(&rollout).expect("a motion");
            let number = format!("gradient of {GRADIENT_STEPS} steps, {name}{with}");
            group.bench_function(number, |bencher| {
                bencher.iter(|| {
                    let cost =
                        |_: usize, _: &State, by: &mut StateCotangent| by.coordinates.fill(1.0);
                    let parameters = [Parameter::Gain(0)];
                    let found =
                        rollout_gradient(robot, 0.002, &rollout, &states, &parameters, cost);
                    black_box(found)
                });
            });
        }
        let mut lineariser = Lineariser::new(&robot, 0.002).expect("a robot that can move");
        group.bench_function(format!("linearisation, {name}"), |bencher| {
            bencher.iter(|| black_box(lineariser.linearise(&state, &sweep[0], &Loads::default())));
        });
    }
}

/// Steps of 2 ms from the straight pose, a wall pressed on every disc, and the same with the wall next to the discs.
fn touch_in_motion(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step in contact");
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).expect("a standard robot");
        let slack = Loads::default();
        let wall = |distance: f64| {
            let wall = Obstacle::cuboid("wall", [0.02, 1.0, 2.0]).expect("a valid box");
            Scene::new(vec![wall.at([0.01 + distance, 0.0, 0.3])]).expect("a valid scene")
        };
        // Beads stand out as far as the discs: the wall presses on all of the straight robot.
        for (what, distance) in [("10 contacts or more", 0.0199), ("near, none", 0.03)] {
            let stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler)
                .expect("a robot that can move");
            let mut stepper = ContactStepper::new(stepper, &wall(distance))
                .expect("an integrator of first order");
            let start = State::straight(&robot);
            let mut state = start.clone();
            let command = robot.mean_command();
            let (mut steps, mut contacts) = (0_usize, 0_usize);
            group.bench_function(format!("{name}, {what}"), |bencher| {
                bencher.iter(|| {
                    // One step takes the robot off the wall.
                    state.clone_from(&start);
                    steps += 1;
                    let moved = stepper.step(&mut state, &command, &slack);
                    contacts += stepper.contacts().len();
                    black_box(moved)
                });
            });
            // None where another benchmark was asked for.
            if steps > 0 {
                eprintln!(
                    "{name}: {:.1} contacts in the mean",
                    contacts as f64 / steps as f64
                );
            }
        }
    }
}

/// Steps of 2 ms from the straight pose, five blocks pressed on two discs each: fixed, as objects on a table of their own, and the step
/// with nothing near, the objects at rest or not yet.
fn touch_objects(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step among objects");
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).expect("a standard robot");
        let start = State::straight(&robot);
        let discs = start.positions(&robot);
        let blocks = |mass: Option<f64>, distance: f64, friction: f64| {
            let block = |k: usize| {
                let height = 0.5 * (discs[2 * k].z + discs[2 * k + 1].z);
                let side = 0.03;
                let block = Obstacle::cuboid(&format!("block {k}"), [side, side, side])
                    .expect("a valid box")
                    .at([0.5 * side + distance, 0.0, height]);
                let shelf = Obstacle::cuboid(&format!("shelf {k}"), [side, side, 0.002])
                    .expect("a valid box")
                    .at([0.5 * side + 0.03, 0.0, height - 0.5 * side - 0.001]);
                let block = match mass {
                    Some(mass) => block.with_mass(mass).expect("a valid mass"),
                    None => block,
                };
                [block, shelf].map(|one| one.with_friction(friction).expect("a valid coefficient"))
            };
            Scene::new((0..5).flat_map(block).collect()).expect("a valid scene")
        };
        // What is smooth slides on its shelf for ever, if slowly.
        for (what, mass, distance, friction, before) in [
            ("5 fixed", None, 0.0199, 0.0, 1),
            ("5 objects", Some(0.05), 0.0199, 0.0, 1),
            ("5 objects, not touched", Some(0.05), 0.035, 0.0, 1),
            (
                "5 objects at rest, not touched",
                Some(0.05),
                0.035,
                0.5,
                200,
            ),
            ("5 fixed, not touched", None, 0.035, 0.0, 1),
        ] {
            let stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler)
                .expect("a robot that can move");
            let scene = blocks(mass, distance, friction);
            let mut stepper = ContactStepper::new(stepper, &scene).expect("objects that can move");
            let command = robot.mean_command();
            let slack = Loads::default();
            let mut state = start.clone();
            for _ in 0..before {
                let _ = stepper.step(&mut state, &command, &slack);
            }
            let (mut steps, mut contacts) = (0_usize, 0_usize);
            group.bench_function(format!("{name}, {what}"), |bencher| {
                bencher.iter_batched_ref(
                    || (stepper.clone(), start.clone()),
                    |(stepper, state)| {
                        let moved = stepper.step(state, &command, &slack);
                        steps += 1;
                        contacts += stepper.contacts().len();
                        black_box(moved)
                    },
                    BatchSize::SmallInput,
                );
            });
            // None where another benchmark was asked for.
            if steps > 0 {
                eprintln!(
                    "{name}: {:.1} contacts in the mean",
                    contacts as f64 / steps as f64
                );
            }
        }
    }
}

criterion_group!(
    benches,
    settle,
    touch,
    step,
    touch_in_motion,
    touch_objects,
    observe
);
criterion_main!(benches);
