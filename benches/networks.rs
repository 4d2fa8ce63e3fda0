//! The times and the memory of a network's training that `benches/networks.py` sets beside PyTorch's: prints one line of
//! JSON, for the network and the precision named by the arguments (`mlp` or `hybrid`, `float32` or `bfloat16`; where
//! bfloat16 is not the faster one, float32 runs in any case); one per process, as peak memory is the process's.
//!
//! At the authors' sizes: a whole step of the `Trainer` (draw of the batch, forward, backward, clipping, AdamW, running
//! average of the weights), and of the MLP the evaluations that sampling a cloud consists of. Beside them, in the same
//! run, the floor: what the same products take when nothing but faer's products runs, on all threads.
#![allow(clippy::print_stdout, reason = "the result goes to stdout")]

use std::fs;
use std::hint::black_box;
use std::time::Instant;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use tdcr::base::stats;
use tdcr::learn::data::CloudSet;
use tdcr::learn::flow::{Method, Sampler};
use tdcr::learn::net::{
    Channels, ContextShape, HybridShape, MlpShape, Network, NetworkShape, Precision, Processor,
    TimeFeatures,
};
use tdcr::learn::train::{Optimizer, TrainSettings, Trainer};

/// The authors' MLP, and the head of their Hybrid.
const MLP: MlpShape = MlpShape {
    width: 512,
    depth: 6,
    embedding: 256,
    condition_dim: 6,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

/// Points per cloud and step.
const POINTS: usize = 2048;

/// Points of a cloud in the set, and of a sampled one.
const CLOUD: usize = 20_000;

/// The first steps of a sampling: its 100 steps are alike, so fewer are timed.
const SAMPLER: Sampler = Sampler {
    method: Method::Heun,
    steps: 5,
    ..Sampler::PAPER
};

/// Rows of a product over points, as many as features of some layers stay in a core's cache for.
const ROWS: usize = 128;

/// What was measured of one network.
#[derive(Serialize)]
struct Measured {
    threads: usize,
    /// Numbers (f32) in a vector of the kernels.
    vector_lanes: usize,
    /// The numbers of the products.
    precision: Precision,
    shape: NetworkShape,
    /// Clouds and points of a step.
    clouds: usize,
    points: usize,
    step: Work,
    sampling: Option<Sampling>,
    memory: Memory,
}

/// A piece of work.
#[derive(Serialize)]
struct Work {
    /// Median time (s).
    seconds: f64,
    /// Floating-point operations of its products per second, in 1e9.
    products: f64,
    /// The same of the products alone.
    plain_products: f64,
}

/// [`SAMPLER`]'s steps for one cloud.
#[derive(Serialize)]
struct Sampling {
    points: usize,
    steps: usize,
    work: Work,
}

/// Memory of a training run, in bytes.
#[derive(Serialize)]
struct Memory {
    /// Growth of the process's resident memory from before the trainer to its peak; none where the system has no `/proc`.
    peak: Option<usize>,
    /// What each layer puts out for all points and voxels of the batch ([`activations`]).
    activations: usize,
    /// Four times the weights: those, the gradient and AdamW's moments.
    weights: usize,
}

fn main() {
    let hybrid = HybridShape {
        head: MLP,
        context: ContextShape::default(),
    };
    let argument = |index| std::env::args().nth(index);
    let precision = match argument(2).as_deref() {
        Some("bfloat16") => Precision::fastest(MLP.width),
        _ => Precision::Float32,
    };
    let measured = match argument(1).as_deref() {
        Some("hybrid") => measure(hybrid.into(), precision, [2, 5], None),
        _ => measure(MLP.into(), precision, [8, 7], Some(SAMPLER)),
    };
    println!(
        "{}",
        serde_json::to_string(&measured).expect("plain numbers")
    );
}

/// Takes `steps` timed steps of `clouds` clouds, and samples three clouds.
fn measure(
    shape: NetworkShape,
    precision: Precision,
    [clouds, steps]: [usize; 2],
    sampler: Option<Sampler>,
) -> Measured {
    let set = noise();
    let settings = TrainSettings {
        clouds,
        points: POINTS,
        optimizer: Optimizer::AdamW,
        precision,
        learning_rate: 3e-4,
        validation_clouds: 1,
        ..TrainSettings::default()
    };
    let before = resident("VmRSS");
    let mut trainer = Trainer::new(shape, settings, &set, &set).expect("a set for the network");
    let mut step = || {
        trainer.step().expect("a step");
    };
    step();
    let seconds = median(steps, step);
    let peak = resident("VmHWM")
        .zip(before)
        .map(|(peak, before)| peak - before);
    drop(trainer);

    let network = Network::new(shape, &mut ChaCha8Rng::seed_from_u64(0)).expect("a valid shape");
    let network = network
        .with_precision(precision)
        .expect("a width that suits it");
    let products = products(&shape, clouds, POINTS);
    let step_flops = 3 * clouds as u64 * network.flops(POINTS);
    Measured {
        threads: rayon::current_num_threads(),
        vector_lanes: Processor::detect().vector_lanes,
        precision,
        shape,
        clouds,
        points: POINTS,
        step: Work {
            seconds,
            products: step_flops as f64 / seconds / 1e9,
            plain_products: plain(&products, &Pass::TRAINING),
        },
        sampling: sampler.map(|sampler| sample(&network, sampler, set.condition(0))),
        memory: Memory {
            peak,
            activations: size_of::<f32>() * clouds * activations(&shape, POINTS),
            weights: 4 * size_of_val(network.params()),
        },
    }
}

fn sample(network: &Network, sampler: Sampler, condition: &[f32]) -> Sampling {
    let mut points = noise().cloud(0).to_vec();
    let seconds = median(3, || {
        sampler.integrate(network, condition, &mut points);
    });
    let flops = sampler.evaluations() as u64 * network.flops(CLOUD);
    let products = products(&network.shape(), 1, CLOUD);
    Sampling {
        points: CLOUD,
        steps: sampler.steps,
        work: Work {
            seconds,
            products: flops as f64 / seconds / 1e9,
            plain_products: plain(&products, &Pass::INFERENCE),
        },
    }
}

/// Clouds of noise: the work does not depend on what the points are.
fn noise() -> CloudSet {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let clouds = 32;
    let mut numbers = |len: usize| (0..len).map(|_| rng.random_range(-0.5..0.5)).collect();
    CloudSet {
        condition_dim: MLP.condition_dim,
        points_per_cloud: CLOUD,
        conditions: numbers(clouds * MLP.condition_dim),
        points: numbers(clouds * CLOUD * 3),
        colors: None,
        starts: None,
    }
}

/// Median time (s) of `work` in so many runs.
fn median(runs: usize, mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let began = Instant::now();
        work();
        began.elapsed().as_secs_f64()
    };
    let mut times: Vec<f64> = (0..runs).map(time).collect();
    stats::median(&mut times)
}

