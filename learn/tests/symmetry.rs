//! A robot's symmetries in what cameras see of it, and learning by one representative of each class.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::iter::zip;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_learn::data::{
    CloudSet, Condition, Normalisation, PayloadRange, Recipe, Sample, SimStream, Simulator,
    StreamSpec, Subject,
};
use tdcr_learn::flow::{Method, Sampler, Stream, TimeGrid, rng};
use tdcr_learn::metrics::chamfer;
use tdcr_learn::net::{Channels, MlpShape, Network};
use tdcr_learn::symmetry::{Agreement, Loss, Reduction, SymmetryUse};
use tdcr_learn::train::{Model, Provenance, Start, StreamWindow, TrainSettings, Trainer};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::render::{BaseVisibility, Sensor};
use tdcr_sim::robot::{Aim, CameraSpec, Cameras, Lens, RingSpec, Robot, RobotSpec};
use tdcr_sim::symmetry::Symmetries;

/// A recipe of a robot of the paper, seen in small pictures.
fn recipe(name: &str, base: BaseVisibility) -> Recipe {
    let mut robot = RobotSpec::standard(name).unwrap();
    if let Cameras::Ring(ring) = &mut robot.cameras {
        ring.resolution = [640, 360];
    }
    Recipe {
        subject: Subject {
            robot,
            base,
            payload: None,
        },
        ..Recipe::default()
    }
}

fn ring(recipe: &mut Recipe) -> &mut RingSpec {
    match &mut recipe.subject.robot.cameras {
        Cameras::Ring(ring) => ring,
        Cameras::Free(_) => unreachable!("the paper's robots have rings"),
    }
}

fn of_2m() -> Symmetries {
    Robot::load("2m").unwrap().symmetries()
}

#[test]
fn clouds_of_the_papers_robots_have_their_symmetries() {
    for base in [BaseVisibility::Hidden, BaseVisibility::Shown] {
        let mut recipe = recipe("2m", base);
        let seen = recipe.symmetries(Channels::Xyz).unwrap();
        assert_eq!((seen.symmetries.elements().len(), seen.lost), (6, None));
        assert!(
            seen.views
                .iter()
                .all(|view| view.1.positions > 0.9 && view.1.colors.is_none())
        );
        // The paper's 8 cameras are mirrored into each other by one reflection, and turned by 120 degrees stand elsewhere.
        assert_eq!(
            seen.to_string(),
            "6 tendon permutations (3 rotations, 3 reflections), seen in 3 views"
        );
        assert_eq!(seen.reduction().view_numbers(), 3);
        recipe.subject.payload = Some(PayloadRange {
            min: 0.0,
            max: 0.03,
        });
        recipe.sensor = Some(Sensor::d435());
        let seen = recipe.symmetries(Channels::Xyz).unwrap();
        assert_eq!(seen.symmetries.elements().len(), 6, "{seen}");
    }
}

#[test]
fn cameras_that_do_not_look_from_all_sides_break_symmetries_and_it_is_said() {
    // Six cameras have all the symmetries of the triangle, three are mirrored into other places.
    let mut six = recipe("2m", BaseVisibility::Hidden);
    ring(&mut six).count = 6;
    let seen = six.symmetries(Channels::Xyz).unwrap();
    assert!(
        seen.views.iter().all(|view| view.1.positions < 1.1),
        "{seen:?}"
    );
    assert_eq!(seen.reduction().view_numbers(), 0);

    let mut three = recipe("2m", BaseVisibility::Hidden);
    (ring(&mut three).count, ring(&mut three).resolution) = (3, [1280, 720]);
    let seen = three.symmetries(Channels::Xyz).unwrap();
    let counted =
        "3 tendon permutations (3 rotations, 0 reflections); no more because the cameras do not";
    assert!(seen.to_string().starts_with(counted), "{seen}");

    let mut one_side = recipe("2m", BaseVisibility::Hidden);
    let camera = |x: f64| CameraSpec {
        position: [x, -0.5, 0.3],
        aim: Aim::At([0.0, 0.0, 0.25]),
        lens: Lens::Fovy(45.0),
        resolution: [640, 360],
        distortion: None,
    };
    one_side.subject.robot.cameras = Cameras::Free([-0.1, 0.2].map(camera).to_vec());
    let seen = one_side.symmetries(Channels::Xyz).unwrap();
    assert!(seen.symmetries.is_trivial());
    assert!(
        matches!(seen.lost, Some(Loss::Positions(floors)) if floors > 4.0),
        "{seen}"
    );
    assert!(
        seen.to_string()
            .starts_with("none, because the cameras do not see"),
        "{seen}"
    );
}

