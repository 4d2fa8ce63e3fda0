//! A refinement learns on the ends of a network's own flow, and takes its place in the last evaluation.

use std::sync::atomic::{AtomicUsize, Ordering};

use tdcr_learn::data::CloudSet;
use tdcr_learn::flow::{Method, Sampler};
use tdcr_learn::metrics::nearest_distances;
use tdcr_learn::net::Channels;
use tdcr_learn::predict::{ISOLATED, ISOLATED_CORRECTED, select};
use tdcr_learn::train::{
    Feed, Model, Optimizer, Refinement, Refiner, Target, Teacher, TrainSettings, Trainer,
    TrainingState,
};
use tempfile::TempDir;

use crate::toy::{COLORED, LARGER, SHAPE, bars, colored_bars, learning, provenance, run, settings};

const STEPS: u64 = 150;

/// Settings of a run that is refined, whose sampler denoises.
fn refined(steps: u64) -> TrainSettings {
    TrainSettings {
        validation_clouds: 3,
        sampler: Sampler {
            denoise: Some(0.995),
            spare: 0.0,
            ..settings().sampler
        },
        refinement: Some(Refinement {
            steps: STEPS,
            points: 60,
        }),
        warmup_steps: (steps / 10).min(20),
        ..learning(steps)
    }
}

/// A network that has learned a little.
fn flow(training: &CloudSet, validation: &CloudSet) -> Model {
    let trainer = Trainer::new(LARGER, refined(300), training, validation).unwrap();
    run(trainer, 300).model(provenance()).unwrap()
}

fn feed(model: &Model, training: &CloudSet) -> Feed<'static> {
    let refiner = Refiner::new(model, training, &|| true).unwrap();
    Feed::Refiner(Box::new(refiner.unwrap()))
}

fn refine(model: &Model, training: &CloudSet, validation: &CloudSet) -> Model {
    let settings = model.settings.refining().unwrap();
    let trainer = Trainer::new(&model.network, settings, feed(model, training), validation);
    let last = run(trainer.unwrap(), STEPS).model(provenance()).unwrap();
    Model {
        validation_distance: last.validation_distance,
        refinement: Some(last.network),
        ..model.clone()
    }
}

/// Mean distance (m) of predicted points from the bar under commands that the network has not seen.
fn off(model: &Model, sampler: &Sampler) -> f64 {
    let unseen = bars(10, 9);
    let mut sum = 0.0;
    for index in 0..unseen.len() {
        let command = (unseen
            .condition(index)
            .iter()
            .zip([[0.0, 0.04], [0.01, 0.02]]))
        .map(|(c, [from, range])| from + range * f64::from(*c))
        .collect::<Vec<_>>();
        let cloud = model.predict(&command, 100, 5, sampler).unwrap();
        let mut truth = unseen.cloud(index).as_chunks::<3>().0.to_vec();
        truth.as_flattened_mut().iter_mut().for_each(|x| *x *= 0.4);
        let distances = nearest_distances(&cloud.points, &truth).unwrap();
        sum += distances.iter().sum::<f64>() / 1000.0;
    }
    sum
}

#[test]
fn a_refined_network_comes_nearer_to_the_surface() {
    let (training, validation) = (bars(64, 1), bars(3, 2));
    let plain = flow(&training, &validation);
    let refined = refine(&plain, &training, &validation);
    let sampler = plain.settings.sampler;
    let [before, after] = [&plain, &refined].map(|model| off(model, &sampler));
    assert!(after < 0.8 * before, "{before} to {after} m");
    assert!(refined.validation_distance < plain.validation_distance);
}

#[test]
fn it_is_saved_with_the_model_and_used_at_its_own_time_alone() {
    let (training, validation) = (bars(16, 1), bars(3, 2));
    let plain = flow(&training, &validation);
    let refined = refine(&plain, &training, &validation);
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("model.safetensors");
    refined.save(&file).unwrap();
    let loaded = Model::load(&file).unwrap();
    let at = |denoise| Sampler {
        denoise,
        ..plain.settings.sampler
    };
    let cloud = |model: &Model, denoise| {
        let cloud = model.predict(&[0.02, 0.02], 30, 7, &at(denoise));
        cloud.unwrap().points
    };
    let own = Some(0.995);
    assert_eq!(cloud(&loaded, own), cloud(&refined, own));
    assert_ne!(cloud(&refined, own), cloud(&plain, own));
    for other in [None, Some(0.99)] {
        assert_eq!(cloud(&refined, other), cloud(&plain, other));
    }
}

