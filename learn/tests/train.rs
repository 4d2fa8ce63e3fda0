//! Training: one step against the f64 reference, exact resumption, and files.
#![allow(clippy::unwrap_used, reason = "a test may stop where it fails")]

mod reference;

use std::fs;
use std::path::PathBuf;

use proptest::prelude::*;
use rand::RngExt;
use rand::seq::index;
use reference::{Cloud, loss_gradient};
use serde_json::json;
use tdcr_learn::data::{CloudSet, Normalisation};
use tdcr_learn::flow::{FlowPath, Heun, Stream, TimeGrid, rng};
use tdcr_learn::net::MlpShape;
use tdcr_learn::train::{Model, Provenance, TrainError, TrainSettings, Trainer, TrainingState};
use tdcr_sim::robot::RobotSpec;
use tempfile::TempDir;

const SHAPE: MlpShape = MlpShape {
    width: 16,
    depth: 2,
    embedding: 8,
    condition_dim: 2,
};

fn settings() -> TrainSettings {
    TrainSettings {
        steps: 12,
        clouds: 3,
        points: 20,
        warmup_steps: 2,
        validate_every: 3,
        validation_clouds: 2,
        validation_points: 20,
        sampler: Heun {
            steps: 3,
            grid: TimeGrid::Power(2.0),
        },
        ..TrainSettings::default()
    }
}

/// Clouds of a short bar whose centre the condition moves.
fn bars(clouds: usize, seed: u64) -> CloudSet {
    let rng = &mut rng(seed, Stream::Sample(0));
    let conditions: Vec<f32> = (0..2 * clouds)
        .map(|_| rng.random_range(0.0..1.0))
        .collect();
    let points = conditions.as_chunks::<2>().0.iter().flat_map(|c| {
        let at = |k: usize| [c[0] - 0.5, c[1] - 0.5, 0.01 * k as f32];
        (0..40).flat_map(at).collect::<Vec<f32>>()
    });
    CloudSet {
        condition_dim: 2,
        points_per_cloud: 40,
        points: points.collect(),
        conditions,
    }
}

/// Chamfer distance by brute force.
fn chamfer(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let square = |p: &[f32; 3], q: &[f32; 3]| -> f64 {
        (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum()
    };
    let one_way = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        let nearest = a
            .iter()
            .map(|p| b.iter().map(|q| square(p, q)).fold(f64::INFINITY, f64::min));
        nearest.sum::<f64>() / a.len() as f64
    };
    one_way(a, b) + one_way(b, a)
}

fn provenance() -> Provenance {
    Provenance {
        robot: RobotSpec::standard("2m"),
        normalisation: Normalisation {
            motor_min: vec![0.0, 0.01],
            motor_max: vec![0.04, 0.03],
            scale: 0.4,
        },
    }
}

/// A run, its validations taken, after `steps` steps.
fn run<'a>(mut trainer: Trainer<'a>, steps: u64) -> Trainer<'a> {
    while trainer.steps_taken() < steps {
        trainer.step().unwrap();
        if trainer.validation_is_due() {
            trainer.validate(&chamfer).unwrap();
        }
    }
    trainer
}

/// The batch of step 1, drawn again from the documented streams.
fn first_batch(settings: &TrainSettings, set: &CloudSet) -> Vec<Cloud> {
    let mut rng = rng(settings.seed, Stream::Step(1));
    let cloud = |_| {
        let cloud = rng.random_range(0..set.len());
        let time = settings.path.sample_time(&mut rng);
        let subset = index::sample(&mut rng, set.points_per_cloud, settings.points);
        let data = set.cloud(cloud).as_chunks::<3>().0;
        let mut noise = vec![0.0; settings.points * 3];
        FlowPath::default().sample_prior(&mut rng, &mut noise);
        let pairs = noise
            .as_chunks::<3>()
            .0
            .iter()
            .zip(subset.iter().map(|k| data[k]));
        let t = f64::from(time);
        let path = pairs.map(|(x0, x1)| {
            let (x0, x1) = (x0.map(f64::from), x1.map(f64::from));
            let at = |k: usize| (1.0 - t) * x0[k] + t * x1[k];
            ([0, 1, 2].map(at), [0, 1, 2].map(|k| x1[k] - x0[k]))
        });
        let (points, targets) = path.unzip();
        let condition = set
            .condition(cloud)
            .iter()
            .copied()
            .map(f64::from)
            .collect();
        Cloud {
            time: t,
            condition,
            points,
            targets,
        }
    };
    (0..settings.clouds).map(cloud).collect()
}

