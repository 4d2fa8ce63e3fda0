//! Flows that start from the surface of a simulated robot.

use tdcr_learn::data::{CloudSet, Condition, Normalisation, Recipe, StreamSpec, Subject};
use tdcr_learn::flow::{FlowPath, Sampler};
use tdcr_learn::metrics::chamfer;
use tdcr_learn::net::{Channels, MlpShape, TimeFeatures};
use tdcr_learn::predict::Predictor;
use tdcr_learn::prior::{Prior, SurfaceError, SurfacePrior};
use tdcr_learn::symmetry::Reduction;
use tdcr_learn::train::{Model, Provenance, StreamWindow, Teacher, TrainSettings, Trainer};
use tdcr_sim::robot::{Cameras, RobotSpec};

/// How far the real robot stands from where the model says (m): what there is to learn.
const OFF: f32 = 0.02;

fn recipe() -> Recipe {
    let mut robot = RobotSpec::load("2m").expect("a standard robot");
    if let Cameras::Ring(ring) = &mut robot.cameras {
        ring.resolution = [160, 90];
    }
    let subject = Subject {
        robot,
        ..Subject::default()
    };
    Recipe {
        subject,
        voxel_size: 0.004,
        sensor: None,
    }
}

fn conditions(count: usize) -> Vec<Condition> {
    let motor = |i: usize, k: usize| 0.04 * ((7 * i + 3 * k) % 10) as f32 / 9.0;
    let condition = |i| Condition {
        motors: (0..6).map(|k| motor(i, k)).collect(),
        payload: None,
    };
    (0..count).map(condition).collect()
}

fn normalisation() -> Normalisation {
    Normalisation {
        motor_min: vec![0.0; 6],
        motor_max: vec![0.04; 6],
        scale: 0.4,
    }
}

/// Points of a surface.
const POINTS: usize = 1000;

/// Clouds of the robot as it is, beside the surfaces of the model.
fn set(count: usize, seed: u64) -> CloudSet {
    let (prior, units) = (
        SurfacePrior::new(&recipe()).expect("a robot"),
        normalisation(),
    );
    let commands = conditions(count);
    let values = commands
        .iter()
        .map(|command| units.condition(&command.to_vec()));
    let mut points = Vec::new();
    for (index, command) in commands.iter().enumerate() {
        let cloud = prior
            .predict(command, POINTS, seed + index as u64)
            .expect("a surface");
        points.extend(cloud.points.iter().flat_map(|p| [p[0] + OFF, p[1], p[2]]));
    }
    units.normalise_points(&mut points);
    let set = CloudSet {
        condition_dim: 6,
        points_per_cloud: POINTS,
        conditions: values
            .collect::<Result<Vec<_>, _>>()
            .expect("six motors")
            .concat(),
        points,
        colors: None,
        starts: None,
    };
    let starts = prior.starts(&set, &commands, &units, seed, &|| true);
    CloudSet {
        starts: Some(starts.expect("surfaces")),
        ..set
    }
}

fn settings(steps: u64) -> TrainSettings {
    TrainSettings {
        steps,
        clouds: 8,
        points: 64,
        learning_rate: 5e-3,
        warmup_steps: 20,
        validate_every: steps,
        validation_clouds: 2,
        validation_points: 200,
        path: FlowPath {
            prior_deviation: Prior::SURFACE_DEVIATION,
            ..FlowPath::default()
        },
        prior: Prior::Surface(Box::new(recipe())),
        ..TrainSettings::default()
    }
}

