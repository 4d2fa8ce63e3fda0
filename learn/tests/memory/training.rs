//! What training allocates: nothing after the first step, and at most what its batch and its weights account for.

use allocation_counter::measure;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_learn::data::CloudSet;
use tdcr_learn::flow::{Coupling, FlowPath};
use tdcr_learn::net::{
    Batch, Channels, ContextShape, HybridShape, MlpShape, Network, NetworkShape, Precision, Stage,
    TimeFeatures, Workspace,
};
use tdcr_learn::train::{Optimizer, TrainSettings, Trainer};

use crate::toy;

/// The paper's weight of the colours' error.
const COLOR_WEIGHT: f32 = 0.05;

const HEAD: MlpShape = MlpShape {
    width: 64,
    depth: 3,
    embedding: 16,
    condition_dim: 2,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

/// Runs `work` where all parallel work stays on its thread, whose allocations are counted.
fn on_one_thread<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.unwrap().install(work)
}

/// Bytes that the first two gradients allocate.
fn two_gradients(shape: NetworkShape, precision: Precision) -> [u64; 2] {
    let network = Network::new(shape, &mut ChaCha8Rng::seed_from_u64(0)).unwrap();
    let network = network.with_precision(precision).unwrap();
    // The second batch fills more voxels than the first.
    let close: Vec<f32> = (0..2 * 1500 * 3)
        .map(|k| (k as f32).sin().powi(9))
        .collect();
    let spread: Vec<f32> = (0..2 * 1500 * 3).map(|k| (k as f32).sin()).collect();
    let batch = |points| Batch {
        times: &[0.3, 0.9],
        conditions: &[0.1, 0.2, 0.3, 0.4],
        points,
        targets: points,
        color_weight: COLOR_WEIGHT,
        huber: None,
    };
    let mut gradient = vec![0.0; network.params().len()];
    let mut workspace = Workspace::default();
    on_one_thread(|| {
        [&close, &spread].map(|points| {
            let step = || {
                network.loss_and_gradient(&batch(points), &mut workspace, &mut gradient);
            };
            measure(step).bytes_total
        })
    })
}

fn hybrid() -> HybridShape {
    let stage = |channels, resolution| Stage {
        channels,
        resolution,
    };
    let context = ContextShape {
        stages: [stage(16, 8), stage(16, 6), stage(24, 4)],
        ..ContextShape::default()
    };
    HybridShape {
        head: HEAD,
        context,
    }
}

#[test]
fn a_gradient_of_either_network_reuses_its_memory() {
    for precision in Precision::ALL {
        for shape in [HEAD.into(), hybrid().into()] {
            let [first, second] = two_gradients(shape, precision);
            assert!(first > 100_000, "{first} bytes at first");
            assert_eq!(second, 0, "{precision:?}, {shape:?}");
        }
    }
}

#[test]
fn training_steps_reuse_the_memory_of_the_first() {
    let set = toy::colored_bars(5, 1);
    let colored = MlpShape {
        channels: Channels::XyzRgb,
        ..HEAD
    };
    let networks: [NetworkShape; 3] = [HEAD.into(), colored.into(), hybrid().into()];
    let ways = [
        (Optimizer::AdamW, Coupling::Independent),
        (Optimizer::MUON, Coupling::Independent),
        (Optimizer::MUON, Coupling::OptimalTransport { batch: 8 }),
    ];
    for (shape, (optimizer, coupling)) in
        (networks.into_iter()).flat_map(|network| ways.map(|way| (network, way)))
    {
        let settings = TrainSettings {
            steps: 40,
            optimizer,
            path: FlowPath {
                coupling,
                ..FlowPath::default()
            },
            ..toy::settings()
        };
        let mut trainer = Trainer::new(shape, settings, &set, &set).unwrap();
        // Enough steps for the losses to have a level, and for lists without room to grow.
        let allocated = on_one_thread(|| {
            [1, 39].map(|steps| {
                let steps = || {
                    (0..steps).for_each(|_| {
                        trainer.step().unwrap();
                    });
                };
                measure(steps).bytes_total
            })
        });
        let [first, others] = allocated;
        assert!(first > 100_000, "{first} bytes at first");
        assert_eq!(others, 0, "{optimizer:?}, {coupling:?}, {shape:?}");
    }
}

/// The authors' MLP: each layer's output for the whole batch, and weights, gradient and two moments.
#[test]
fn training_takes_at_most_half_more_than_activations_and_four_times_the_weights() {
    let shape = MlpShape {
        width: 512,
        depth: 6,
        embedding: 256,
        ..HEAD
    };
    let set = large_clouds();
    let activations = 2 * 2048 * (shape.width * shape.depth + 3);
    let bytes = (size_of::<f32>() * (activations + 4 * shape.parameter_count())) as u64;
    for precision in Precision::ALL {
        let settings = TrainSettings {
            clouds: 2,
            points: 2048,
            precision,
            ..toy::settings()
        };
        let run = || {
            let mut trainer = Trainer::new(shape, settings, &set, &set).unwrap();
            (0..2).for_each(|_| {
                trainer.step().unwrap();
            });
        };
        let peak = on_one_thread(|| measure(run)).bytes_max;
        assert!(
            2 * peak <= 3 * bytes,
            "{precision:?}: {peak} bytes for {bytes}"
        );
        assert!(
            4 * peak > bytes,
            "{precision:?}: {peak} bytes: is all of it counted?"
        );
    }
}

/// Clouds of 2,048 points.
fn large_clouds() -> CloudSet {
    let points = (0..3 * 2048 * 3).map(|k| (k as f32).sin());
    CloudSet {
        condition_dim: 2,
        points_per_cloud: 2048,
        conditions: vec![0.5; 3 * 2],
        points: points.collect(),
        colors: None,
        starts: None,
    }
}
