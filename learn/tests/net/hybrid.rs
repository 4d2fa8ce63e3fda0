//! What holds for the hybrid network of any size.
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{from_value, json, to_value};
use tdcr_learn::flow::VelocityField;
use tdcr_learn::net::{
    Batch, Channels, ContextLayers, ContextShape, HybridShape, MlpShape, Network, NetworkShape,
    Precision, Stage, TimeFeatures, TimeGate, Workspace,
};

/// The paper's weight of the colours' error.
const COLOR_WEIGHT: f32 = 0.05;

const HEAD: MlpShape = MlpShape {
    width: 19,
    depth: 3,
    embedding: 8,
    condition_dim: 3,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

const fn stage(channels: usize, resolution: usize) -> Stage {
    Stage {
        channels,
        resolution,
    }
}

const SHAPE: HybridShape = HybridShape {
    head: HEAD,
    context: ContextShape {
        layers: ContextLayers::Residual,
        stages: [stage(6, 5), stage(24, 4), stage(5, 2)],
        blocks: 2,
        joined: 12,
        features: 7,
        gate: TimeGate {
            centre: 0.5,
            steepness: 4.0,
        },
    },
};

/// By how much rounding to bfloat16, of 8 bits, may change results of the head, and single tensors of the context, whose
/// gradients pass two dozen products and norms, and units that rounding switches on or off.
const ROUNDING: [f64; 2] = [1e-2, 0.1];

fn uniform(seed: u64, len: usize) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..len).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// A network with no parameter at a special value.
fn network(shape: HybridShape) -> Network {
    let params = uniform(1, shape.parameter_count());
    Network::from_params(shape, params.iter().map(|p| 0.5 * p).collect()).unwrap()
}

/// `clouds` clouds of `points` points.
struct Samples {
    times: Vec<f32>,
    conditions: Vec<f32>,
    points: Vec<f32>,
    targets: Vec<f32>,
}

impl Samples {
    fn new(clouds: usize, points: usize) -> Self {
        Self {
            times: uniform(2, clouds).iter().map(|t| t.abs()).collect(),
            conditions: uniform(3, clouds * HEAD.condition_dim),
            points: uniform(4, clouds * points * 3),
            targets: uniform(5, clouds * points * 3),
        }
    }

    fn cloud(&self, k: usize) -> Self {
        let of = |numbers: &[f32]| {
            let len = numbers.len() / self.times.len();
            numbers[k * len..(k + 1) * len].to_vec()
        };
        Self {
            times: of(&self.times),
            conditions: of(&self.conditions),
            points: of(&self.points),
            targets: of(&self.targets),
        }
    }

    fn batch(&self) -> Batch<'_> {
        Batch {
            times: &self.times,
            conditions: &self.conditions,
            points: &self.points,
            targets: &self.targets,
            color_weight: COLOR_WEIGHT,
            huber: None,
        }
    }
}

fn loss_and_gradient(network: &Network, samples: &Samples) -> (f64, Vec<f32>) {
    let mut gradient = vec![f32::NAN; network.params().len()];
    let workspace = &mut Workspace::default();
    let loss = network.loss_and_gradient(&samples.batch(), workspace, &mut gradient);
    (loss, gradient)
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    for precision in Precision::ALL {
        let shape = HybridShape {
            head: MlpShape { width: 32, ..HEAD },
            ..SHAPE
        };
        let network = network(shape).with_precision(precision).unwrap();
        let samples = Samples::new(11, 1500);
        let results = [1, 2, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let mut velocities = vec![0.0; samples.points.len()];
                network.velocity(0.5, &[0.2, 0.3, 0.4], &samples.points, &mut velocities);
                (loss_and_gradient(&network, &samples), velocities)
            })
        });
        assert_eq!(results[0], results[1]);
        assert_eq!(results[0], results[2]);
    }
}

/// Relative distance in the Euclidean norm.
fn distance(found: &[f32], exact: &[f32]) -> f64 {
    let square = |x: f32| f64::from(x).powi(2);
    let errors = found.iter().zip(exact).map(|(f, e)| square(f - e));
    (errors.sum::<f64>() / exact.iter().copied().map(square).sum::<f64>()).sqrt()
}