/// A line of Linux's account of this process's memory, in bytes.
fn resident(line: &str) -> Option<usize> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|found| found.strip_prefix(line))?;
    let kib: usize = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

/// Numbers that the layers of a network put out for a cloud: each dense layer and convolution once, no norm, activation
/// or gradient. An implementation that works layer by layer keeps them all for its backward pass, and more.
fn activations(shape: &NetworkShape, points: usize) -> usize {
    let (head, context) = parts(shape);
    let per_point = head.width * head.depth + head.channels.count();
    let context = context.map_or(0, |context| {
        let stages = context.stages.into_iter().map(|stage| {
            let (layers, voxels) = (2 * context.blocks, stage.resolution.pow(3));
            stage.channels * (points * (1 + layers) + voxels * layers)
        });
        stages.sum::<usize>() + points * (context.joined + context.features)
    });
    points * per_point + context
}

/// The layers on points, and the context if there is one.
fn parts(shape: &NetworkShape) -> (MlpShape, Option<ContextShape>) {
    match shape {
        NetworkShape::Mlp(head) => (*head, None),
        NetworkShape::Hybrid(hybrid) => (hybrid.head, Some(hybrid.context)),
        other => panic!("no products are listed for {other:?}"),
    }
}

/// `Y += X W^T` with `X` `(rows, inputs)`, so many times.
struct Product {
    rows: usize,
    inputs: usize,
    outputs: usize,
    times: f64,
}

