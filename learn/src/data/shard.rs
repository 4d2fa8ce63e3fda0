//! One HDF5 file of samples: its arrays, and how they are written.

use std::io;
use std::path::Path;

use hdf5_pure::{Error, FileBuilder, H5Element};
use tdcr_sim::cloud::PointCloud;

use super::{DataError, Normalisation, Sample};
use crate::atomic::write_atomically;

/// The arrays of a shard: `B` samples, `N` points each, `D` motors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Array {
    /// Points (m), `(B, N, 3)`.
    Data,
    /// Colours, 8-bit, `(B, N, 3)`.
    Rgb,
    /// Commands (m), `(B, D)`.
    Motors,
    /// Commands, normalised, `(B, D)`.
    MotorsNorm,
    /// Points, normalised, `(B, N, 3)`.
    DataNorm,
    /// What was subtracted from the points (m), `(B, 3)`: the origin.
    Center,
    /// What the points were divided by (m), `(B,)`.
    Scale,
}

impl Array {
    /// What a shard of a complete data set holds.
    pub(super) const SHARD: [Self; 7] = [
        Self::Data,
        Self::Rgb,
        Self::Motors,
        Self::MotorsNorm,
        Self::DataNorm,
        Self::Center,
        Self::Scale,
    ];
    /// What is known of samples before all of them are.
    pub(super) const BLOCK: [Self; 3] = [Self::Data, Self::Rgb, Self::Motors];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Rgb => "rgb",
            Self::Motors => "motors",
            Self::MotorsNorm => "motors_norm",
            Self::DataNorm => "data_norm",
            Self::Center => "center",
            Self::Scale => "scale",
        }
    }

    /// The shape for given sizes.
    pub(super) fn shape(self, sizes: Sizes) -> Vec<u64> {
        let Sizes {
            samples,
            points,
            motors,
        } = sizes;
        let shape = match self {
            Self::Data | Self::Rgb | Self::DataNorm => vec![samples, points, 3],
            Self::Motors | Self::MotorsNorm => vec![samples, motors],
            Self::Center => vec![samples, 3],
            Self::Scale => vec![samples],
        };
        shape.into_iter().map(|size| size as u64).collect()
    }

    /// The shape in symbols.
    pub(super) fn symbolic_shape(self) -> &'static str {
        match self {
            Self::Data | Self::Rgb | Self::DataNorm => "(B, N, 3)",
            Self::Motors | Self::MotorsNorm => "(B, D)",
            Self::Center => "(B, 3)",
            Self::Scale => "(B,)",
        }
    }
}

/// The sizes that a shard's arrays share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sizes {
    /// Samples `B`.
    pub(super) samples: usize,
    /// Points per cloud `N`.
    pub(super) points: usize,
    /// Motors `D`.
    pub(super) motors: usize,
}

/// Samples as they are stored, before normalisation.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Batch {
    /// Number of samples, and their sizes.
    pub(super) sizes: Sizes,
    /// Points (m), row-major `(B, N, 3)`.
    pub(super) data: Vec<f32>,
    /// Colours, row-major `(B, N, 3)`.
    pub(super) rgb: Vec<u8>,
    /// Commands (m), row-major `(B, D)`.
    pub(super) motors: Vec<f32>,
}

impl Batch {
    /// No samples yet, for samples of `points` points and `motors` motors.
    pub(super) fn new(points: usize, motors: usize) -> Self {
        Self {
            sizes: Sizes {
                samples: 0,
                points,
                motors,
            },
            data: vec![],
            rgb: vec![],
            motors: vec![],
        }
    }

    /// Drops the samples and keeps the memory.
    pub(super) fn clear(&mut self) {
        self.sizes.samples = 0;
        self.data.clear();
        self.rgb.clear();
        self.motors.clear();
    }

    /// Appends a sample of `N` points and `D` motors.
    pub(super) fn push(&mut self, sample: &Sample) {
        self.sizes.samples += 1;
        self.data
            .extend_from_slice(sample.cloud.points.as_flattened());
        self.rgb
            .extend_from_slice(sample.cloud.colors.as_flattened());
        self.motors.extend_from_slice(&sample.motors);
    }

    /// Appends row `row` of a batch of the same `N` and `D`.
    pub(super) fn push_row(&mut self, other: &Self, row: usize) {
        let Sizes { points, motors, .. } = self.sizes;
        self.sizes.samples += 1;
        self.data
            .extend_from_slice(&other.data[row * 3 * points..][..3 * points]);
        self.rgb
            .extend_from_slice(&other.rgb[row * 3 * points..][..3 * points]);
        self.motors
            .extend_from_slice(&other.motors[row * motors..][..motors]);
    }

    /// The samples, one by one.
    pub(super) fn samples(&self) -> impl Iterator<Item = Sample> {
        let Sizes {
            samples,
            points,
            motors,
        } = self.sizes;
        (0..samples).map(move |row| Sample {
            motors: self.motors[row * motors..][..motors].to_vec(),
            cloud: PointCloud {
                points: self.data.as_chunks().0[row * points..][..points].to_vec(),
                colors: self.rgb.as_chunks().0[row * points..][..points].to_vec(),
            },
        })
    }

    /// Writes the samples to `path`, as [`Array::BLOCK`].
    pub(super) fn write_block(&self, path: &Path) -> Result<(), DataError> {
        write(path, self.raw_arrays())
    }

    /// Writes the samples and their normalised copies to `path`, as [`Array::SHARD`].
    pub(super) fn write_shard(
        &self,
        path: &Path,
        normalisation: &Normalisation,
    ) -> Result<(), DataError> {
        let mut points = self.data.clone();
        normalisation.normalise_points(&mut points);
        let samples = self.sizes.samples;
        let mut builder = self.raw_arrays();
        for (array, values) in [
            (Array::MotorsNorm, normalisation.conditions(&self.motors)),
            (Array::DataNorm, points),
            (Array::Center, vec![0.0; 3 * samples]),
            (Array::Scale, vec![normalisation.scale as f32; samples]),
        ] {
            add(&mut builder, array, self.sizes, &values);
        }
        write(path, builder)
    }

    fn raw_arrays(&self) -> FileBuilder {
        let mut builder = FileBuilder::new();
        add(&mut builder, Array::Data, self.sizes, &self.data);
        add(&mut builder, Array::Rgb, self.sizes, &self.rgb);
        add(&mut builder, Array::Motors, self.sizes, &self.motors);
        builder
    }
}

/// Adds an array to a file, uncompressed and in one run: noise in the last bits of a float does not compress.
fn add<T: H5Element>(builder: &mut FileBuilder, array: Array, sizes: Sizes, values: &[T]) {
    builder
        .create_dataset(array.name())
        .with_data(values)
        .with_shape(&array.shape(sizes));
}

fn write(path: &Path, builder: FileBuilder) -> Result<(), DataError> {
    write_atomically(path, |file| {
        builder.finish_to(file).map_err(|error| match error {
            Error::Io(error) => error,
            error => io::Error::other(error.to_string()),
        })
    })
    .map_err(DataError::io("write", path))
}