/// Of a head whose input is packed and of one whose input is not, with context layers of odd sizes.
#[test]
fn products_of_bfloat16_numbers_change_results_by_their_rounding() {
    let wide = ContextShape {
        stages: [stage(40, 7), stage(24, 5), stage(72, 3)],
        joined: 33,
        features: 45,
        ..SHAPE.context
    };
    for context in [SHAPE.context, wide] {
        let shape = HybridShape {
            head: MlpShape { width: 64, ..HEAD },
            context,
        };
        let float32 = Network::new(shape, &mut ChaCha8Rng::seed_from_u64(0)).unwrap();
        // What starts at zero must not stay there. But for the maximum's share: rounding may change which point has it.
        let noise = uniform(6, float32.params().len());
        let params = float32.params().iter().zip(&noise);
        let mut params: Vec<f32> = params.map(|(p, n)| p + 0.05 * n).collect();
        let tensors = shape.tensors();
        let maximum = tensors
            .iter()
            .find(|tensor| tensor.name == "context.join_maximum.weight");
        params[maximum.unwrap().range.clone()].fill(0.0);
        let float32 = Network::from_params(shape, params).unwrap();
        let bfloat16 = float32.clone().with_precision(Precision::Bfloat16).unwrap();
        let samples = Samples::new(2, 700);
        let [exact, rounded] = [&float32, &bfloat16].map(|n| loss_and_gradient(n, &samples));
        assert!((rounded.0 / exact.0 - 1.0).abs() < 1e-3);
        let found = distance(&rounded.1, &exact.1);
        assert!((1e-6..ROUNDING[0]).contains(&found), "gradient: {found}");
        for tensor in tensors {
            let [exact, rounded] = [&exact.1, &rounded.1].map(|g| &g[tensor.range.clone()]);
            let most = ROUNDING[usize::from(!tensor.name.starts_with("head."))];
            let found = distance(rounded, exact);
            // Features that no point or voxel activates have no gradient.
            let silent = exact == rounded && exact.iter().all(|g| *g == 0.0);
            assert!(
                silent || (1e-6..most).contains(&found),
                "{}: {found}",
                tensor.name
            );
        }
        let velocities = [&float32, &bfloat16].map(|network| {
            let mut velocities = vec![0.0; samples.points.len()];
            network.velocity(0.5, &[0.2, 0.3, 0.4], &samples.points, &mut velocities);
            velocities
        });
        let found = distance(&velocities[1], &velocities[0]);
        assert!((1e-6..ROUNDING[0]).contains(&found), "velocities: {found}");
    }
}

#[test]
fn a_workspace_can_be_used_again_with_another_batch() {
    let network = network(SHAPE);
    let (large, small) = (Samples::new(2, 1100), Samples::new(1, 7));
    let (mut workspace, mut gradient) = (Workspace::default(), vec![0.0; network.params().len()]);
    network.loss_and_gradient(&large.batch(), &mut workspace, &mut gradient);
    let loss = network.loss_and_gradient(&small.batch(), &mut workspace, &mut gradient);
    assert_eq!((loss, gradient), loss_and_gradient(&network, &small));
}

/// Of small clouds, which run in parallel, and of large ones, which do not.
#[test]
fn loss_and_gradient_of_a_batch_are_the_mean_of_its_clouds() {
    let mut large = SHAPE;
    large.context.stages[0] = stage(24, 24);
    for (shape, clouds) in [(SHAPE, 1), (SHAPE, 19), (large, 3)] {
        let network = network(shape);
        let samples = Samples::new(clouds, 200);
        let (mut mean_loss, mut mean) = (0.0, vec![0.0; network.params().len()]);
        for k in 0..clouds {
            let (loss, gradient) = loss_and_gradient(&network, &samples.cloud(k));
            mean_loss += loss / clouds as f64;
            let parts = mean.iter_mut().zip(gradient);
            parts.for_each(|(mean, g)| *mean += g / clouds as f32);
        }
        let (loss, gradient) = loss_and_gradient(&network, &samples);
        assert!((loss / mean_loss - 1.0).abs() < 1e-6, "{loss}, {mean_loss}");
        let found = distance(&gradient, &mean);
        assert!(found < 1e-5, "{clouds} clouds: {found}");
    }
}

/// The gradient's own direction, over clouds of several blocks of points and shares.
#[test]
fn gradient_of_many_points_is_the_finite_difference() {
    let network = network(SHAPE);
    let samples = Samples::new(2, 1300);
    let (_, gradient) = loss_and_gradient(&network, &samples);
    let square: f64 = gradient.iter().map(|g| f64::from(*g).powi(2)).sum();
    let moved = |step: f64| {
        let pairs = network.params().iter().zip(&gradient);
        let params = pairs.map(|(p, g)| (f64::from(*p) + step * f64::from(*g)) as f32);
        let network = Network::from_params(SHAPE, params.collect()).unwrap();
        loss_and_gradient(&network, &samples).0
    };
    let step = 1e-3 / square.sqrt();
    let slope = (moved(step) - moved(-step)) / (2.0 * step);
    assert!((slope / square - 1.0).abs() < 1e-3, "{slope} for {square}");
}