/// The products of a forward pass, but for those too thin to matter: the hidden layers' on points, the convolutions' on
/// planes of voxels.
fn products(shape: &NetworkShape, clouds: usize, points: usize) -> Vec<Product> {
    let (head, context) = parts(shape);
    let layers = Product {
        rows: ROWS,
        inputs: head.width,
        outputs: head.width,
        times: (clouds * (head.depth - 1) * points) as f64 / ROWS as f64,
    };
    let convolutions = context.iter().flat_map(|context| {
        context.stages.iter().map(|stage| Product {
            rows: stage.resolution.pow(2),
            inputs: stage.channels,
            outputs: stage.channels,
            times: (clouds * 2 * context.blocks * 27 * stage.resolution) as f64,
        })
    });
    std::iter::once(layers).chain(convolutions).collect()
}

/// What a layer multiplies.
#[derive(Clone, Copy)]
enum Pass {
    Forward,
    InputGradient,
    WeightGradient,
}

impl Pass {
    const TRAINING: [Self; 3] = [Self::Forward, Self::InputGradient, Self::WeightGradient];
    const INFERENCE: [Self; 1] = [Self::Forward];
}

/// Mean rate (1e9 floating-point operations per second) of `products` in all of `passes`, on all threads.
fn plain(products: &[Product], passes: &[Pass]) -> f64 {
    let (mut operations, mut seconds) = (0.0, 0.0);
    for product in products {
        for pass in passes {
            let flops = 2.0 * (product.rows * product.inputs * product.outputs) as f64;
            operations += product.times * flops;
            seconds += product.times * flops / rate(product, *pass);
        }
    }
    operations / seconds / 1e9
}

/// Floating-point operations per second of one product, each thread on matrices of its own.
fn rate(product: &Product, pass: Pass) -> f64 {
    let Product {
        rows,
        inputs,
        outputs,
        ..
    } = *product;
    let flops = 2 * rows * inputs * outputs;
    let repeats = 5_000_000_000usize.div_ceil(flops);
    let work = || {
        rayon::broadcast(|_| {
            let numbers = |len: usize| vec![1e-3f32; len];
            let (mut x, mut y, mut w) = (
                numbers(rows * inputs),
                numbers(rows * outputs),
                numbers(inputs * outputs),
            );
            for _ in 0..repeats {
                multiply(pass, [rows, inputs, outputs], [&mut x, &mut y, &mut w]);
            }
            black_box((x, y, w));
        });
    };
    (rayon::current_num_threads() * repeats * flops) as f64 / median(3, work)
}

fn multiply(pass: Pass, [rows, inputs, outputs]: [usize; 3], [x, y, w]: [&mut [f32]; 3]) {
    let (add, replace) = (Accum::Add, Accum::Replace);
    match pass {
        Pass::Forward => {
            let y = MatMut::from_row_major_slice_mut(y, rows, outputs);
            let x = MatRef::from_row_major_slice(x, rows, inputs);
            let w = MatRef::from_row_major_slice(w, outputs, inputs);
            matmul(y, add, x, w.transpose(), 1.0, Par::Seq);
        }
        Pass::InputGradient => {
            let x = MatMut::from_row_major_slice_mut(x, rows, inputs);
            let y = MatRef::from_row_major_slice(y, rows, outputs);
            let w = MatRef::from_row_major_slice(w, outputs, inputs);
            matmul(x, replace, y, w, 1.0, Par::Seq);
        }
        Pass::WeightGradient => {
            let w = MatMut::from_row_major_slice_mut(w, outputs, inputs);
            let y = MatRef::from_row_major_slice(y, rows, outputs);
            let x = MatRef::from_row_major_slice(x, rows, inputs);
            matmul(w, add, y.transpose(), x, 1.0, Par::Seq);
        }
    }
}
