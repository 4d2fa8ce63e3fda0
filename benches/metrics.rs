//! Time of the metrics on clouds of the size that a robot's prediction is judged by: two samples of
//! one pose, and of two poses; and of the spread of a cloud.
#![allow(
    missing_docs,
    reason = "criterion's macros make undocumented functions"
)]
#![allow(clippy::unwrap_used, reason = "the clouds are valid")]

use std::num::NonZeroUsize;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr::learn::metrics::{
    GroundCost, chamfer, emd, emd_approximate, emd_squared, surface_spread,
};

/// Neighbours that the approximate earth mover's distance takes together.
const GROUP: NonZeroUsize = NonZeroUsize::new(8).unwrap();

type Cloud = Vec<[f32; 3]>;

/// Surface samples (m) of a chain of four cylinders, each 75 mm long, 40 mm wide and turned by `bend`
/// rad against the one before.
fn cylinder_chain(n: usize, bend: f64, seed: u64) -> Cloud {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..n)
        .map(|_| {
            let link = rng.random_range(0..4);
            let base = (0..link).fold([0.0, 0.0], |[x, z], below| {
                let angle = bend * f64::from(below);
                [x + 0.075 * angle.sin(), z + 0.075 * angle.cos()]
            });
            let (sin, cos) = (bend * f64::from(link)).sin_cos();
            let around = std::f64::consts::TAU * rng.random::<f64>();
            let (along, across) = (0.075 * rng.random::<f64>(), 0.02 * around.cos());
            let point = [
                base[0] + along * sin + across * cos,
                0.02 * around.sin(),
                base[1] + along * cos - across * sin,
            ];
            point.map(|x| x as f32)
        })
        .collect()
}

fn metrics(criterion: &mut Criterion) {
    for n in [2_000, 10_000] {
        let p = cylinder_chain(n, 0.1, 1);
        let poses = [
            ("one pose", cylinder_chain(n, 0.1, 2)),
            ("two poses", cylinder_chain(n, 0.3, 2)),
            (
                "far apart",
                cylinder_chain(n, 0.1, 2)
                    .iter()
                    .map(|[x, y, z]| [x + 0.5, y + 0.1, *z])
                    .collect(),
            ),
        ];
        let mut group = criterion.benchmark_group(format!("{n} points"));
        group.sample_size(10);
        group.bench_function("surface_spread", |bencher| {
            bencher.iter(|| surface_spread(&p, &p).unwrap());
        });
        for (pose, q) in &poses {
            group.bench_with_input(BenchmarkId::new("chamfer", pose), q, |bencher, q| {
                bencher.iter(|| chamfer(&p, q).unwrap());
            });
            group.bench_with_input(BenchmarkId::new("emd", pose), q, |bencher, q| {
                bencher.iter(|| emd(&p, q).unwrap());
            });
            group.bench_with_input(
                BenchmarkId::new("emd_approximate", pose),
                q,
                |bencher, q| {
                    bencher.iter(|| emd_approximate(&p, q, GroundCost::Distance, GROUP).unwrap());
                },
            );
            group.bench_with_input(BenchmarkId::new("emd_squared", pose), q, |bencher, q| {
                bencher.iter(|| emd_squared(&p, q).unwrap());
            });
        }
        group.finish();
    }
}

criterion_group!(benches, metrics);
criterion_main!(benches);
