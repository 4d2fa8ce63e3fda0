//! Files of the learner: models and states of training.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use tdcr::learn::data::{CloudSet, Normalisation, Subject};
use tdcr::learn::flow::Reach;
use tdcr::learn::net::{Channels, MlpShape, Network, TimeFeatures};
use tdcr::learn::symmetry::Reduction;
use tdcr::learn::train::{Model, Provenance, TrainSettings, Trainer};
use tdcr::sim::render::BaseVisibility;
use tdcr::sim::scene::Scene;

use super::files::{json_of, two_modules};

pub const SHAPE: MlpShape = MlpShape {
    width: 4,
    depth: 2,
    embedding: 4,
    condition_dim: 6,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

pub fn provenance() -> Provenance {
    Provenance {
        subject: Some(Subject {
            robot: two_modules(),
            base: BaseVisibility::Hidden,
            payload: None,
            scene: Scene::default(),
            obstacles: None,
        }),
        normalisation: Normalisation {
            motor_min: vec![0.0; 6],
            motor_max: vec![0.04; 6],
            scale: 0.4,
        },
        reduction: Reduction::default(),
    }
}

/// What `save` writes to a file.
pub fn saved(save: impl FnOnce(&Path)) -> Vec<u8> {
    let file = tempfile::NamedTempFile::new().expect("a file can be made");
    save(file.path());
    std::fs::read(file.path()).expect("a file can be read")
}

pub fn model() -> Vec<u8> {
    let network = Network::new(SHAPE, &mut ChaCha8Rng::seed_from_u64(0));
    let network = network.expect("a network of a sound shape");
    let model = Model {
        provenance: provenance(),
        settings: TrainSettings::default(),
        step: 3,
        validation_distance: 0.1,
        refinement: Some(network.clone()),
        network,
        reach: Some(Reach::NORMALISED),
        uncertainty_factor: Some(2.5),
    };
    saved(|path| model.save(path).expect("a file can be written"))
}

pub fn training_state() -> Vec<u8> {
    let set = CloudSet {
        condition_dim: 6,
        points_per_cloud: 4,
        conditions: vec![0.5; 60],
        points: vec![0.25; 120],
        colors: None,
        starts: None,
    };
    let settings = TrainSettings {
        points: 4,
        validation_clouds: 2,
        validation_points: 4,
        ..TrainSettings::default()
    };
    let trainer = Trainer::new(SHAPE, settings, &set, &set);
    let state = trainer.expect("a run can start").state(provenance());
    saved(|path| state.save(path).expect("a file can be written"))
}

/// The file for `name` with a header of the widest network, and the tensors of a small one.
pub fn wide(name: &str) -> Vec<u8> {
    let whole = match name {
        "model" => model(),
        _ => training_state(),
    };
    // The header of the file, JSON, holds the program's own as a string.
    let (head, rest) = whole.split_at(8);
    let mut header: Value = serde_json::from_slice(&rest[..length_of(head)]).expect("a header");
    let own = header["__metadata__"]["tdcr"].as_str().expect("a string");
    let mut own: Value = serde_json::from_str(own).expect("a header");
    for (field, size) in [("width", 8192), ("depth", 64)] {
        own["content"]["shape"][field] = size.into();
    }
    header["__metadata__"]["tdcr"] = own.to_string().into();
    let header = json_of(&header);
    let length = (header.len() as u64).to_le_bytes();
    [&length, &header[..], &rest[length_of(head)..]].concat()
}

/// Length of a header (bytes), of which the first eight bytes of a file tell.
pub fn length_of(head: &[u8]) -> usize {
    u64::from_le_bytes(head.try_into().expect("8 bytes")) as usize
}
