//! Streams: the same samples whatever the threads, in bounded memory, into a resumable run.

use std::time::Duration;

use tdcr_learn::data::{PayloadRange, Recipe, Sample, SimStream, StreamSpec, Subject};
use tdcr_learn::net::{Channels, MlpShape, TimeFeatures};
use tdcr_learn::train::{Feed, StreamWindow, TrainError, TrainSettings, Trainer};
use tdcr_sim::robot::{Cameras, RobotSpec};

use crate::toy::{self, provenance, run, settings};

fn spec(payload: Option<PayloadRange>) -> StreamSpec {
    let mut robot = RobotSpec::standard("2m").unwrap();
    if let Cameras::Ring(ring) = &mut robot.cameras {
        ring.resolution = [160, 90];
    }
    let subject = Subject {
        robot,
        payload,
        ..Subject::default()
    };
    let recipe = Recipe {
        subject,
        ..Recipe::default()
    };
    StreamSpec {
        recipe,
        points: 60,
        seed: 3,
    }
}

fn samples(first: u64, threads: usize, ahead: usize, count: usize) -> Vec<Sample> {
    let payload = Some(PayloadRange {
        min: 0.0,
        max: 0.03,
    });
    let stream = SimStream::open(&spec(payload), first, threads, ahead).unwrap();
    stream.take(count).map(Result::unwrap).collect()
}

#[test]
fn samples_depend_on_seed_and_index_alone() {
    let expected = samples(0, 1, 1, 40);
    assert_eq!(samples(0, 4, 16, 40), expected);
    assert_eq!(samples(25, 3, 2, 15), expected[25..]);
    for (k, sample) in expected.iter().enumerate() {
        let same = |other: &Sample| other.condition == sample.condition;
        assert_eq!(expected.iter().position(same), Some(k), "sample {k} again");
    }
}

#[test]
fn threads_wait_for_the_reader_and_stop_with_it() {
    let stream = SimStream::open(&spec(None), 0, 3, 5).unwrap();
    for _ in 0..200 {
        if stream.made() == 5 {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(stream.made(), 5);
    // Joins the threads, which would block for ever if they did not hear of it.
    drop(stream);
}

#[test]
fn samples_are_within_the_units_that_are_fixed_beforehand() {
    let spec = spec(None);
    let units = spec.normalisation().unwrap();
    let stream = SimStream::open(&spec, 0, 2, 8).unwrap();
    let mut largest: f32 = 0.0;
    for sample in stream.take(60).map(Result::unwrap) {
        let condition = units.condition(&sample.condition.to_vec()).unwrap();
        assert!(condition.iter().all(|c| (0.0..=1.0).contains(c)));
        let norms = sample.cloud.points.iter();
        let norms = norms.map(|p| p.iter().map(|x| x * x).sum::<f32>().sqrt());
        largest = norms.fold(largest, f32::max);
    }
    let share = f64::from(largest) / units.scale;
    assert!(share <= 1.0 && share > 0.8, "{share}");
}

const SHAPE: MlpShape = MlpShape {
    channels: Channels::Xyz,
    width: 16,
    depth: 2,
    embedding: 8,
    condition_dim: 6,
    condition_blocks: 0,
    octaves: 0,
    time_features: TimeFeatures::Plain,
};

fn window() -> StreamWindow {
    StreamWindow::new(spec(None), 6, 2, 2, Channels::Xyz).unwrap()
}

fn feed() -> Feed<'static> {
    Feed::Stream(Box::new(window()))
}

#[test]
fn a_resumed_stream_run_goes_on_bit_for_bit() {
    let validation = window().validation(4).unwrap();
    let open = || Trainer::new(SHAPE, settings(), feed(), &validation).unwrap();
    let whole = run(open(), 12).state(provenance());
    let half = run(open(), 5).state(provenance());
    assert_ne!(half, whole);
    let resumed = Trainer::resume(half.clone(), SHAPE, settings(), feed(), &validation).unwrap();
    assert_eq!(run(resumed, 12).state(provenance()), whole);

    let mut other = spec(None);
    other.seed = 4;
    let other = StreamWindow::new(other, 6, 2, 2, Channels::Xyz).unwrap();
    let other = Feed::Stream(Box::new(other));
    let error = Trainer::resume(half, SHAPE, settings(), other, &validation).unwrap_err();
    assert!(matches!(error, TrainError::OtherRun { .. }), "{error}");
}

#[test]
fn a_stream_has_the_colours_of_its_samples() {
    let window = || StreamWindow::new(spec(None), 6, 2, 2, Channels::XyzRgb).unwrap();
    let validation = window().validation(3).unwrap();
    let held_out = SimStream::open(&spec(None), 1 << 62, 2, 4).unwrap();
    let colors = held_out.take(3).flat_map(|sample| {
        let colors = sample.unwrap().cloud.colors;
        colors.into_iter().flatten()
    });
    assert_eq!(validation.colors, Some(colors.collect()));

    let shape = MlpShape {
        channels: Channels::XyzRgb,
        ..SHAPE
    };
    let feed = || Feed::Stream(Box::new(window()));
    let open = || Trainer::new(shape, settings(), feed(), &validation).unwrap();
    let whole = run(open(), 12).state(provenance());
    let half = run(open(), 5).state(provenance());
    let resumed = Trainer::resume(half, shape, settings(), feed(), &validation).unwrap();
    assert_eq!(run(resumed, 12).state(provenance()), whole);
}

#[test]
fn a_stream_that_does_not_suit_the_network_is_refused() {
    let validation = window().validation(2).unwrap();
    let shape = MlpShape {
        condition_dim: 7,
        ..SHAPE
    };
    let error = Trainer::new(shape, settings(), feed(), &validation).unwrap_err();
    assert_eq!(
        error.to_string(),
        "training set: conditions of dimension 6, expected the network's 7"
    );
    let settings = TrainSettings {
        points: 61,
        ..settings()
    };
    let error = Trainer::new(SHAPE, settings, feed(), &validation).unwrap_err();
    assert_eq!(
        error.to_string(),
        "training set: 60 points per cloud, expected at least 61"
    );
    let shape = MlpShape {
        channels: Channels::XyzRgb,
        ..SHAPE
    };
    let error = Trainer::new(shape, toy::settings(), feed(), &validation).unwrap_err();
    assert_eq!(
        error.to_string(),
        "training set: positions alone, expected colours too"
    );
}
