//! Training: one step against the f64 reference, exact resumption, refusals.

use rand::RngExt;
use rand::seq::index;
use tdcr_learn::data::CloudSet;
use tdcr_learn::flow::{Coupling, FlowPath, Stream, rng};
use tdcr_learn::metrics::emd_squared;
use tdcr_learn::net::{Channels, MlpShape};
use tdcr_learn::train::{Optimizer, Procedure, TrainError, TrainSettings, Trainer, TrainingState};
use tempfile::TempDir;

use crate::reference::{Cloud, loss_gradient};
use crate::toy::{COLORED, LARGER, SHAPE, bars, colored_bars, learning, provenance, run, settings};

/// The noise in the order of the points that it flows to.
fn coupled<'a>(coupling: Coupling, noise: &[&'a [f32]], points: &[[f32; 3]]) -> Vec<&'a [f32]> {
    let Coupling::OptimalTransport { batch } = coupling else {
        return noise.to_vec();
    };
    let groups = noise.chunks(batch).zip(points.chunks(batch));
    let coupled = groups.flat_map(|(noise, points)| {
        let positions: Vec<_> = noise.iter().map(|x| [x[0], x[1], x[2]]).collect();
        let matching = emd_squared(points, &positions).unwrap().matching;
        matching.into_iter().map(|k| noise[k]).collect::<Vec<_>>()
    });
    coupled.collect()
}

