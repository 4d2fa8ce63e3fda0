//! Training the hybrid network: it learns, resumes, and its files hold it.

use tdcr_learn::flow::Sampler;
use tdcr_learn::net::{ContextLayers, ContextShape, HybridShape, Stage, TimeGate};
use tdcr_learn::train::{Model, TrainSettings, Trainer, TrainingState};
use tempfile::TempDir;

use crate::toy::{
    COLORED, SHAPE, bars, colored_bars, first_and_last, learning, provenance, run, settings,
};

const fn hybrid() -> HybridShape {
    const fn stage(channels: usize, resolution: usize) -> Stage {
        Stage {
            channels,
            resolution,
        }
    }
    HybridShape {
        head: SHAPE,
        context: ContextShape {
            layers: ContextLayers::Residual,
            stages: [stage(8, 4), stage(8, 3), stage(8, 2)],
            blocks: 1,
            joined: 8,
            features: 4,
            gate: TimeGate {
                centre: 0.5,
                steepness: 8.0,
            },
        },
    }
}

#[test]
fn training_lowers_the_loss_and_the_validation_distance() {
    let (training, validation) = (bars(32, 1), bars(8, 2));
    let trainer = Trainer::new(hybrid(), learning(300), &training, &validation).unwrap();
    let trainer = run(trainer, 300);
    let (first, last) = first_and_last(trainer.losses());
    assert!(last < 0.7 * first, "loss {first} to {last}");
    let (first, last) = (trainer.validations()[0].1, trainer.validations()[2].1);
    assert!(last < 0.05 && last < first, "distance {first} to {last}");
}

#[test]
fn colours_are_learned_beside_the_context() {
    let (training, validation) = (colored_bars(32, 1), colored_bars(8, 2));
    let shape = HybridShape {
        head: COLORED,
        ..hybrid()
    };
    let settings = TrainSettings {
        validate_every: 3,
        validation_clouds: 2,
        color_weight: 1.0,
        ..learning(200)
    };
    let trainer = Trainer::new(shape, settings, &training, &validation).unwrap();
    let trainer = run(trainer, 200);
    let (first, last) = first_and_last(trainer.losses());
    assert!(last < 0.7 * first, "loss {first} to {last}");
    let model = trainer.model(provenance()).unwrap();
    let cloud = model
        .predict(&[0.02, 0.02], 50, 7, &Sampler::default())
        .unwrap();
    assert_eq!(cloud.colors.unwrap().len(), cloud.points.len());
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one_bit_for_bit() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("state.safetensors");
    let start = || Trainer::new(hybrid(), settings(), &training, &validation).unwrap();
    let whole = run(start(), 8).state(provenance());
    run(start(), 5).state(provenance()).save(&file).unwrap();
    let state = TrainingState::load(&file).unwrap();
    let resumed = Trainer::resume(state, hybrid(), settings(), &training, &validation).unwrap();
    assert_eq!(run(resumed, 8).state(provenance()), whole);
}

#[test]
fn a_saved_model_predicts_the_same_cloud() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("model.safetensors");
    let trainer = Trainer::new(hybrid(), settings(), &training, &validation).unwrap();
    let model = run(trainer, 3).model(provenance()).unwrap();
    model.save(&file).unwrap();
    let predict = |model: &Model| {
        model
            .predict(&[0.02, 0.02], 50, 7, &Sampler::default())
            .unwrap()
    };
    assert_eq!(predict(&Model::load(&file).unwrap()), predict(&model));
}

#[test]
fn a_network_of_another_kind_is_refused() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let trainer = Trainer::new(hybrid(), settings(), &training, &validation).unwrap();
    let state = trainer.state(provenance());
    let error = Trainer::resume(state, SHAPE, settings(), &training, &validation).unwrap_err();
    assert!(
        error.to_string().contains("shape.channels was null"),
        "{error}"
    );
}
