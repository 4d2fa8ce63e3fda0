//! Sets, streams and samples by representatives.

use std::iter::zip;

use tdcr_learn::data::{CloudSet, Condition, Sample, SimStream, StreamSpec};
use tdcr_learn::net::Channels;
use tdcr_learn::symmetry::Reduction;
use tdcr_learn::train::StreamWindow;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::symmetry::Symmetries;

use super::{assert_near, in_one_view, of_2m, recipe, units};

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
