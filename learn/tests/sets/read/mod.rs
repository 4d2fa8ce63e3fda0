//! Reading data sets, others' and damaged ones.

mod damage;
mod sets;
mod shards;

use std::path::Path;

use tdcr_learn::data::{DataError, DataSet, Sample, Split};
use tdcr_learn::net::Channels;
use tempfile::TempDir;

use crate::common::CHUNKED;

/// What reading the val split says, raw and normalised alike.
fn error(dir: &TempDir) -> DataError {
    let set = DataSet::open(dir.path()).unwrap();
    let (raw, normalised) = (set.read_split(Split::Val), set.cloud_set(Split::Val));
    assert_eq!(
        raw.unwrap_err().to_string(),
        normalised.unwrap_err().to_string()
    );
    set.read_split(Split::Val).unwrap_err()
}

#[test]
fn a_compressed_set_written_by_h5py_is_read() {
    let set = DataSet::open(Path::new(CHUNKED)).unwrap();
    assert_eq!(set.meta(), None);
    let samples = set.read_split(Split::Train).unwrap();
    assert_eq!(samples.len(), 5);
    let f32s = |values: [f64; 3]| values.map(|value| value as f32);
    for (i, Sample { condition, cloud }) in samples.iter().enumerate() {
        let motors = &condition.motors;
        assert_eq!(condition.payload, None);
        let step = 0.01 * i as f64;
        assert_eq!(*motors, [step as f32, (0.01 * (i as f64 + 1.0)) as f32]);
        for k in 0..5 {
            assert_eq!(cloud.points[k], f32s([0.1 * k as f64, step, -0.2]));
            assert_eq!(cloud.colors[k], [k as u8, i as u8, 255]);
        }
    }
    let clouds = set.cloud_set(Split::Train).unwrap();
    assert_eq!(clouds.colors, None);
    let colored = set.cloud_set_in(Split::Train, set.normalisation(), Channels::XyzRgb);
    let colored = colored.unwrap();
    assert_eq!(colored.points, clouds.points);
    let mut rows = vec![];
    colored.gather(3, [4, 1].into_iter(), Channels::XyzRgb, &mut rows);
    let row = |k: usize| {
        let point = &clouds.cloud(3)[3 * k..3 * k + 3];
        [point, &[k as f32 / 255.0, 3.0 / 255.0, 1.0]].concat()
    };
    assert_eq!(rows, [row(4), row(1)].concat());
    assert_eq!(
        (clouds.len(), clouds.condition_dim, clouds.points_per_cloud),
        (5, 2, 5)
    );
    for i in 0..5 {
        for &condition in clouds.condition(i) {
            assert!((condition - 0.25 * i as f32).abs() < 1e-6);
        }
    }
    let radius = |point: &[f32; 3]| point.iter().map(|x| x * x).sum::<f32>().sqrt();
    let largest = clouds
        .points
        .as_chunks()
        .0
        .iter()
        .map(radius)
        .fold(0.0, f32::max);
    assert!((largest - 1.0).abs() < 1e-6);
}
