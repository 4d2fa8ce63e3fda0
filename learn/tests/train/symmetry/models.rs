//! Models that learned representatives: what they predict, their files, what may start at them, and what it is good for.

use std::iter::zip;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_learn::data::{CloudSet, Condition, Normalisation, Sample, Simulator};
use tdcr_learn::flow::{Method, Sampler, Stream, TimeGrid, rng};
use tdcr_learn::metrics::chamfer;
use tdcr_learn::net::{Channels, MlpShape, Network, TimeFeatures};
use tdcr_learn::symmetry::{Reduction, SymmetryUse};
use tdcr_learn::train::{Model, Provenance, Start, TrainSettings, Trainer};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::Robot;
use tdcr_sim::symmetry::Symmetries;

use super::{assert_near, in_one_view, of_2m, recipe, units};

const SHAPE: MlpShape = MlpShape {
    width: 16,
    depth: 2,
    embedding: 8,
    condition_dim: 6,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

fn provenance(reduction: Reduction) -> Provenance {
    Provenance {
        subject: None,
        normalisation: units(),
        reduction,
    }
}

/// A network of random weights.
fn model(reduction: Reduction) -> Model {
    let shape = MlpShape {
        condition_dim: 6 + reduction.view_numbers(),
        condition_blocks: 0,
        octaves: 0,
        time_features: TimeFeatures::Plain,
        ..SHAPE
    };
    Model {
        provenance: provenance(reduction),
        settings: TrainSettings::default(),
        step: 0,
        validation_distance: 0.0,
        refinement: None,
        reach: None,
        uncertainty_factor: None,
        network: Network::new(shape, &mut rng(3, Stream::Parameters)).unwrap(),
    }
}

#[test]
fn predictions_are_equivariant() {
    let model = model(in_one_view(of_2m()));
    let predict = |command: &[f64]| {
        model
            .predict(command, 200, 5, &Sampler::default())
            .unwrap()
            .points
    };
    let command = [0.03, 0.01, 0.02, 0.0, 0.02, 0.015];
    let cloud = predict(&command);
    for symmetry in model.provenance.reduction.symmetries().elements() {
        let mut expected = cloud.clone();
        symmetry.move_points(&mut expected, 1.0);
        let found = predict(&symmetry.command(&command));
        assert_near(found.as_flattened(), expected.as_flattened());
    }
    // Of a model without symmetries they are not.
    let plain = self::model(Reduction::default());
    let predict = |command: &[f64]| {
        plain
            .predict(command, 200, 5, &Sampler::default())
            .unwrap()
            .points
    };
    let image = predict(&of_2m().elements()[1].command(&command));
    let mut moved = predict(&command);
    of_2m().elements()[1].move_points(&mut moved, 1.0);
    assert!(chamfer(&image, &moved).unwrap() > 1e-6);
}

#[test]
fn a_model_file_keeps_its_symmetries_and_older_ones_have_none() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.safetensors");
    let same = of_2m().subgroup(|one| one.tendons[0] == 0);
    let with = model(Reduction::new(of_2m(), &same));
    assert_eq!(with.provenance.reduction.view_numbers(), 3);
    with.save(&file).unwrap();
    let loaded = Model::load(&file).unwrap();
    assert_eq!(loaded.provenance, with.provenance);
    let command = [0.03, 0.01, 0.02, 0.0, 0.02, 0.015];
    let predict = |model: &Model| model.predict(&command, 50, 0, &Sampler::default()).unwrap();
    assert_eq!(predict(&loaded), predict(&with));

    // As a version before symmetries wrote it: a file of none differs in the settings alone.
    model(Reduction::default()).save(&file).unwrap();
    let bytes = std::fs::read(&file).unwrap();
    let (length, rest) = bytes.split_at(8);
    let length = u64::from_le_bytes(length.try_into().unwrap()) as usize;
    let (header, tensors) = rest.split_at(length);
    let header = String::from_utf8(header.to_vec()).unwrap();
    assert!(!header.contains("reduction"));
    let old = header.replace(r#"\"symmetry\":\"auto\","#, "");
    assert!(old.len() < header.len());
    let length = (old.len() as u64).to_le_bytes();
    std::fs::write(&file, [&length, old.as_bytes(), tensors].concat()).unwrap();
    let loaded = Model::load(&file).unwrap();
    assert!(loaded.provenance.reduction.is_trivial());
    assert_eq!(loaded.settings.symmetry, SymmetryUse::None);

    let mut damaged = with;
    damaged.provenance.normalisation.motor_min.pop();
    damaged.provenance.normalisation.motor_max.pop();
    let shape = MlpShape {
        condition_dim: 5 + 3,
        condition_blocks: 0,
        octaves: 0,
        time_features: TimeFeatures::Plain,
        ..SHAPE
    };
    damaged.network = Network::new(shape, &mut rng(3, Stream::Parameters)).unwrap();
    damaged.save(&file).unwrap();
    let said = Model::load(&file).unwrap_err().to_string();
    assert!(
        said.contains("no permutation of at most 5 tendons"),
        "{said}"
    );
}

#[test]
fn a_run_starts_at_a_model_of_its_symmetries_or_of_fewer() {
    let all = of_2m();
    let turns = all.subgroup(|one| !one.is_reflection());
    let in_views = Reduction::new(turns.clone(), &Symmetries::default());
    let none = Reduction::default();
    let (all, turns) = (in_one_view(all), in_one_view(turns));
    let start = |of_model: &Reduction, of_data: &Reduction| {
        let model = model(of_model.clone());
        let shape = model.network.shape();
        let started = Start::at(&model, shape, &provenance(of_data.clone()));
        started.map(drop).map_err(|error| error.to_string())
    };
    for (of_model, of_data) in [
        (&none, &all),
        (&turns, &all),
        (&all, &all),
        (&none, &none),
        (&in_views, &in_views),
    ] {
        assert_eq!(start(of_model, of_data), Ok(()));
    }
    assert_eq!(
        start(&all, &turns).unwrap_err(),
        "the run cannot start at the weights of this model: its symmetry is 6 tendon permutations (3 rotations, 3 \
         reflections), expected the data's 3 tendon permutations (3 rotations, 0 reflections)"
    );
    for (of_model, of_data) in [(&turns, &none), (&in_views, &turns), (&turns, &in_views)] {
        assert!(start(of_model, of_data).is_err());
    }
}

/// Few clouds of a robot of one module, which teach more where each stands for six.
#[test]
#[allow(clippy::print_stdout, reason = "figures to be read")]
fn representatives_teach_more_than_as_many_commands() {
    let mut recipe = recipe("2m", BaseVisibility::Hidden);
    recipe.subject.robot.modules.truncate(1);
    let robot = Robot::new(recipe.subject.robot.clone()).unwrap();
    let reduction = recipe.symmetries(Channels::Xyz).unwrap().reduction();
    assert_eq!(reduction.symmetries().elements().len(), 6);
    let mut simulator = Simulator::new(&robot, &recipe);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut sample = |_| {
        let command = robot.random_command(&mut rng);
        let condition = Condition {
            motors: command
                .as_slice()
                .iter()
                .map(|&value| value as f32)
                .collect(),
            payload: None,
        };
        let cloud: PointCloud = simulator.cloud(&condition, 256, &mut rng).unwrap();
        Sample { condition, cloud }
    };
    let samples: Vec<Sample> = (0..40).map(&mut sample).collect();
    let units = Normalisation {
        motor_min: vec![0.0; 3],
        motor_max: vec![0.04; 3],
        scale: 0.3,
    };
    let trained = |reduction: &Reduction| {
        let sets = [&samples[..8], &samples[8..]].map(|samples| {
            let mut set = CloudSet {
                condition_dim: 3,
                points_per_cloud: 256,
                conditions: vec![0.0; 3 * samples.len()],
                points: samples
                    .iter()
                    .flat_map(|s| s.cloud.points.as_flattened().to_vec())
                    .collect(),
                colors: None,
                starts: None,
            };
            let mut conditions: Vec<Condition> =
                samples.iter().map(|s| s.condition.clone()).collect();
            for (row, condition) in zip(set.conditions.chunks_exact_mut(3), &conditions) {
                row.copy_from_slice(&units.condition(&condition.to_vec()).unwrap());
            }
            units.normalise_points(&mut set.points);
            reduction.set(&mut set, &mut conditions, &units).unwrap();
            set
        });
        let shape = MlpShape {
            width: 48,
            depth: 3,
            embedding: 32,
            condition_dim: 3 + reduction.view_numbers(),
            condition_blocks: 0,
            octaves: 0,
            time_features: TimeFeatures::Plain,
            channels: Channels::Xyz,
        };
        let settings = TrainSettings {
            steps: 500,
            clouds: 32,
            points: 64,
            warmup_steps: 50,
            validation_clouds: 32,
            validation_points: 256,
            sampler: Sampler {
                method: Method::Heun,
                steps: 8,
                grid: TimeGrid::Power(2.0),
                ..Sampler::PAPER
            },
            ..TrainSettings::default()
        };
        let mut trainer = Trainer::new(shape, settings, &sets[0], &sets[1]).unwrap();
        while !trainer.is_finished() {
            trainer.step().unwrap();
        }
        trainer.validate(&|a, b| chamfer(a, b).unwrap()).unwrap()
    };
    let (with, without) = (trained(&reduction), trained(&Reduction::default()));
    eprintln!("{with:e} with symmetries, {without:e} without");
    assert!(with < 0.8 * without, "{with} with, {without} without");
}
