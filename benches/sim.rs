//! Time of one settled configuration from the straight pose, and of one cloud seen by the camera
//! ring, on one thread: `cargo bench --bench sim`.
#![allow(missing_docs, reason = "criterion's macros make public functions")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr::sim::cloud::{Observer, VoxelGrid};
use tdcr::sim::render::BaseVisibility;
use tdcr::sim::robot::{Command, Loads, Robot};
use tdcr::sim::statics::Settler;

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

criterion_group!(benches, settle, observe);
criterion_main!(benches);