#[test]
fn colours_that_show_where_cameras_are_break_symmetries_where_they_are_learned() {
    let seen = recipe("2m", BaseVisibility::Hidden)
        .symmetries(Channels::XyzRgb)
        .unwrap();
    assert!(
        matches!(seen.lost, Some(Loss::Colors(floors)) if floors > 1.75),
        "{seen}"
    );
    // The mirror image is seen by the mirrored cameras; a turn is not.
    assert!(seen.symmetries.elements().len() <= 2, "{seen}");
}

#[test]
fn a_base_in_sight_that_is_less_symmetric_takes_symmetries() {
    let mut recipe = recipe("2m", BaseVisibility::Shown);
    let robot = &mut recipe.subject.robot;
    robot.base.orientation = [1.0, 0.0, 0.0, 0.0];
    let turned = |[x, y]: [f64; 2]| {
        let (sin, cos) = 0.2_f64.sin_cos();
        [cos * x - sin * y, sin * x + cos * y]
    };
    let holes = [[0.0125, 0.0], [-0.00625, 0.010825], [-0.00625, -0.010825]].map(turned);
    let holes = tdcr_sim::robot::Holes::At(holes.to_vec());
    robot.base.holes = holes.clone();
    for module in &mut robot.modules {
        module.holes = holes.clone();
    }
    let seen = recipe.symmetries(Channels::Xyz).unwrap();
    assert_eq!(
        (seen.symmetries.elements().len(), seen.lost),
        (3, Some(Loss::Base))
    );
    // A stiffer module is symmetric, a robot on its side is not.
    recipe.subject.robot.gravity = [0.0, 9.81, 0.0];
    let seen = recipe.symmetries(Channels::Xyz).unwrap();
    assert_eq!(seen.to_string(), "none, because the robot has none");
}

/// Samples of 2m, and the same under one of its symmetries.
fn samples_and_images(index: usize) -> [Vec<Sample>; 2] {
    let spec = StreamSpec {
        recipe: recipe("2m", BaseVisibility::Hidden),
        points: 300,
        seed: 4,
    };
    let samples: Vec<Sample> = (SimStream::open(&spec, 0, 2, 4).unwrap())
        .take(3)
        .map(Result::unwrap)
        .collect();
    let symmetries = of_2m();
    let symmetry = &symmetries.elements()[index];
    let image = |sample: &Sample| {
        let mut cloud = sample.cloud.clone();
        symmetry.move_points(&mut cloud.points, 1.0);
        let values = symmetry.command(&sample.condition.to_vec());
        Sample {
            condition: Condition {
                motors: values.iter().map(|&value| value as f32).collect(),
                payload: None,
            },
            cloud,
        }
    };
    let images = samples.iter().map(image).collect();
    [samples, images]
}

fn units() -> Normalisation {
    Normalisation {
        motor_min: vec![0.0; 6],
        motor_max: vec![0.04; 6],
        scale: 0.4,
    }
}

fn set_of(samples: &[Sample]) -> (CloudSet, Vec<Condition>) {
    let units = units();
    let conditions: Vec<Condition> = samples.iter().map(|s| s.condition.clone()).collect();
    let normalised = conditions
        .iter()
        .flat_map(|c| units.condition(&c.to_vec()).unwrap());
    let mut points: Vec<f32> = (samples.iter())
        .flat_map(|sample| sample.cloud.points.as_flattened().to_vec())
        .collect();
    units.normalise_points(&mut points);
    let set = CloudSet {
        condition_dim: 6,
        points_per_cloud: samples[0].cloud.len(),
        conditions: normalised.collect(),
        starts: Some(points.clone()),
        points,
        colors: None,
    };
    (set, conditions)
}