#[test]
fn one_step_is_adamw_on_the_clipped_gradient_of_the_reference() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let settings = TrainSettings {
        clip_norm: 0.01,
        learning_rate: 1e-2,
        ..settings()
    };
    let mut trainer = Trainer::new(SHAPE, settings.clone(), &training, &validation).unwrap();
    let before: Vec<f64> = trainer
        .state(provenance())
        .params
        .iter()
        .copied()
        .map(f64::from)
        .collect();
    trainer.step().unwrap();
    let after = trainer.state(provenance());

    let gradient = loss_gradient(SHAPE, &before, &first_batch(&settings, &training));
    let norm = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
    assert!(norm > 0.02, "the test should clip");
    for (k, (before, g)) in before.iter().zip(gradient).enumerate() {
        let g = g * 0.01 / norm;
        assert!((f64::from(after.first_moment[k]) - 0.1 * g).abs() < 1e-7);
        // Warm-up: half the learning rate. The quotient amplifies gradients near epsilon; those are left out.
        let expected = before * (1.0 - 5e-3 * 1e-4) - 5e-3 * g / (g.abs() + 1e-8);
        if g.abs() > 1e-5 {
            assert!(
                (f64::from(after.params[k]) - expected).abs() < 1e-5,
                "parameter {k}"
            );
        }
        let average = before + (1.0 - 2.0 / 11.0) * (f64::from(after.params[k]) - before);
        assert!((f64::from(after.average[k]) - average).abs() < 1e-6);
    }
}

#[test]
fn training_learns_where_the_command_puts_the_bar() {
    let (training, validation) = (bars(64, 1), bars(8, 2));
    let settings = TrainSettings {
        steps: 400,
        clouds: 8,
        learning_rate: 5e-3,
        warmup_steps: 20,
        validate_every: 100,
        validation_clouds: 8,
        ..settings()
    };
    let shape = MlpShape {
        width: 32,
        depth: 3,
        embedding: 16,
        ..SHAPE
    };
    let trainer = run(
        Trainer::new(shape, settings, &training, &validation).unwrap(),
        400,
    );
    let (first, last) = (trainer.validations()[0].1, trainer.validations()[3].1);
    assert_eq!(trainer.validations().len(), 4);
    assert!(last < 0.02 && last < first, "{first} to {last}");
    let model = trainer.model(provenance()).unwrap();
    let smallest = trainer
        .validations()
        .iter()
        .map(|v| v.1)
        .fold(f64::INFINITY, f64::min);
    assert_eq!(model.validation_distance, smallest);
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one_bit_for_bit() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("run.safetensors");
    let start = || Trainer::new(SHAPE, settings(), &training, &validation).unwrap();
    let whole = run(start(), 12).state(provenance());
    let interrupted = run(start(), 7).state(provenance());
    interrupted.save(&file).unwrap();
    let loaded = TrainingState::load(&file).unwrap();
    assert_eq!(loaded, interrupted);
    let resumed = Trainer::resume(loaded, SHAPE, settings(), &training, &validation).unwrap();
    assert_eq!(run(resumed, 12).state(provenance()), whole);
}

#[test]
fn a_run_does_not_depend_on_the_number_of_threads() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let states = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let trainer = Trainer::new(SHAPE, settings(), &training, &validation).unwrap();
        pool.install(|| run(trainer, 12).state(provenance()))
    });
    assert_eq!(states[0], states[1]);
}

#[test]
fn a_state_of_another_run_is_refused() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let state = || {
        run(
            Trainer::new(SHAPE, settings(), &training, &validation).unwrap(),
            3,
        )
        .state(provenance())
    };
    let error = |shape, settings, training| {
        Trainer::resume(state(), shape, settings, training, &validation)
            .unwrap_err()
            .to_string()
    };
    let other = TrainSettings {
        clip_norm: 2.0,
        ..settings()
    };
    assert_eq!(
        error(SHAPE, other, &training),
        "the training state is of another run: settings.clip_norm was 1.0, expected 2.0"
    );
    assert!(
        error(MlpShape { width: 8, ..SHAPE }, settings(), &training)
            .contains("shape.width was 16, expected 8")
    );
    assert!(error(SHAPE, settings(), &bars(5, 9)).contains("training set's fingerprint"));
}