#[test]
fn corrected_points_take_one_more_evaluation_and_hardly_any_is_left_out_for_being_alone() {
    let (training, validation) = (bars(16, 1), bars(3, 2));
    let plain = flow(&training, &validation);
    let refined = refine(&plain, &training, &validation);
    let predict = |model: &Model, points, spare| {
        let sampler = Sampler {
            spare,
            ..plain.settings.sampler
        };
        model.predict(&[0.01, 0.02], points, 7, &sampler).unwrap()
    };
    for (model, isolated) in [(&plain, ISOLATED), (&refined, ISOLATED_CORRECTED)] {
        let drawn = predict(model, 600, 0.0);
        let [own, other] = [isolated, ISOLATED + ISOLATED_CORRECTED - isolated].map(|isolated| {
            let mut places = drawn.points.clone();
            let kept = select(&mut places, 400, isolated).into_iter();
            kept.map(|k| places[k]).collect::<Vec<_>>()
        });
        let cloud = predict(model, 400, 0.5).points;
        // In the network's units, not in metres: up to rounding.
        let same =
            |(p, q): (&[f32; 3], &[f32; 3])| (0..3).all(|axis| (p[axis] - q[axis]).abs() < 1e-6);
        assert!(cloud.len() == 400 && cloud.iter().zip(&own).all(same));
        assert!(!cloud.iter().zip(&other).all(same));
    }
    let [before, after] = [&plain, &refined].map(|model| predict(model, 40, 0.0).evaluations);
    assert_eq!(after, before + 1);
}

#[test]
fn a_resumed_refinement_ends_as_if_it_had_not_been_left() {
    let (training, validation) = (bars(16, 1), bars(3, 2));
    let model = flow(&training, &validation);
    let settings = || model.settings.refining().unwrap();
    let network = &model.network;
    let begin = || Trainer::new(network, settings(), feed(&model, &training), &validation).unwrap();
    let whole = run(begin(), 12).state(provenance());
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("state.safetensors");
    run(begin(), 5).state(provenance()).save(&file).unwrap();
    let half = TrainingState::load(&file).unwrap();
    assert!(half.starts_from(network));
    assert!(!half.starts_from(&refine(&model, &training, &validation).refinement.unwrap()));
    let feed = |clouds| feed(&model, clouds);
    let again = Trainer::resume(
        half.clone(),
        network,
        settings(),
        feed(&training),
        &validation,
    );
    assert_eq!(run(again.unwrap(), 12).state(provenance()), whole);
    // Nor is it resumed with other clouds.
    let other = Trainer::resume(half, network, settings(), feed(&bars(16, 3)), &validation);
    let said = other.unwrap_err().to_string();
    assert!(said.contains("training set's fingerprint"), "{said}");
}

/// What is to be refined learns what it would without, and distils, to another student.
#[test]
fn the_flow_itself_is_that_of_a_run_without() {
    let (training, validation) = (bars(16, 1), bars(3, 2));
    let train = |settings: TrainSettings| {
        let trainer = Trainer::new(SHAPE, settings, &training, &validation).unwrap();
        run(trainer, 12)
    };
    let with = refined(12);
    let without = TrainSettings {
        refinement: None,
        ..with.clone()
    };
    let [with, without] = [with, without].map(train);
    let [a, b] = [&with, &without].map(|trainer| trainer.state(provenance()));
    assert!(a.params == b.params && a.average == b.average && a.losses == b.losses);
    let written = serde_json::to_value(&b.settings).unwrap();
    assert_eq!(written.get("refinement"), None);

    let plain = with.model(provenance()).unwrap();
    let last = refine(&plain, &training, &validation);
    let distil = |teacher: &Model| {
        let settings = TrainSettings {
            sampler: Sampler {
                method: Method::Euler,
                steps: 2,
                denoise: Some(0.99),
                ..Sampler::PAPER
            },
            clouds: 6,
            path: plain.settings.path,
            target: Target::Steps,
            ..settings()
        };
        let feed = Feed::Teacher(Box::new(Teacher::new(teacher).unwrap()));
        let trainer = Trainer::new(&teacher.network, settings, feed, &validation).unwrap();
        run(trainer, 3).losses().to_vec()
    };
    assert_ne!(distil(&plain), distil(&last));
}