fn assert_near(a: &[f32], b: &[f32]) {
    assert_eq!(a.len(), b.len());
    let largest = zip(a, b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-6, "{largest}");
}

#[test]
fn a_set_and_its_image_have_the_same_representatives() {
    let reduction = in_one_view(of_2m());
    for index in 1..6 {
        let [of_samples, of_images] = samples_and_images(index).map(|samples| {
            let (mut set, mut conditions) = set_of(&samples);
            reduction.set(&mut set, &mut conditions, &units()).unwrap();
            for (sample, (k, condition)) in zip(&samples, conditions.iter().enumerate()) {
                let (moved, told) = reduction.sample(sample.clone(), &units()).unwrap();
                assert_eq!(moved.condition, *condition);
                assert_eq!(set.condition(k), told);
                let mut points = moved.cloud.points.into_flattened();
                units().normalise_points(&mut points);
                assert_near(set.cloud(k), &points);
            }
            (set, conditions)
        });
        assert_eq!(of_samples.1, of_images.1);
        assert!(of_samples.1.iter().all(|c| c.motors[..3].is_sorted()));
        assert_eq!(of_samples.0.conditions, of_images.0.conditions);
        assert_near(&of_samples.0.points, &of_images.0.points);
        assert_near(
            of_samples.0.starts.as_deref().unwrap(),
            of_images.0.starts.as_deref().unwrap(),
        );
    }
}

#[test]
fn a_stream_of_representatives_is_that_of_its_samples() {
    let spec = StreamSpec {
        recipe: recipe("2m", BaseVisibility::Hidden),
        points: 200,
        seed: 1,
    };
    let window = || StreamWindow::new(spec.clone(), 4, 1, 2, Channels::Xyz).unwrap();
    let plain = window().validation(2).unwrap();
    let reduction = Reduction::new(of_2m(), &Symmetries::default());
    let reduced = window().with_reduction(reduction.clone());
    let units = reduced.normalisation().clone();
    let reduced = reduced.validation(2).unwrap();
    let samples = SimStream::open(&spec, 1 << 62, 1, 2).unwrap();
    for (k, sample) in samples.take(2).enumerate() {
        let (moved, told) = reduction.sample(sample.unwrap(), &units).unwrap();
        // Six numbers for the tendons, and one of six views.
        assert_eq!(reduced.condition(k), told);
        assert_eq!(
            told[..6],
            units.condition(&moved.condition.to_vec()).unwrap()
        );
        assert_eq!((told.len(), told[6..].iter().sum::<f32>()), (12, 1.0));
        let mut points = moved.cloud.points.into_flattened();
        units.normalise_points(&mut points);
        assert_near(reduced.cloud(k), &points);
    }
    assert!(plain.conditions != reduced.conditions);
}

const SHAPE: MlpShape = MlpShape {
    width: 16,
    depth: 2,
    embedding: 8,
    condition_dim: 6,
    octaves: 0,
    channels: Channels::Xyz,
};

/// By symmetries whose images are all seen alike.
fn in_one_view(symmetries: Symmetries) -> Reduction {
    Reduction::new(symmetries.clone(), &symmetries)
}

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
        octaves: 0,
        ..SHAPE
    };
    Model {
        provenance: provenance(reduction),
        settings: TrainSettings::default(),
        step: 0,
        validation_distance: 0.0,
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
        octaves: 0,
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

#[test]
fn symmetries_that_turn_the_cameras_to_the_same_places_have_one_view() {
    let all = of_2m();
    let reflection = all.subgroup(|one| one.tendons[0] == 0);
    assert_eq!(reflection.elements().len(), 2);
    let reduction = Reduction::new(all.clone(), &reflection);
    let command = [0.01, 0.02, 0.03, 0.01, 0.02, 0.03];
    let view = |values: &[f64]| {
        let reduced = reduction.reduce(values, &units()).unwrap();
        let told = &reduced.condition[6..];
        told.iter().position(|&number| number == 1.0).unwrap()
    };
    let mut counts = [0; 3];
    for symmetry in all.elements() {
        // A command, and its mirror image in the plane that mirrors the cameras into each other.
        let values = symmetry.command(&command);
        counts[view(&values)] += 1;
        let mirrored = reflection.elements()[1].command(&values);
        assert_eq!(view(&values), view(&mirrored));
    }
    assert_eq!(counts, [2, 2, 2]);
    let json = serde_json::to_value(&reduction).unwrap();
    let damaged = |views: serde_json::Value| {
        let mut json = json.clone();
        json["views"] = views;
        serde_json::from_value::<Reduction>(json).unwrap().check(6)
    };
    assert_eq!(damaged(json["views"].clone()), Ok(()));
    for views in [
        serde_json::json!([0, 1, 2]),
        serde_json::json!([0, 1, 3, 0, 1, 3]),
        serde_json::json!([0, 1, u64::MAX, 0, 1, 2]),
    ] {
        assert!(damaged(views).unwrap_err().contains("numbered from 0"));
    }
}

/// Few clouds of a robot of one module, which teach more where each stands for six.
#[test]
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
            octaves: 0,
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
    assert!(with < 0.8 * without, "{with} with, {without} without");
}

