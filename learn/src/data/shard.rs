//! One HDF5 file of samples: its arrays, and how they are written.

use std::io;
use std::path::Path;

use hdf5_pure::{Error, FileBuilder, H5Element};
use tdcr_base::files::write_atomically;
use tdcr_sim::cloud::PointCloud;

use super::{Condition, DataError, Normalisation, Sample};

/// The arrays of a shard: `B` samples, `N` points each, `D` values of a condition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Array {
    /// Points (m), `(B, N, 3)`.
    Data,
    /// Colours, 8-bit, `(B, N, 3)`.
    Rgb,
    /// Conditions: commands (m), then the payload (kg) if there is one, `(B, D)`.
    Motors,
    /// Conditions, normalised, `(B, D)`.
    MotorsNorm,
    /// Points, normalised, `(B, N, 3)`.
    DataNorm,
    /// What was subtracted from the points (m), `(B, 3)`: the origin.
    Center,
    /// What the points were divided by (m), `(B,)`.
    Scale,
    /// Payloads (kg), `(B,)`: the last column of `motors` once more. Its presence says what that column is.
    Payload,
}

impl Array {
    /// What every shard of a complete data set holds.
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
            Self::Payload => "payload",
        }
    }

    /// The shape for given sizes.
    pub(super) fn shape(self, sizes: Sizes) -> Vec<u64> {
        let Sizes {
            samples,
            points,
            values,
            ..
        } = sizes;
        let shape = match self {
            Self::Data | Self::Rgb | Self::DataNorm => vec![samples, points, 3],
            Self::Motors | Self::MotorsNorm => vec![samples, values],
            Self::Center => vec![samples, 3],
            Self::Scale | Self::Payload => vec![samples],
        };
        shape.into_iter().map(|size| size as u64).collect()
    }

    /// Size of an element in memory (bytes).
    pub(super) fn element_size(self) -> u64 {
        match self {
            Self::Rgb => 1,
            _ => 4,
        }
    }

    /// The shape in symbols.
    pub(super) fn symbolic_shape(self) -> &'static str {
        match self {
            Self::Data | Self::Rgb | Self::DataNorm => "(B, N, 3)",
            Self::Motors | Self::MotorsNorm => "(B, D)",
            Self::Center => "(B, 3)",
            Self::Scale | Self::Payload => "(B,)",
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
    /// Values of a condition `D`.
    pub(super) values: usize,
    /// Whether the last of them is a payload.
    pub(super) payload: bool,
}

impl Sizes {
    /// The conditions in the rows of `motors`.
    pub(super) fn conditions(self, motors: &[f32]) -> impl Iterator<Item = Condition> {
        motors.chunks_exact(self.values).map(move |row| {
            let mut motors = row.to_vec();
            let payload = if self.payload { motors.pop() } else { None };
            Condition { motors, payload }
        })
    }
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
    /// Conditions, row-major `(B, D)`.
    pub(super) motors: Vec<f32>,
}

impl Batch {
    /// No samples yet, for samples of these sizes.
    pub(super) fn new(sizes: Sizes) -> Self {
        Self {
            sizes: Sizes {
                samples: 0,
                ..sizes
            },
            data: vec![],
            rgb: vec![],
            motors: vec![],
        }
    }

    /// Appends a sample of `N` points and `D` values.
    pub(super) fn push(&mut self, sample: &Sample) {
        self.sizes.samples += 1;
        self.data
            .extend_from_slice(sample.cloud.points.as_flattened());
        self.rgb
            .extend_from_slice(sample.cloud.colors.as_flattened());
        self.motors.extend(sample.condition.values());
    }

    /// Appends row `row` of a batch of the same `N` and `D`.
    pub(super) fn push_row(&mut self, other: &Self, row: usize) {
        let Sizes { points, values, .. } = self.sizes;
        self.sizes.samples += 1;
        self.data
            .extend_from_slice(&other.data[row * 3 * points..][..3 * points]);
        self.rgb
            .extend_from_slice(&other.rgb[row * 3 * points..][..3 * points]);
        self.motors
            .extend_from_slice(&other.motors[row * values..][..values]);
    }

    /// The samples, one by one.
    pub(super) fn samples(&self) -> impl Iterator<Item = Sample> {
        let points = self.sizes.points;
        let conditions = self.sizes.conditions(&self.motors).enumerate();
        conditions.map(move |(row, condition)| Sample {
            condition,
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

    /// Writes the samples and their normalised copies to `path`, as [`Array::SHARD`], and the payloads if there are any.
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
        if self.sizes.payload {
            add(&mut builder, Array::Payload, self.sizes, &self.payloads());
        }
        write(path, builder)
    }

    /// The last column of the conditions.
    pub(super) fn payloads(&self) -> Vec<f32> {
        let rows = self.motors.chunks_exact(self.sizes.values);
        rows.map(|row| row[row.len() - 1]).collect()
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