#[test]
fn sets_that_do_not_suit_the_run_are_refused() {
    let (good, mut bad) = (bars(5, 1), bars(5, 1));
    let refused = |set: &CloudSet, settings: TrainSettings| {
        Trainer::new(SHAPE, settings, set, &good)
            .unwrap_err()
            .to_string()
    };
    let many = TrainSettings {
        points: 41,
        ..settings()
    };
    assert_eq!(
        refused(&good, many),
        "training set: 40 points per cloud, expected at least 41"
    );
    let many = TrainSettings {
        validation_clouds: 6,
        ..settings()
    };
    assert!(refused(&good, many).starts_with("validation_clouds is 6"));
    bad.points[7] = f32::NAN;
    assert_eq!(
        refused(&bad, settings()),
        "training set: point coordinate 7 is NaN, expected finite values"
    );
    bad.points.pop();
    assert!(refused(&bad, settings()).contains("10 condition values and 599 point coordinates"));
    bad.condition_dim = 3;
    assert!(refused(&bad, settings()).contains("dimension 3, expected the network's 2"));
}

#[test]
fn divergence_stops_the_run_by_name() {
    let mut training = bars(5, 1);
    training.points.fill(1e25);
    let validation = bars(3, 2);
    let mut trainer = Trainer::new(SHAPE, settings(), &training, &validation).unwrap();
    let error = trainer.step().unwrap_err();
    assert!(
        matches!(error, TrainError::Diverged { step: 1, .. }),
        "{error}"
    );
    let error = trainer.validate(&|_, _| f64::NAN).unwrap_err();
    assert!(matches!(
        error,
        TrainError::Diverged {
            quantity: "the validation distance",
            ..
        }
    ));
}

/// A trained model and the folder that it may be saved in.
fn model() -> (Model, TempDir) {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let trainer = run(
        Trainer::new(SHAPE, settings(), &training, &validation).unwrap(),
        3,
    );
    (
        trainer.model(provenance()).unwrap(),
        TempDir::new().unwrap(),
    )
}

#[test]
fn a_saved_model_predicts_the_same_cloud() {
    let (model, folder) = model();
    let file = folder.path().join("model.safetensors");
    model.save(&file).unwrap();
    let loaded = Model::load(&file).unwrap();
    assert_eq!(loaded.provenance, model.provenance);
    assert_eq!(
        (loaded.step, loaded.validation_distance),
        (model.step, model.validation_distance)
    );
    let predict = |model: &Model| {
        model
            .predict(&[0.02, 0.02], 50, 7, &Heun::default())
            .unwrap()
    };
    assert_eq!(predict(&loaded), predict(&model));
    assert_eq!(
        fs::read_dir(folder.path()).unwrap().count(),
        1,
        "no temporary file is left"
    );
}

#[test]
fn a_prediction_is_the_integrated_noise_in_metres() {
    let (model, _folder) = model();
    let mut expected = vec![0.0; 30];
    FlowPath::default().sample_prior(&mut rng(7, Stream::Sample(0)), &mut expected);
    Heun::default().integrate(&model.network, &[0.25, 0.5], &mut expected);
    let predicted = model
        .predict(&[0.01, 0.02], 10, 7, &Heun::default())
        .unwrap();
    for (x, expected) in predicted.as_flattened().iter().zip(expected) {
        assert!((x - 0.4 * expected).abs() < 1e-5);
    }
}

#[test]
fn commands_that_do_not_fit_are_refused() {
    let (model, _folder) = model();
    let predict = |command: &[f64]| model.predict(command, 10, 0, &Heun::default()).unwrap_err();
    assert_eq!(
        predict(&[0.0]).to_string(),
        "the command has 1 values, expected 2"
    );
    assert_eq!(
        predict(&[0.0, f64::INFINITY]).to_string(),
        "value 1 of the command is inf, expected a finite number"
    );
}

/// A model's file, rewritten by `change` of its header and its tensors, and the error of loading it.
fn refusal(
    change: impl FnOnce(&mut serde_json::Value, &mut Vec<(String, Vec<usize>, Vec<f32>)>),
) -> String {
    let (model, folder) = model();
    let mut header = json!({
        "format": 1,
        "kind": "model",
        "content": {
            "provenance": model.provenance,
            "shape": model.network.shape(),
            "settings": model.settings,
            "step": 3,
            "validation_distance": 0.1,
        },
    });
    let params = model.network.params();
    let tensors = SHAPE.tensors().into_iter();
    let mut tensors = tensors
        .map(|t| (t.name, t.shape, params[t.range].to_vec()))
        .collect();
    change(&mut header, &mut tensors);
    let bytes: Vec<Vec<u8>> = tensors
        .iter()
        .map(|t| t.2.iter().flat_map(|x| x.to_le_bytes()).collect())
        .collect();
    let views = tensors.iter().zip(&bytes).map(|((name, shape, _), bytes)| {
        (
            name,
            safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape.clone(), bytes)
                .unwrap(),
        )
    });
    let metadata = [("tdcr".to_owned(), header.to_string())].into();
    let file = folder.path().join("model.safetensors");
    fs::write(
        &file,
        safetensors::serialize(views, Some(metadata)).unwrap(),
    )
    .unwrap();
    match Model::load(&file) {
        Ok(_) => "accepted".to_owned(),
        Err(error) => {
            let message = error.to_string();
            message
                .strip_prefix(&format!("{}: ", file.display()))
                .expect("an error names its file")
                .to_owned()
        }
    }
}