/// The table of docs/learning.md: what the paper's ring of cameras costs.
#[test]
#[ignore = "prints a table; a minute"]
fn what_perfect_predictors_of_representatives_score() {
    const POINTS: usize = 10_000;
    const COMMANDS: u64 = 6;
    for (name, count, base) in [
        ("2m", 8, BaseVisibility::Hidden),
        ("3m", 8, BaseVisibility::Hidden),
        ("5m", 8, BaseVisibility::Hidden),
        ("2m", 8, BaseVisibility::Shown),
        ("3m", 8, BaseVisibility::Shown),
        ("5m", 8, BaseVisibility::Shown),
        ("2m", 6, BaseVisibility::Hidden),
    ] {
        let mut recipe = Recipe {
            subject: Subject {
                robot: RobotSpec::standard(name).unwrap(),
                base,
                payload: None,
            },
            ..Recipe::default()
        };
        ring(&mut recipe).count = count;
        let seen = recipe.symmetries(Channels::XyzRgb).unwrap();
        let ratios = |of: fn(&Agreement) -> f64| {
            let ratios: Vec<String> = seen
                .views
                .iter()
                .map(|view| format!("{:.2}", of(&view.1)))
                .collect();
            ratios.join(" ")
        };
        let robot = Robot::new(recipe.subject.robot.clone()).unwrap();
        let symmetries = robot.symmetries();
        let mut simulator = Simulator::new(&robot, &recipe);
        let (mut perfect, mut of_representatives, mut floor) = (0.0, 0.0, 0.0);
        for seed in 0..COMMANDS {
            let rng = &mut ChaCha8Rng::seed_from_u64(seed);
            let command = robot.random_command(rng);
            let under = |values: &[f64]| Condition {
                motors: values.iter().map(|&value| value as f32).collect(),
                payload: None,
            };
            let condition = under(command.as_slice());
            let mut view = |rng: &mut ChaCha8Rng| {
                simulator.displace(rng);
                simulator.cloud(&condition, POINTS, rng).unwrap().points
            };
            let (truth, again) = (view(rng), view(rng));
            let own = simulator
                .independent_points(&condition, POINTS, rng)
                .unwrap();
            // A representative stands for all images of its class, each seen from other sides.
            let mut images = PointCloud::default();
            for symmetry in symmetries.elements() {
                let image = under(&symmetry.command(command.as_slice()));
                let mut seen = simulator.independent_points(&image, POINTS, rng).unwrap();
                symmetry.inverse().move_points(&mut seen.points, 1.0);
                images.points.extend(seen.points);
                images.colors.extend(seen.colors);
            }
            let images = images.sample_or_pad(POINTS, rng);
            floor += chamfer(&again, &truth).unwrap();
            perfect += chamfer(&own.points, &truth).unwrap();
            of_representatives += chamfer(&images.points, &truth).unwrap();
        }
        eprintln!(
            "{name}, {count} cameras, base {base:?}: views {}; colours {}; perfect {:.2} floors, of representatives {:.2}",
            ratios(|view| view.positions),
            ratios(|view| view.colors.unwrap_or(f64::NAN)),
            perfect / floor,
            of_representatives / floor
        );
    }
}