#[test]
fn a_fresh_network_is_its_head_alone() {
    let hybrid = Network::new(SHAPE, &mut ChaCha8Rng::seed_from_u64(0)).unwrap();
    // The head's share of the parameters, less the columns of the input layer that take the context.
    let mut params = Vec::new();
    for spec in SHAPE.head.tensors() {
        let name = match spec.name.split('.').next() {
            Some("time" | "condition") => spec.name,
            _ => format!("head.{}", spec.name),
        };
        let tensors = SHAPE.tensors();
        let tensor = tensors.iter().find(|tensor| tensor.name == name).unwrap();
        let values = &hybrid.params()[tensor.range.clone()];
        match name.as_str() {
            "head.input.weight" => {
                let rows = values.chunks(tensor.shape[1]);
                params.extend(rows.flat_map(|row| &row[..3]));
            }
            _ => params.extend(values),
        }
    }
    let head = Network::from_params(HEAD, params).unwrap();
    let points = uniform(4, 300);
    let [mut expected, mut velocities] = [vec![0.0; 300], vec![0.0; 300]];
    head.velocity(0.8, &[0.1, 0.2, 0.3], &points, &mut expected);
    hybrid.velocity(0.8, &[0.1, 0.2, 0.3], &points, &mut velocities);
    for (v, expected) in velocities.iter().zip(expected) {
        assert!((v - expected).abs() < 1e-6, "{v} for {expected}");
    }
}

#[test]
fn tensors_tile_the_parameter_vector() {
    let mut end = 0;
    for tensor in SHAPE.tensors() {
        assert_eq!(tensor.range.start, end);
        assert_eq!(tensor.range.len(), tensor.shape.iter().product::<usize>());
        end = tensor.range.end;
    }
    assert_eq!(end, SHAPE.parameter_count());
}

#[test]
fn shapes_are_told_apart_by_their_fields() {
    for shape in [NetworkShape::from(HEAD), NetworkShape::from(SHAPE)] {
        let value = to_value(shape).unwrap();
        assert_eq!(from_value::<NetworkShape>(value).unwrap(), shape);
    }
    // As files had it before points could have colours.
    let old = json!({"width": 19, "depth": 3, "embedding": 8, "condition_dim": 3});
    assert_eq!(from_value::<NetworkShape>(old).unwrap(), HEAD.into());
    let error = from_value::<NetworkShape>(json!({"width": 19})).unwrap_err();
    assert!(error.to_string().contains("missing field `depth`"));
}

#[test]
fn impossible_shapes_are_refused_by_name() {
    let error = |change: &dyn Fn(&mut ContextShape)| {
        let mut shape = SHAPE;
        change(&mut shape.context);
        shape.check().unwrap_err().to_string()
    };
    assert_eq!(
        error(&|context| context.stages[1].resolution = 0),
        "network stage's resolution is 0, expected 1 to 128"
    );
    assert_eq!(
        error(&|context| {
            context.stages[0] = Stage {
                channels: 4096,
                resolution: 128,
            };
        }),
        "a grid of 128 voxels per edge with 4096 channels has 8589934592 numbers, expected at most 67108864: choose a \
         smaller resolution, or fewer channels"
    );
    let said = error(&|context| {
        context.stages = context.stages.map(|stage| Stage {
            channels: 4096,
            ..stage
        })
    });
    assert!(said.starts_with("a network of these sizes has "), "{said}");
    assert!(
        said.contains("expected at most 134217728: choose smaller ones"),
        "{said}"
    );
    assert!(error(&|context| context.joined = 0).contains("joined features is 0"));
    let said = error(&|context| context.gate.centre = f32::NAN);
    assert_eq!(
        said,
        "network time gate's centre is NaN, expected a finite number"
    );
}

#[test]
fn a_cloud_in_one_place_has_finite_velocities() {
    let points = [0.25; 30];
    let mut velocities = [f32::NAN; 30];
    network(SHAPE).velocity(0.5, &[0.1, 0.2, 0.3], &points, &mut velocities);
    assert!(velocities.iter().all(|v| v.is_finite()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// The paper's Sec. Method: permutation equivariance.
    #[test]
    fn permuted_points_have_permuted_velocities(
        count in 2usize..600,
        by in 0usize..600,
        time in 0f32..1.0,
        seed in 10u64..1000,
    ) {
        let network = network(SHAPE);
        let points = uniform(seed, count * 3);
        let velocities = |points: &[f32]| {
            let mut velocities = vec![0.0; points.len()];
            network.velocity(time, &[0.5, 0.1, 0.9], points, &mut velocities);
            velocities
        };
        let mut rotated = points.clone();
        rotated.rotate_left(by % count * 3);
        let mut expected = velocities(&points);
        expected.rotate_left(by % count * 3);
        for (v, expected) in velocities(&rotated).iter().zip(expected) {
            prop_assert!((v - expected).abs() < 2e-4, "{} for {}", v, expected);
        }
    }
}