#[test]
fn files_that_are_no_model_are_refused_with_what_is_wrong() {
    assert_eq!(refusal(|_, _| ()), "accepted");
    assert_eq!(
        refusal(|header, _| header["format"] = json!(2)),
        "format version 2, expected 1"
    );
    assert_eq!(
        refusal(|header, _| header["kind"] = json!("training state")),
        "holds a training state, expected a model"
    );
    assert_eq!(
        refusal(|_, tensors| drop(tensors.remove(0))),
        "no tensor `time.weight`, expected one of type F32 [8, 8]"
    );
    assert_eq!(
        refusal(|_, tensors| tensors[0].1 = vec![4, 16]),
        "tensor `time.weight` is F32 [4, 16], expected F32 [8, 8]"
    );
    assert_eq!(
        refusal(|_, tensors| tensors.push(("other".to_owned(), vec![1], vec![0.0]))),
        "unexpected tensor `other`"
    );
    assert_eq!(
        refusal(|_, tensors| tensors[1].2[3] = f32::NAN),
        "tensor `time.bias` is NaN at index 3, expected finite values"
    );
    let content =
        |field: &'static str, value| refusal(move |header, _| header["content"][field] = value);
    assert!(content("shape", json!({"width": 0})).starts_with("header `tdcr`: missing field"));
    let shape = json!({"width": 0, "depth": 2, "embedding": 8, "condition_dim": 2});
    assert_eq!(
        content("shape", shape),
        "header `tdcr`: network width is 0, expected 1 to 8192"
    );
    let normalisation = json!({"motor_min": [0.0, 1.1], "motor_max": [1.0, 1.0], "scale": 0.4});
    let provenance = json!({"robot": null, "normalisation": normalisation});
    assert_eq!(
        content("provenance", provenance),
        "header `tdcr`: motor 1 runs from 1.1 to 1, expected min <= max, finite"
    );
}

#[test]
fn what_is_not_safetensors_is_refused() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("model.safetensors");
    assert!(
        Model::load(&file)
            .unwrap_err()
            .to_string()
            .contains("cannot read")
    );
    fs::write(&file, b"a letter").unwrap();
    assert!(
        Model::load(&file)
            .unwrap_err()
            .to_string()
            .contains("not a whole safetensors file")
    );
}

#[test]
fn a_failed_save_leaves_the_old_file() {
    let (model, folder) = model();
    let missing = folder.path().join("missing/model.safetensors");
    assert!(
        model
            .save(&missing)
            .unwrap_err()
            .to_string()
            .contains("cannot write")
    );
}

/// A valid model and a valid training state.
fn files() -> [Vec<u8>; 2] {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let trainer = run(
        Trainer::new(SHAPE, settings(), &training, &validation).unwrap(),
        3,
    );
    let folder = TempDir::new().unwrap();
    let [model, state] = ["model", "state"].map(|name| folder.path().join(name));
    trainer.model(provenance()).unwrap().save(&model).unwrap();
    trainer.state(provenance()).save(&state).unwrap();
    [model, state].map(|file: PathBuf| fs::read(file).unwrap())
}

#[test]
fn damaged_files_never_panic() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("damaged");
    let load = |bytes: &[u8]| {
        fs::write(&file, bytes).unwrap();
        (
            Model::load(&file).is_ok(),
            TrainingState::load(&file).is_ok(),
        )
    };
    let files = files();
    assert_eq!(
        [load(&files[0]), load(&files[1])],
        [(true, false), (false, true)]
    );
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig::with_cases(300));
    let strategy = (
        0..2usize,
        any::<prop::sample::Index>(),
        0..8u32,
        any::<bool>(),
    );
    let damage = |(which, at, bit, truncate): (usize, prop::sample::Index, u32, bool)| {
        let mut bytes = files[which].clone();
        // Headers are where the structure is: half of the flips go there.
        let span = if bit % 2 == 0 { bytes.len() } else { 3000 };
        let at = at.index(span.min(bytes.len()));
        if truncate {
            bytes.truncate(at);
            prop_assert_eq!(load(&bytes), (false, false));
        } else {
            bytes[at] ^= 1 << bit;
            load(&bytes);
        }
        Ok(())
    };
    runner.run(&strategy, damage).unwrap();
}
