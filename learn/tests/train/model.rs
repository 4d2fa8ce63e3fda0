//! Models and states as files: what is saved predicts the same, and what does not fit is refused.

use std::fs;
use std::path::PathBuf;

use proptest::prelude::*;
use serde_json::json;
use tdcr_learn::flow::{FlowPath, Sampler, Stream, rng};
use tdcr_learn::metrics::surface_spread;
use tdcr_learn::net::{Channels, NetworkShape};
use tdcr_learn::predict::{ISOLATED, select};
use tdcr_learn::train::{Model, Trainer, TrainingState};
use tempfile::TempDir;

use crate::toy::{COLORED, SHAPE, bars, provenance, run, settings};

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
            .predict(&[0.02, 0.02], 50, 7, &Sampler::default())
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
    let model = Model {
        reach: None,
        ..model
    };
    let mut expected = vec![0.0; 30];
    FlowPath::PAPER.sample_prior(&mut rng(7, Stream::Sample(0)), Channels::Xyz, &mut expected);
    Sampler::default().integrate(&model.network, &[0.25, 0.5], &mut expected);
    let predicted = model
        .predict(&[0.01, 0.02], 10, 7, &Sampler::default())
        .unwrap();
    assert_eq!(predicted.colors, None);
    for (x, expected) in predicted.points.as_flattened().iter().zip(expected) {
        assert!((x - 0.4 * expected).abs() < 1e-5);
    }
}

#[test]
fn spare_points_are_drawn_and_left_out_as_selection_says() {
    let (model, _folder) = model();
    let predict = |points, spare| {
        let sampler = Sampler {
            spare,
            ..Sampler::default()
        };
        model.predict(&[0.01, 0.02], points, 7, &sampler).unwrap()
    };
    let (all, kept) = (predict(60, 0.0), predict(40, 0.5));
    let mut places = all.points.clone();
    let selected = select(&mut places, 40, ISOLATED);
    assert_eq!(kept.points.len(), 40);
    // In the network's units, not in metres: up to rounding.
    for (point, &k) in kept.points.iter().zip(&selected) {
        assert!((0..3).all(|axis| (point[axis] - places[k][axis]).abs() < 1e-6));
    }
    assert_ne!(kept.points, all.points[..40]);
}

#[test]
fn commands_that_do_not_fit_are_refused() {
    let (model, _folder) = model();
    let predict = |command: &[f64]| {
        model
            .predict(command, 10, 0, &Sampler::default())
            .unwrap_err()
    };
    assert_eq!(
        predict(&[0.0]).to_string(),
        "the command has 1 values, expected 2"
    );
    assert_eq!(
        predict(&[0.0, f64::INFINITY]).to_string(),
        "value 1 of the command is inf, expected a finite number"
    );
}

#[test]
fn a_cloud_that_is_not_finite_is_an_error_that_names_command_and_weights() {
    let (mut model, folder) = model();
    let predict = |model: &Model| {
        model
            .predict(&[0.02, 0.01], 10, 0, &Sampler::default())
            .unwrap_err()
            .to_string()
    };
    let sound = model.clone();
    model.network.params_mut().fill(3e38);
    // Finite weights make a model that can be read.
    let file = folder.path().join("model.safetensors");
    model.save(&file).unwrap();
    let said = predict(&Model::load(&file).unwrap());
    assert!(
        said.starts_with(
            "the network's cloud for the command [0.02, 0.01] is not finite: x of point 0 is "
        ),
        "{said}"
    );
    assert!(
        said.contains("the model's largest weight is 3e38, in tensor `"),
        "{said}"
    );

    let mut model = sound;
    model.provenance.normalisation.scale = 1e300;
    assert!(predict(&model).contains("its scale is 1e300 m"));
    model.save(&file).unwrap();
    let said = Model::load(&file).unwrap_err().to_string();
    assert!(said.contains("scale is 1000000"), "{said}");
    assert!(
        said.ends_with("expected a positive length, 1.2e-38 to 3.4e38 m"),
        "{said}"
    );
}

/// A model's file, rewritten by `change` of its header and its tensors, and the error of loading it.
fn refusal(
    change: impl FnOnce(&mut serde_json::Value, &mut Vec<(String, Vec<usize>, Vec<f32>)>),
) -> String {
    let (model, folder) = model();
    let mut header = json!({
        "format": 2,
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
        refusal(|header, _| header["format"] = json!(1)),
        "format version 1, expected 2"
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
    assert_eq!(
        content("shape", json!(NetworkShape::from(COLORED))),
        "tensor `input.weight` is F32 [16, 3], expected F32 [16, 6]"
    );
    let normalisation = json!({"motor_min": [0.0, 1.1], "motor_max": [1.0, 1.0], "scale": 0.4});
    let provenance = json!({"subject": null, "normalisation": normalisation});
    assert_eq!(
        content("provenance", provenance),
        "header `tdcr`: motor 2 runs from 1.1 to 1, expected min <= max, finite"
    );
    let reach = json!({"min": [0.5, 0.0, 0.0], "max": [0.0, 1.0, 1.0]});
    assert_eq!(
        content("reach", reach),
        "header `tdcr`: the data reach from [0.5, 0.0, 0.0] to [0.0, 1.0, 1.0], expected min <= max, finite"
    );
    assert_eq!(
        content("uncertainty_factor", json!(-1.0)),
        "header `tdcr`: uncertainty_factor is -1, expected 0 or more"
    );
    let last = content("refined", json!(true));
    assert!(last.starts_with("no tensor `refinement."), "{last}");
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

#[test]
fn uncertainty_is_the_spread_of_all_samples_about_each_point() {
    let (model, _folder) = model();
    let predict = |points, seed| {
        let predicted = model.predict(&[0.02, 0.02], points, seed, &Sampler::default());
        predicted.unwrap()
    };
    let (first, second) = (predict(200, 1), predict(300, 2));
    let alone = first.uncertainty(&[]).unwrap();
    assert_eq!(alone, surface_spread(&first.points, &first.points).unwrap());
    let pool = [first.points.clone(), second.points.clone()].concat();
    let pooled = first.uncertainty(&[second]).unwrap();
    assert_eq!(pooled, surface_spread(&first.points, &pool).unwrap());
    assert_ne!(pooled, alone);
}

#[test]
fn few_points_have_no_uncertainty() {
    let (model, _folder) = model();
    let predict = |points| {
        let predicted = model.predict(&[0.02, 0.02], points, 0, &Sampler::default());
        predicted.unwrap()
    };
    assert_eq!(predict(15).uncertainty(&[]), None);
    assert!(predict(15).uncertainty(&[predict(1)]).is_some());
    let mut broken = predict(16);
    broken.points[3][1] = f32::INFINITY;
    assert_eq!(broken.uncertainty(&[]), None);
}
