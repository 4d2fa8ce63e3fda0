//! BatchNorm as a trained network has it, with ReLU or LeakyReLU, over points or voxels.
//!
//! In training, its moments are over all points or voxels of all clouds of a batch. A network that is trained has running
//! averages of them, so that the norm is an affine map of each channel, whatever the cloud.

use std::ops::Range;

use rayon::prelude::*;

use crate::net::kernels::float32::{Rows, vectorised};
use crate::net::parameters::{Initial, Table, TensorRole};

/// Ending of the names of running variances, which must not be negative.
pub const VARIANCE: &str = ".running_var";

/// `y = max(z, slope z)`, `z = w (x - mean) / sqrt(variance + epsilon) + b` (Ioffe and Szegedy, ICML 2015): ReLU where the
/// slope is 0, else LeakyReLU.
#[derive(Clone, Debug)]
pub struct BatchNorm {
    channels: usize,
    epsilon: f64,
    slope: f32,
    /// `w`, `b`, mean and variance, `(4, C)`.
    tensors: Range<usize>,
}

impl BatchNorm {
    /// Adds the norm's tensors, named as PyTorch's; it starts as the identity.
    pub fn declare(
        table: &mut Table,
        name: &str,
        channels: usize,
        epsilon: f64,
        slope: f32,
    ) -> Self {
        let [zero, one] = [0.0, 1.0].map(Initial::Constant);
        let start = table.len();
        for (tensor, role, initial) in [
            (".weight", TensorRole::Learned, one),
            (".bias", TensorRole::Learned, zero),
            (".running_mean", TensorRole::Statistic, zero),
            (VARIANCE, TensorRole::Statistic, one),
        ] {
            table.push_as(role, format!("{name}{tensor}"), &[channels], initial);
        }
        Self {
            channels,
            epsilon,
            slope,
            tensors: start..table.len(),
        }
    }

    /// Replaces the rows of `x` by `y`. Leaves padding as it is.
    pub fn forward(&self, params: &[f32], rows: Rows, x: &mut [f32]) {
        let tensors = &params[self.tensors.clone()];
        let value = |tensor: usize, k: usize| f64::from(tensors[tensor * self.channels + k]);
        let gain = |k: usize| value(0, k) / (value(3, k) + self.epsilon).sqrt();
        let scale: Vec<f32> = (0..self.channels).map(|k| gain(k) as f32).collect();
        let offset = |k: usize| (value(1, k) - value(2, k) * gain(k)) as f32;
        let offset: Vec<f32> = (0..self.channels).map(offset).collect();
        x.par_chunks_mut(rows.block * self.channels)
            .for_each(|x| activate(rows, [&scale, &offset], self.slope, x));
    }
}

vectorised! {
    /// `x = max(z, slope z)`, `z = scale x + offset`.
    fn activate(rows: Rows, affine: [&'a [f32]; 2], slope: f32, x: &'a mut [f32]) {
        let c = affine[0].len();
        let [scale, offset] = affine.map(|values| &values[..c]);
        for line in rows.lines(x.len(), c) {
            for x in x[line].chunks_exact_mut(c) {
                for k in 0..c {
                    let z = x[k].mul_add(scale[k], offset[k]);
                    x[k] = z.max(slope * z);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::kernels::check::{assert_close, numbers, single};

    /// Of more points than a block holds, with variances above zero.
    #[test]
    fn output_is_that_of_the_definition() {
        let (channels, points) = (6, 300);
        for (epsilon, slope) in [(1e-5, 0.0), (1e-4, 0.1)] {
            let mut table = Table::default();
            let norm = BatchNorm::declare(&mut table, "norm", channels, epsilon, slope);
            let mut params = numbers(1, table.len());
            params[3 * channels..].iter_mut().for_each(|v| *v = v.abs());
            let x = numbers(2, points * channels);
            let expected: Vec<f64> = (x.iter().enumerate())
                .map(|(index, x)| {
                    let [w, b, mean, variance] =
                        [0, 1, 2, 3].map(|tensor| params[tensor * channels + index % channels]);
                    let z = w * (x - mean) / (variance + epsilon).sqrt() + b;
                    if z > 0.0 { z } else { f64::from(slope) * z }
                })
                .collect();
            let mut found = single(&x);
            norm.forward(&single(&params), Rows::points(points), &mut found);
            assert_close(&found, &expected);
        }
    }

    #[test]
    fn running_statistics_are_no_learned_parameters() {
        let mut table = Table::default();
        BatchNorm::declare(&mut table, "norm", 5, 1e-5, 0.0);
        let roles = table.tensors.iter().map(|tensor| tensor.role);
        use TensorRole::{Learned, Statistic};
        assert!(roles.eq([Learned, Learned, Statistic, Statistic]));
    }
}
