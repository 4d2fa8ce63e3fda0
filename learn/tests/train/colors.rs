//! Training on points with colours.

use tdcr_learn::data::CloudSet;
use tdcr_learn::flow::Sampler;
use tdcr_learn::net::{Channels, MlpShape};
use tdcr_learn::train::{Model, TrainSettings, Trainer, TrainingState};
use tempfile::TempDir;

use crate::toy::{COLORED, LARGER, SHAPE, bars, colored_bars, learning, provenance, run, settings};

#[test]
fn the_command_tells_the_colour() {
    let (training, validation) = (colored_bars(64, 1), colored_bars(8, 2));
    let settings = TrainSettings {
        validate_every: 200,
        color_weight: 1.0,
        ..learning(600)
    };
    let shape = MlpShape {
        channels: Channels::XyzRgb,
        ..LARGER
    };
    let trainer = Trainer::new(shape, settings, &training, &validation).unwrap();
    let trainer = run(trainer, 600);
    let distance = trainer.validations()[2].1;
    assert!(distance < 0.02, "{distance}");
    let model = trainer.model(provenance()).unwrap();
    for (command, expected) in [
        ([0.01, 0.025], [0.25, 0.75, 0.5]),
        ([0.03, 0.015], [0.75, 0.25, 0.5]),
    ] {
        let cloud = model
            .predict(&command, 200, 3, &Sampler::default())
            .unwrap();
        let colors = cloud.colors.unwrap();
        for (channel, expected) in expected.into_iter().enumerate() {
            let values = colors.iter().map(|color| f64::from(color[channel]) / 255.0);
            let error = values.map(|value| (value - expected).abs()).sum::<f64>() / 200.0;
            assert!(error < 0.08, "channel {channel} under {command:?}: {error}");
        }
    }
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one_bit_for_bit() {
    let (training, validation) = (colored_bars(5, 1), colored_bars(3, 2));
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("run.safetensors");
    let start = || Trainer::new(COLORED, settings(), &training, &validation).unwrap();
    let whole = run(start(), 12).state(provenance());
    run(start(), 7).state(provenance()).save(&file).unwrap();
    let loaded = TrainingState::load(&file).unwrap();
    let resumed = Trainer::resume(loaded, COLORED, settings(), &training, &validation).unwrap();
    assert_eq!(run(resumed, 12).state(provenance()), whole);

    let mut recolored = training.clone();
    recolored.colors.as_mut().unwrap()[0] ^= 1;
    let error = Trainer::resume(whole, COLORED, settings(), &recolored, &validation).unwrap_err();
    assert!(
        error.to_string().contains("training set's fingerprint"),
        "{error}"
    );
}

#[test]
fn a_saved_model_predicts_the_same_colours() {
    let (training, validation) = (colored_bars(5, 1), colored_bars(3, 2));
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("model.safetensors");
    let trainer = Trainer::new(COLORED, settings(), &training, &validation).unwrap();
    let model = run(trainer, 3).model(provenance()).unwrap();
    model.save(&file).unwrap();
    let predict = |model: &Model| {
        model
            .predict(&[0.02, 0.02], 50, 7, &Sampler::default())
            .unwrap()
    };
    let loaded = Model::load(&file).unwrap();
    assert_eq!(loaded.network.shape().channels(), Channels::XyzRgb);
    assert_eq!(predict(&loaded), predict(&model));
    assert_eq!(predict(&model).colors.map(|colors| colors.len()), Some(50));
}

#[test]
fn sets_without_colours_are_refused() {
    let refused = |training: &CloudSet, validation: &CloudSet| {
        Trainer::new(COLORED, settings(), training, validation)
            .unwrap_err()
            .to_string()
    };
    let (plain, good) = (bars(5, 1), colored_bars(5, 1));
    let missing = "set: positions alone, expected colours too";
    assert_eq!(refused(&plain, &good), format!("training {missing}"));
    assert_eq!(refused(&good, &plain), format!("validation {missing}"));
    let mut bad = good.clone();
    bad.colors.as_mut().unwrap().fill(128);
    assert_eq!(
        refused(&bad, &good),
        "training set: all points have the colour [128, 128, 128], expected several: clouds that are imported without \
         colours are grey"
    );
    bad.colors.as_mut().unwrap().pop();
    assert_eq!(
        refused(&bad, &good),
        "training set: 599 colour values, expected 600"
    );
}

#[test]
fn a_network_of_positions_does_not_see_the_colours() {
    let losses = |training: &CloudSet, validation: &CloudSet| {
        let trainer = Trainer::new(SHAPE, settings(), training, validation).unwrap();
        run(trainer, 12).losses().to_vec()
    };
    let plain = losses(&bars(5, 1), &bars(3, 2));
    assert_eq!(losses(&colored_bars(5, 1), &colored_bars(3, 2)), plain);
}