const SHAPE: MlpShape = MlpShape {
    width: 32,
    depth: 3,
    embedding: 16,
    condition_dim: 6,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

fn trained(steps: u64, set: &CloudSet) -> Model {
    let mut trainer = Trainer::new(SHAPE, settings(steps), set, set).expect("a run");
    while !trainer.is_finished() {
        trainer.step().expect("a finite loss");
    }
    let distance = |a: &[[f32; 3]], b: &[[f32; 3]]| chamfer(a, b).unwrap_or(f64::NAN);
    trainer.validate(&distance).expect("a finite distance");
    let provenance = Provenance {
        subject: None,
        normalisation: normalisation(),
        reduction: Reduction::default(),
    };
    trainer.model(provenance).expect("a validated run")
}

#[test]
fn a_few_samples_teach_what_the_model_is_wrong_by() {
    let model = trained(300, &set(6, 1));
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("model.safetensors");
    model.save(&file).expect("a file can be written");
    let read = Model::load(&file).expect("what was written is read");
    let prior = SurfacePrior::new(&recipe()).expect("a robot");
    // A command that was not among those trained on.
    let condition = Condition {
        motors: vec![0.01, 0.03, 0.02, 0.035, 0.005, 0.015],
        payload: None,
    };
    let truth = prior
        .predict(&condition, 2000, 5)
        .expect("a surface")
        .points;
    let truth: Vec<_> = truth.iter().map(|p| [p[0] + OFF, p[1], p[2]]).collect();
    let alone = prior
        .predict(&condition, 2000, 6)
        .expect("a surface")
        .points;
    let values = condition.to_vec();
    let predict = |model: &Model| model.predict(&values, 2000, 7, &Sampler::default());
    let (predicted, again) = (
        predict(&model).expect("a cloud"),
        predict(&read).expect("a cloud"),
    );
    assert_eq!(predicted.points, again.points);
    let error = |cloud: &[[f32; 3]]| chamfer(cloud, &truth).expect("clouds");
    let [with, without] = [error(&predicted.points), error(&alone)];
    assert!(
        with < 0.25 * without,
        "{with:e} against {without:e} of the simulator alone"
    );
}

#[test]
fn clouds_are_matched_with_surfaces_the_same_way_on_any_number_of_threads() {
    let (prior, units) = (
        SurfacePrior::new(&recipe()).expect("a robot"),
        normalisation(),
    );
    let (set, commands) = (set(3, 1), conditions(3));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let starts = || prior.starts(&set, &commands, &units, 3, &|| true);
        pool.expect("threads").install(starts).expect("surfaces")
    };
    let starts = on(1);
    assert_eq!(starts, on(3));
    assert_ne!(
        Ok(&starts),
        prior.starts(&set, &commands, &units, 4, &|| true).as_ref()
    );
    let stopped = prior.starts(&set, &commands, &units, 3, &|| false);
    assert_eq!(stopped, Err(SurfaceError::Interrupted));
    // What the flow has to do is near to what the model is wrong by: OFF along x, on a surface sampled every 3 mm or so.
    let mean = |axis| {
        let moved = starts
            .iter()
            .zip(&set.points)
            .skip(axis)
            .step_by(3)
            .map(|(a, b)| f64::from(b - a));
        0.4 * moved.sum::<f64>() / (starts.len() / 3) as f64
    };
    assert!((mean(0) - f64::from(OFF)).abs() < 1e-3, "{}", mean(0));
    assert!(
        mean(1).abs() < 1e-3 && mean(2).abs() < 1e-3,
        "{} {}",
        mean(1),
        mean(2)
    );
}

#[test]
fn conditions_of_another_robot_are_refused() {
    let prior = SurfacePrior::new(&recipe()).expect("a robot");
    let nine = Condition {
        motors: vec![0.01; 9],
        payload: None,
    };
    let refused = prior
        .predict(&nine, 10, 0)
        .expect_err("six tendons")
        .to_string();
    let expected = "the prior's robot has 6 tendons, the conditions have 9 values: expected 6, or one more for a payload";
    assert_eq!(refused, expected);
}

#[test]
fn a_run_without_its_surfaces_or_with_those_of_no_prior_is_refused() {
    let full = set(2, 1);
    let refused = |settings, training: &CloudSet| {
        Trainer::new(SHAPE, settings, training, training)
            .expect_err("refused")
            .to_string()
    };
    let bare = CloudSet {
        starts: None,
        ..full.clone()
    };
    let expected = "training set: no surfaces to start from, which the prior needs";
    assert_eq!(refused(settings(30), &bare), expected);
    let gaussian = TrainSettings {
        prior: Prior::Gaussian,
        ..settings(30)
    };
    let expected = "training set: surfaces to start from, expected none with the Gaussian prior";
    assert_eq!(refused(gaussian, &full), expected);
    let short = CloudSet {
        starts: full.starts.clone().map(|starts| starts[..30].to_vec()),
        ..full.clone()
    };
    assert!(
        refused(settings(30), &short)
            .contains("30 coordinates of surfaces to start from, expected 6000")
    );

    let spec = StreamSpec {
        recipe: recipe(),
        points: 500,
        seed: 0,
    };
    let window = StreamWindow::new(spec, 2, 1, 1, Channels::Xyz).expect("a stream");
    let feed = tdcr_learn::train::Feed::Stream(Box::new(window));
    let streamed = Trainer::new(SHAPE, settings(30), feed, &full).expect_err("refused");
    assert!(
        streamed
            .to_string()
            .starts_with("prior is surface, expected gaussian")
    );
}

#[test]
fn a_flow_from_a_surface_is_not_distilled() {
    let model = trained(25, &set(2, 1));
    let refused = Teacher::new(&model).expect_err("no noise").to_string();
    assert!(
        refused.starts_with("the teacher's prior is surface, expected gaussian"),
        "{refused}"
    );
}