/// A student that denoises when its teacher does has its last network from it, and learns its steps alone.
#[test]
fn a_student_takes_over_its_teachers_last_network() {
    let (training, validation) = (bars(64, 1), bars(3, 2));
    let plain = flow(&training, &validation);
    let teacher = refine(&plain, &training, &validation);
    let settings = TrainSettings {
        sampler: Sampler {
            method: Method::Euler,
            steps: 2,
            ..teacher.settings.sampler
        },
        refinement: None,
        validation_clouds: 3,
        target: Target::Steps,
        learning_rate: 3e-3,
        optimizer: Optimizer::Muon {
            learning_rate: 5e-3,
        },
        ..learning(2 * STEPS)
    };
    let distil = |teacher: &Model, settings: TrainSettings| {
        let feed = Feed::Teacher(Box::new(Teacher::new(teacher).unwrap()));
        Trainer::new(&teacher.network, settings, feed, &validation)
    };
    let student = run(distil(&teacher, settings.clone()).unwrap(), 2 * STEPS);
    let student = student.model(provenance()).unwrap();
    let params = |model: &Model| model.refinement.as_ref().map(|last| last.params().to_vec());
    assert_eq!(params(&student), params(&teacher));
    let sampler = settings.sampler;
    let predicted = student.predict(&[0.02, 0.02], 30, 7, &sampler).unwrap();
    assert_eq!(predicted.evaluations, 4);
    // It comes where its teacher comes in many steps, who in two comes elsewhere.
    let many = Sampler {
        method: Method::Heun,
        steps: 100,
        ..sampler
    };
    let cloud = |model: &Model, sampler: &Sampler| {
        let cloud = model.predict(&[0.02, 0.02], 100, 5, sampler);
        cloud.unwrap().points.concat()
    };
    let expected = cloud(&teacher, &many);
    let [own, untaught] = [&student, &teacher].map(|model| {
        let pairs = cloud(model, &sampler).into_iter().zip(&expected);
        pairs.map(|(x, y)| (x - y).powi(2)).sum::<f32>()
    });
    assert!(own < 0.5 * untaught, "{own}, {untaught} m2");

    // Clouds are shared out among the evaluations that are learned: here two.
    let odd = TrainSettings {
        clouds: 7,
        ..settings
    };
    assert_eq!(
        distil(&teacher, odd).unwrap_err().to_string(),
        "clouds is 7, expected a multiple of the student's 2 learned evaluations"
    );
}

#[test]
fn points_move_and_colours_stay_as_the_flow_has_them() {
    let (training, validation) = (colored_bars(64, 1), colored_bars(3, 2));
    let trainer = Trainer::new(COLORED, refined(300), &training, &validation).unwrap();
    let plain = run(trainer, 300).model(provenance()).unwrap();
    let last = refine(&plain, &training, &validation);
    assert_eq!(last.network.shape().channels(), Channels::XyzRgb);
    let sampler = plain.settings.sampler;
    let [before, after] = [&plain, &last].map(|model| off(model, &sampler));
    assert!(after < 0.9 * before, "{before} to {after} m");
    let colors = |model: &Model| {
        let cloud = model.predict(&[0.0, 0.03], 50, 3, &sampler).unwrap();
        cloud.colors.unwrap().concat()
    };
    let pairs = colors(&plain).into_iter().zip(colors(&last));
    assert!(pairs.map(|(a, b)| a.abs_diff(b)).max().unwrap() <= 4);
}

#[test]
fn what_cannot_be_refined_is_refused_by_name() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let refused = |settings: TrainSettings| settings.check().unwrap_err().to_string();
    let none = TrainSettings {
        refinement: Some(Refinement {
            steps: 0,
            points: 5,
        }),
        ..refined(12)
    };
    assert_eq!(refused(none), "refinement.steps is 0, expected at least 1");
    let undenoised = TrainSettings {
        sampler: settings().sampler,
        ..refined(12)
    };
    let said = refused(undenoised);
    assert!(said.contains("expected a sampler that denoises"), "{said}");

    let trainer = Trainer::new(LARGER, refined(12), &training, &validation).unwrap();
    let model = run(trainer, 12).model(provenance()).unwrap();
    let begin = |settings| {
        let trainer = Trainer::new(
            &model.network,
            settings,
            feed(&model, &training),
            &validation,
        );
        trainer.unwrap_err().to_string()
    };
    let said = begin(refined(12));
    assert!(
        said.starts_with("target is velocity, expected refinement"),
        "{said}"
    );
    let elsewhere = TrainSettings {
        sampler: Sampler {
            denoise: Some(0.9),
            ..model.settings.sampler
        },
        ..model.settings.refining().unwrap()
    };
    let said = begin(elsewhere);
    assert!(
        said.starts_with("sampler denoising time is Some(0.9)"),
        "{said}"
    );
}

#[test]
fn a_refiner_stops_where_it_is_told_to() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let trainer = Trainer::new(LARGER, refined(12), &training, &validation).unwrap();
    let model = run(trainer, 12).model(provenance()).unwrap();
    let made = AtomicUsize::new(0);
    let go_on = || made.fetch_add(1, Ordering::Relaxed) < 2;
    assert!(Refiner::new(&model, &training, &go_on).unwrap().is_none());
}
