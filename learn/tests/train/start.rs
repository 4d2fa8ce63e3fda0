//! Where the weights of a run start: at random, or at those of a network.

use std::fs;
use std::path::Path;

use tdcr_learn::data::Normalisation;
use tdcr_learn::flow::{Method, Sampler};
use tdcr_learn::net::{MlpShape, Network};
use tdcr_learn::train::{
    Feed, Model, Provenance, Start, Target, Teacher, TrainSettings, Trainer, TrainingState,
};
use tempfile::TempDir;

use crate::toy::{SHAPE, bars, provenance, run, settings};

/// A model of a run of 12 steps.
fn model(seed: u64) -> Model {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let settings = TrainSettings { seed, ..settings() };
    let trainer = Trainer::new(SHAPE, settings, &training, &validation).unwrap();
    run(trainer, 12).model(provenance()).unwrap()
}

/// Another run's settings.
fn lower_rate() -> TrainSettings {
    TrainSettings {
        learning_rate: 1e-3,
        ..settings()
    }
}

#[test]
fn a_run_starts_at_the_weights_of_the_network_that_it_is_given() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let network = &model(0).network;
    let state = |trainer: Trainer| trainer.state(provenance());
    let given = state(Trainer::new(network, lower_rate(), &training, &validation).unwrap());
    assert_eq!(given.params, network.params());
    assert_eq!(given.average, network.params());
    assert!(given.first_moment.iter().all(|moment| *moment == 0.0));
    let random = state(Trainer::new(SHAPE, lower_rate(), &training, &validation).unwrap());
    assert_ne!(given.params, random.params);
}

#[test]
fn a_resumed_run_from_a_network_ends_as_if_it_had_not_been_left() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let network = &model(0).network;
    let start = || Trainer::new(network, lower_rate(), &training, &validation).unwrap();
    let whole = run(start(), 12).state(provenance());
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("state.safetensors");
    run(start(), 7).state(provenance()).save(&file).unwrap();
    let half = TrainingState::load(&file).unwrap();
    let again = Trainer::resume(half, network, lower_rate(), &training, &validation).unwrap();
    assert_eq!(run(again, 12).state(provenance()), whole);
}

#[test]
fn a_run_is_not_resumed_from_another_start() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let [network, other] = [0, 1].map(|seed| model(seed).network);
    let state = |start: Start| {
        let trainer = Trainer::new(start, settings(), &training, &validation).unwrap();
        run(trainer, 3).state(provenance())
    };
    let refused = |state: TrainingState, start: Start| {
        let resumed = Trainer::resume(state, start, settings(), &training, &validation);
        resumed.unwrap_err().to_string()
    };
    let said = refused(state(Start::from(&network)), SHAPE.into());
    let head = "the training state is of another run: the start of the weights was \"network ";
    assert!(
        said.starts_with(head) && said.ends_with(", expected \"random\""),
        "{said}"
    );
    let said = refused(state(SHAPE.into()), Start::from(&network));
    assert!(
        said.contains("was \"random\", expected \"network "),
        "{said}"
    );
    let said = refused(state(Start::from(&other)), Start::from(&network));
    assert!(
        said.starts_with(head) && said.contains("expected \"network "),
        "{said}"
    );
}

#[test]
fn a_model_of_other_weights_or_units_is_no_start_and_says_why() {
    let model = model(0);
    assert!(Start::at(&model, SHAPE.into(), &provenance()).is_ok());
    let refused = |model: &Model, shape: MlpShape, provenance: &Provenance| {
        let error = Start::at(model, shape.into(), provenance).unwrap_err();
        let said = error.to_string();
        let head = "the run cannot start at the weights of this model: its ";
        said.strip_prefix(head).expect(&said).to_owned()
    };
    let wide = MlpShape { width: 17, ..SHAPE };
    assert_eq!(
        refused(&model, wide, &provenance()),
        "shape.width is 16, expected 17"
    );
    let larger = Provenance {
        normalisation: Normalisation {
            scale: 0.5,
            ..provenance().normalisation
        },
        ..provenance()
    };
    assert_eq!(
        refused(&model, SHAPE, &larger),
        "normalisation.scale is 0.4, expected 0.5"
    );
    let student = Model {
        settings: TrainSettings {
            target: Target::Steps,
            ..settings()
        },
        ..model
    };
    assert_eq!(
        refused(&student, SHAPE, &provenance()),
        "target is \"steps\", expected \"velocity\""
    );
}

/// Rewrites a file's header as a version before couplings and starts would have written it.
fn make_old(file: &Path) {
    let bytes = fs::read(file).unwrap();
    let (length, rest) = bytes.split_at(8);
    let length = u64::from_le_bytes(length.try_into().unwrap()) as usize;
    let (header, tensors) = rest.split_at(length);
    let mut header = String::from_utf8(header.to_vec()).unwrap();
    let mut remove = |from: &str, to: &str| {
        let start = header.find(from).expect(from);
        let end = start + header[start..].find(to).expect(to);
        header.replace_range(start..end, "");
    };
    remove(r#"\"coupling\":\"#, r#"\"prior_deviation"#);
    if file.ends_with("state") {
        remove(r#"\"initial\":"#, r#"\"provenance"#);
    }
    let length = (header.len() as u64).to_le_bytes();
    fs::write(file, [&length, header.as_bytes(), tensors].concat()).unwrap();
}

#[test]
fn runs_and_models_older_than_couplings_and_starts_are_resumed() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("state");
    let resumed = |trainer: Trainer| {
        let trainer = run(trainer, 3);
        trainer.state(provenance()).save(&file).unwrap();
        make_old(&file);
        TrainingState::load(&file).unwrap()
    };
    let random = resumed(Trainer::new(SHAPE, settings(), &training, &validation).unwrap());
    assert!(Trainer::resume(random, SHAPE, settings(), &training, &validation).is_ok());

    let few = Sampler {
        method: Method::Euler,
        steps: 3,
        ..Sampler::PAPER
    };
    let distillation = TrainSettings {
        sampler: few,
        target: Target::Steps,
        ..settings()
    };
    let teacher = model(0);
    let feed = || Feed::Teacher(Box::new(Teacher::new(&teacher).unwrap()));
    let start = || Start::from(&teacher.network);
    let student =
        resumed(Trainer::new(start(), distillation.clone(), feed(), &validation).unwrap());
    assert!(Trainer::resume(student, start(), distillation, feed(), &validation).is_ok());

    let file = folder.path().join("model");
    teacher.save(&file).unwrap();
    make_old(&file);
    let old = Model::load(&file).unwrap();
    assert_eq!(old.settings, teacher.settings);
    let params = |network: &Network| network.params().to_vec();
    assert_eq!(params(&old.network), params(&teacher.network));
}
