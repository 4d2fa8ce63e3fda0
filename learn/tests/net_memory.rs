//! What the gradient of a batch allocates: nothing after the first.
#![allow(clippy::unwrap_used, reason = "a test may stop where it fails")]

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_learn::net::{
    Batch, COLOR_WEIGHT, Channels, ContextShape, HybridShape, MlpShape, Network, NetworkShape,
    Stage, Workspace,
};

const HEAD: MlpShape = MlpShape {
    width: 64,
    depth: 3,
    embedding: 16,
    condition_dim: 2,
    channels: Channels::Xyz,
};

/// Bytes that the first two steps allocate, on one thread.
fn two_steps(shape: NetworkShape) -> [u64; 2] {
    let network = Network::new(shape, &mut ChaCha8Rng::seed_from_u64(0)).unwrap();
    let points: Vec<f32> = (0..2 * 1500 * 3).map(|k| (k as f32).sin()).collect();
    let batch = Batch {
        times: &[0.3, 0.9],
        conditions: &[0.1, 0.2, 0.3, 0.4],
        points: &points,
        targets: &points,
        color_weight: COLOR_WEIGHT,
    };
    let mut gradient = vec![0.0; network.params().len()];
    let mut workspace = Workspace::default();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    pool.install(|| {
        [1, 2].map(|_| {
            let step = || {
                network.loss_and_gradient(&batch, &mut workspace, &mut gradient);
            };
            allocation_counter::measure(step).bytes_total
        })
    })
}

#[test]
fn a_step_of_either_network_reuses_its_memory() {
    let stage = |channels, resolution| Stage {
        channels,
        resolution,
    };
    let context = ContextShape {
        stages: [stage(16, 8), stage(16, 6), stage(24, 4)],
        ..ContextShape::default()
    };
    let hybrid = HybridShape {
        head: HEAD,
        context,
    };
    for shape in [HEAD.into(), hybrid.into()] {
        let [first, second] = two_steps(shape);
        assert!(first > 100_000, "{first} bytes at first");
        assert_eq!(second, 0, "{shape:?}");
    }
}