/// The batch of step 1, drawn again from the documented streams.
fn first_batch(settings: &TrainSettings, set: &CloudSet, channels: Channels) -> Vec<Cloud> {
    let mut rng = rng(settings.seed, Stream::Step(1));
    let cloud = |_| {
        let cloud = rng.random_range(0..set.len());
        let time = settings.path.sample_time(&mut rng);
        let subset = index::sample(&mut rng, set.points_per_cloud, settings.points);
        let data = set.cloud(cloud).as_chunks::<3>().0;
        let color = |k: usize| {
            let first = 3 * (cloud * set.points_per_cloud + k);
            let colors = set.colors.iter().flat_map(move |c| &c[first..first + 3]);
            colors.map(|&byte| f64::from(byte) / 255.0)
        };
        let row = |k: usize| -> Vec<f64> {
            let position = data[k].iter().copied().map(f64::from);
            position.chain(color(k)).collect()
        };
        let mut noise = vec![0.0; settings.points * channels.count()];
        FlowPath::default().sample_prior(&mut rng, channels, &mut noise);
        let noise: Vec<&[f32]> = noise.chunks_exact(channels.count()).collect();
        let points: Vec<[f32; 3]> = subset.iter().map(|k| data[k]).collect();
        let noise = coupled(settings.path.coupling, &noise, &points).into_iter();
        let t = f64::from(time);
        let path = noise.zip(subset.iter().map(row)).map(|(x0, x1)| {
            let pairs = x0.iter().map(|x| f64::from(*x)).zip(x1);
            let along = pairs.map(|(x0, x1)| ((1.0 - t) * x0 + t * x1, x1 - x0));
            along.unzip::<f64, f64, Vec<f64>, Vec<f64>>()
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
    one_step(SHAPE, FlowPath::default(), &bars(5, 1), &bars(3, 2));
}

#[test]
fn one_step_on_colours_is_that_of_the_reference() {
    let path = FlowPath::default();
    one_step(COLORED, path, &colored_bars(5, 1), &colored_bars(3, 2));
}

#[test]
fn one_step_with_coupled_noise_and_other_times_is_that_of_the_reference() {
    // Of 20 points, groups of 8, 8 and 4.
    let path = FlowPath {
        time_exponent: 1.5,
        coupling: Coupling::OptimalTransport { batch: 8 },
        ..FlowPath::default()
    };
    one_step(SHAPE, path, &bars(5, 1), &bars(3, 2));
    one_step(COLORED, path, &colored_bars(5, 1), &colored_bars(3, 2));
}

fn one_step(shape: MlpShape, path: FlowPath, training: &CloudSet, validation: &CloudSet) {
    let settings = TrainSettings {
        optimizer: Optimizer::AdamW,
        clip_norm: 0.01,
        learning_rate: 1e-2,
        path,
        ..settings()
    };
    let mut trainer = Trainer::new(shape, settings.clone(), training, validation).unwrap();
    let before: Vec<f64> = trainer
        .state(provenance())
        .params
        .iter()
        .copied()
        .map(f64::from)
        .collect();
    trainer.step().unwrap();
    let after = trainer.state(provenance());

    let batch = first_batch(&settings, training, shape.channels);
    let gradient = loss_gradient(shape, &before, &batch);
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
    let trainer = run(
        Trainer::new(LARGER, learning(400), &training, &validation).unwrap(),
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
    for procedure in [Procedure::Project, Procedure::Authors] {
        let settings = || TrainSettings {
            procedure,
            ..settings()
        };
        let start = || Trainer::new(SHAPE, settings(), &training, &validation).unwrap();
        let whole = run(start(), 12).state(provenance());
        // Of 5 clouds, an epoch of the authors' has one batch of 3.
        let interrupted = run(start(), 7).state(provenance());
        interrupted.save(&file).unwrap();
        let loaded = TrainingState::load(&file).unwrap();
        assert_eq!(loaded, interrupted);
        let resumed = Trainer::resume(loaded, SHAPE, settings(), &training, &validation).unwrap();
        assert_eq!(run(resumed, 12).state(provenance()), whole);
    }
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
    let many = TrainSettings {
        procedure: Procedure::Authors,
        clouds: 6,
        ..settings()
    };
    assert_eq!(
        refused(&good, many),
        "clouds is 6, expected at most the 5 clouds of the training set, which the authors' procedure draws without \
         replacement"
    );
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

#[test]
fn a_run_out_of_patience_ends_and_stays_ended_when_resumed() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let settings = TrainSettings {
        steps: 30,
        patience: Some(2),
        ..settings()
    };
    let distances = [3.0, 4.0, 1.0, 1.5, 1.0, 0.5];
    let mut trainer = Trainer::new(SHAPE, settings.clone(), &training, &validation).unwrap();
    for distance in distances {
        if trainer.is_finished() {
            break;
        }
        while !trainer.validation_is_due() {
            trainer.step().unwrap();
        }
        trainer.validate(&|_, _| distance).unwrap();
        // Resumed after each validation, the run is as patient as one that went on.
        let state = trainer.state(provenance());
        trainer = Trainer::resume(state, SHAPE, settings.clone(), &training, &validation).unwrap();
    }
    assert!(trainer.is_finished() && !trainer.validation_is_due());
    assert_eq!(trainer.steps_taken(), 15);
    assert_eq!(trainer.model(provenance()).unwrap().step, 9);
}

#[test]
fn a_loss_that_leaps_and_stays_stops_the_run_by_name() {
    let (training, validation) = (bars(5, 1), bars(3, 2));
    let settings = TrainSettings {
        steps: 200,
        optimizer: Optimizer::AdamW,
        learning_rate: 100.0,
        warmup_steps: 199,
        ..settings()
    };
    let mut trainer = Trainer::new(SHAPE, settings.clone(), &training, &validation).unwrap();
    let error = loop {
        if let Err(error) = trainer.step() {
            break error;
        }
    };
    let TrainError::Spike {
        step, loss, level, ..
    } = error
    else {
        panic!("{error}");
    };
    assert!(error.is_divergence());
    let (losses, end) = (trainer.losses(), step as usize);
    assert_eq!((losses.len(), losses[end - 1]), (end, loss));
    let limit = level * settings.spike_factor as f32;
    assert!(losses[end - 10..].iter().all(|loss| *loss > limit));
    assert!(losses[end - 11] <= limit && !trainer.is_level());
    // A state of this step would end at once: no more than ten steps back it was level.
    let mut before = Trainer::new(SHAPE, settings, &training, &validation).unwrap();
    for _ in 0..end - 10 {
        before.step().unwrap();
    }
    assert_eq!(before.losses()[..], losses[..end - 10]);
}
