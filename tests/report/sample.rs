//! A report of made-up numbers about bent tubes.

use tdcr::report::{
    Example, MethodDistances, MotorGroup, PerTest, Report, Role, Score, Stage, Training,
};
use tdcr::sim::cloud::PointCloud;
use tdcr::sim::robot::RobotSpec;

/// The next number in `[0, 1)` of a linear congruential generator (Knuth's MMIX constants).
fn uniform(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

/// Points on a tube of 2 cm radius and 0.25 m length, bent into arcs of `angle` (rad) in the vertical
/// plane at `azimuth`: its lower half one way, its upper half `counter` times as much. `noise` (m)
/// displaces each point.
pub fn bent_tube(azimuth: f64, angle: f64, counter: f64, noise: f64, seed: u64) -> PointCloud {
    const HALF: f64 = 0.125;
    let mut state = seed;
    let mut cloud = PointCloud::default();
    let half_arc = |start: f64, bend: f64, s: f64| {
        let steps = 64;
        let mut end = [0.0, 0.0];
        for k in 0..steps {
            let tilt = start + bend * s * (k as f64 + 0.5) / steps as f64;
            end[0] += tilt.sin() * s * HALF / steps as f64;
            end[1] += tilt.cos() * s * HALF / steps as f64;
        }
        end
    };
    for _ in 0..5000 {
        let s = 2.0 * uniform(&mut state);
        let (lower, upper) = (s.min(1.0), (s - 1.0).max(0.0));
        let first = half_arc(0.0, angle, lower);
        let second = half_arc(angle, counter * angle, upper);
        let tilt = angle * lower + counter * angle * upper;
        let around = std::f64::consts::TAU * uniform(&mut state);
        let out = 0.02 * around.cos();
        let across = first[0] + second[0] + out * tilt.cos();
        let up = 0.174 + first[1] + second[1] - out * tilt.sin();
        let side = 0.02 * around.sin();
        let (sin, cos) = azimuth.sin_cos();
        let exact = [cos * across - sin * side, sin * across + cos * side, up];
        let mut jitter = || noise * (uniform(&mut state) + uniform(&mut state) - 1.0);
        cloud.points.push(exact.map(|x| (x + jitter()) as f32));
        cloud.colors.push(hue((s * 5.0).floor() / 10.0));
    }
    cloud
}

/// A saturated colour of a hue in `[0, 1]`, from red to blue.
fn hue(h: f64) -> [u8; 3] {
    [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|center| {
        let distance = (0.75 * h - center)
            .abs()
            .min(1.0 - (0.75 * h - center).abs());
        (255.0 * (2.0 - 6.0 * distance).clamp(0.0, 1.0)) as u8
    })
}

/// An example with a bend of `angle` (rad) towards `azimuth`.
pub fn example(label: &str, azimuth: f64, angle: f64, counter: f64) -> Example {
    Example {
        label: label.to_owned(),
        command: (0..6)
            .map(|k| 0.04 * (k as f64 * 0.37 + azimuth).fract().abs())
            .collect(),
        truth: bent_tube(azimuth, angle, counter, 0.0, 1),
        prediction: bent_tube(azimuth + 0.02, angle * 1.02, counter, 0.003, 2),
        nearest: bent_tube(azimuth + 0.2, angle * 0.8, counter, 0.0, 3),
        cd: 3.1e-5,
        emd: 5.1e-3,
        cd_nearest: 2.84e-4,
        error: (0..5000).map(|k| 1e-6 * f64::from(k)).collect(),
        uncertainty: (0..5000).map(|k| 2e-7 * f64::from(k)).collect(),
        tip: Some(2.3e-3),
        ..Example::default()
    }
}

/// A method's distances.
pub fn method(name: &str, role: Role, values: Vec<f64>) -> MethodDistances {
    MethodDistances {
        name: name.to_owned(),
        role,
        values,
    }
}

/// A report with everything in it.
pub fn full_report() -> Report {
    let mut state = 9;
    let mut log_normal = |median: f64, spread: f64| -> Vec<f64> {
        let mut draw = || (0..12).map(|_| uniform(&mut state)).sum::<f64>() - 6.0;
        (0..500).map(|_| median * (spread * draw()).exp()).collect()
    };
    let score = |name: &str, cd, emd: f64| Score {
        name: name.to_owned(),
        cd,
        emd,
        emd_squared: 1.2 * emd * emd,
    };
    let summary = [
        ("Robot", "2m, two modules, no base"),
        ("Commands", "4,000 training, 500 validation, 500 test"),
        ("Points per cloud", "10,000"),
        ("Network", "MLP, width 256, depth 6"),
        ("Parameters", "1,412,355"),
        ("Training", "40,000 steps of 16 clouds × 1,024 points"),
        ("Sampler", "Heun, 8 steps, t = 1 − (1 − k/n)²"),
        ("Seed", "0"),
        ("Version", "0.1.0"),
    ];
    let stages = [
        ("Simulate 5,000 commands", 4.2),
        ("Render 8 cameras and fuse clouds", 96.0),
        ("Train", 754.0),
        ("Predict 500 test commands", 31.0),
        ("Score", 12.3),
        ("Write the report", 0.8),
    ];
    let loss = |k: u64| {
        0.9 / (1.0 + k as f64 / 300.0) + 0.02 + 0.004 * ((k * 37 % 101) as f64 / 50.0 - 1.0)
    };
    Report {
        title: "Shape of a two-module robot, learned from its tendon commands".to_owned(),
        headline: "On 500 commands that it has not seen, the network’s clouds have a mean Chamfer \
                   distance of 0.33 × 10⁻⁴ m², 8 times less than the nearest of 4,000 training commands."
            .to_owned(),
        summary: summary.map(|(name, value)| (name.to_owned(), value.to_owned())).to_vec(),
        scores: vec![
            score("Network", 3.3e-5, 5.2e-3),
            score("Nearest training command", 2.75e-4, 1.18e-2),
            score("Mean training command", 3.012e-3, 4.61e-2),
        ],
        floor: Some(score("Sampling floor", 2.7e-6, 2.4e-3)),
        score_notes: vec![
            "Means over 500 test commands; CD with 10,000 points a cloud, EMD with 2,000 points.".to_owned(),
        ],
        per_test: Some(PerTest {
            methods: vec![
                method("Network", Role::Network, log_normal(2.6e-5, 0.6)),
                method("Nearest training command", Role::Nearest, log_normal(2.2e-4, 0.7)),
                method("Sampling floor", Role::Floor, log_normal(2.7e-6, 0.1)),
            ],
            commands: (0..500)
                .map(|k| (0..6).map(|m| 0.04 * (0.618 * f64::from(k * (m + 1))).fract()).collect())
                .collect(),
            apart: (0..500).map(|k| 0.1 + 0.4 * (0.755 * f64::from(k)).fract()).collect(),
        }),
        training: Some(Training {
        loss_curve: (0..4000).map(|k| (10 * k, loss(10 * k))).collect(),
        validation_curve: (1..=20).map(|k| (2000 * k, 3.0e-5 + 9e-4 / (k as f64).powf(1.7))).collect(),
        validation_note: "On 2,048 points of 16 clouds.".to_owned(),
        }),
        stages: stages
            .map(|(name, seconds)| Stage {
                name: name.to_owned(),
                seconds,
            })
            .to_vec(),
        motors: MotorGroup::of(RobotSpec::standard("2m").as_ref(), 6),
        examples: (0..8)
            .map(|k| {
                let turn = k as f64;
                let counter = [1.0, -1.0, 0.6, -1.6][k % 4];
                example(&format!("Test command {}", 17 + 53 * k), 0.8 * turn, 0.25 + 0.13 * turn, counter)
            })
            .collect(),
    }
}
