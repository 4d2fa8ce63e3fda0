//! Makes a data set of synthetic clouds, reads it back, and says how fast.
//!
//! `cargo run --release -p tdcr-learn --example data_set -- FOLDER [SAMPLES [POINTS]]`
//!
//! Interrupt it and run it again: it takes up where it stopped.

#![allow(clippy::print_stdout, reason = "its output is what an example is for")]

use std::error::Error;
use std::f32::consts::TAU;
use std::path::Path;
use std::time::Instant;

use serde_json::json;
use tdcr_learn::data::{Collector, DataSet, Meta, Sample, Split};
use tdcr_sim::cloud::PointCloud;

const MOTORS: usize = 6;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments
        .next()
        .ok_or("expected a folder for the data set")?;
    let count = arguments.next().map_or(Ok(200), |text| text.parse())?;
    let points = arguments.next().map_or(Ok(10_000), |text| text.parse())?;
    let meta = Meta {
        format: Meta::FORMAT,
        tdcr_version: env!("CARGO_PKG_VERSION").to_owned(),
        seed: 0,
        count,
        motors: MOTORS,
        points_per_cloud: points,
        samples_per_shard: 64,
        voxel_size: 0.002,
        robot: json!("a tube that leans"),
        cameras: json!([]),
    };
    let raw_bytes = count * points * 15;
    let shard_bytes = count * points * 27;

    let collector = Collector::open(Path::new(&folder), &meta)?;
    let mut writing = Stopwatch::default();
    for block in collector.missing_blocks() {
        let samples: Vec<Sample> = block.clone().map(|index| sample(index, points)).collect();
        writing.time(|| collector.write_block(block.start, &samples))?;
    }
    writing.report("staging blocks", raw_bytes);

    let start = Instant::now();
    let mut fitted = 0.0;
    collector.finish(|step, steps| {
        if 2 * step == steps {
            fitted = start.elapsed().as_secs_f64();
        }
    })?;
    let finished = start.elapsed().as_secs_f64();
    println!("fitting the normalisation: {fitted:.2} s");
    println!(
        "shards: {:.2} s, {:.0} MB/s",
        finished - fitted,
        shard_bytes as f64 / 1e6 / (finished - fitted)
    );

    let set = DataSet::open(Path::new(&folder))?;
    let (mut raw, mut normalised) = (Stopwatch::default(), Stopwatch::default());
    for split in Split::ALL {
        let samples = raw.time(|| set.read_split(split))?;
        let clouds = normalised.time(|| set.cloud_set(split))?;
        println!(
            "{split:?}: {} samples, {} clouds",
            samples.len(),
            clouds.len()
        );
    }
    raw.report("reading samples", raw_bytes);
    normalised.report("reading normalised clouds", count * points * 12);
    Ok(())
}

/// A tube of radius 2 cm that leans as the commands say.
fn sample(index: usize, points: usize) -> Sample {
    let motors: Vec<f32> = (0..MOTORS)
        .map(|j| 0.04 * (0.618 * (index * MOTORS + j) as f32).fract())
        .collect();
    let point = |k: usize| {
        let (height, angle) = (k as f32 / points as f32, TAU * (0.618 * k as f32).fract());
        let lean = [motors[0] - motors[1], motors[2] - motors[3]];
        [
            0.02 * angle.cos() + lean[0] * height,
            0.02 * angle.sin() + lean[1] * height,
            0.174 + 0.17 * height,
        ]
    };
    Sample {
        cloud: PointCloud {
            points: (0..points).map(point).collect(),
            colors: (0..points).map(|k| [k as u8, index as u8, 128]).collect(),
        },
        motors,
    }
}

/// Adds up time.
#[derive(Default)]
struct Stopwatch {
    seconds: f64,
}

impl Stopwatch {
    fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.seconds += start.elapsed().as_secs_f64();
        result
    }

    fn report(&self, what: &str, bytes: usize) {
        println!(
            "{what}: {:.2} s, {:.0} MB/s",
            self.seconds,
            bytes as f64 / 1e6 / self.seconds
        );
    }
}
