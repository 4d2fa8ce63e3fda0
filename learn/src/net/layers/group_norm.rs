//! GroupNorm with an affine map and SiLU, over points or voxels.

use std::ops::Range;

use rayon::prelude::*;

use super::film::EPSILON;
use crate::net::kernels::float32::{Rows, Sums, silu, vectorised};
use crate::net::parameters::{Initial, Table};

/// `y = SiLU(scale * GN(x) + offset)`, GN over groups of adjacent channels and all rows of a cloud (Wu and He 2018).
///
/// Scale and offset, one per channel, are the norm's own affine map or FiLM's.
#[derive(Clone, Copy, Debug)]
pub struct GroupNorm {
    pub channels: usize,
    /// Most groups, a power of two.
    most_groups: usize,
}

/// What the backward pass needs beside the normalised features, and scratch. One number per channel.
#[derive(Clone, Debug, Default)]
pub struct GroupNormTape {
    mean: Vec<f32>,
    inverse_deviation: Vec<f32>,
    slant: Vec<f32>,
    sums: Sums,
}

impl GroupNorm {
    /// With 8 groups, or where that does not divide the channels the largest divisor of 8 that does.
    pub fn new(channels: usize) -> Self {
        Self {
            channels,
            most_groups: 8,
        }
    }

    /// With the greatest common divisor of 32 and the channels as the number of groups: the authors'.
    pub fn authors(channels: usize) -> Self {
        Self {
            channels,
            most_groups: 32,
        }
    }

    /// Number of groups.
    pub fn groups(self) -> usize {
        1 << (self.channels | self.most_groups).trailing_zeros()
    }

    /// Normalises the rows of `x` in place, and writes `y`. Leaves padding as it is.
    pub fn forward(
        self,
        rows: Rows,
        [scale, offset]: [&[f32]; 2],
        x: &mut [f32],
        tape: &mut GroupNormTape,
        y: &mut [f32],
    ) {
        self.moments(rows, x, tape);
        let moments = [&tape.mean[..], &tape.inverse_deviation];
        let len = rows.block * self.channels;
        x.par_chunks_mut(len)
            .zip(y.par_chunks_mut(len))
            .for_each(|(x, y)| normalise(rows, moments, [scale, offset], x, y));
    }

    /// `y = x + scale * GN(x) + offset`, which has no backward pass. Leaves padding as it is.
    pub fn residual(
        self,
        rows: Rows,
        [scale, offset]: [&[f32]; 2],
        x: &[f32],
        tape: &mut GroupNormTape,
        y: &mut [f32],
    ) {
        self.moments(rows, x, tape);
        let moments = [&tape.mean[..], &tape.inverse_deviation];
        let len = rows.block * self.channels;
        x.par_chunks(len)
            .zip(y.par_chunks_mut(len))
            .for_each(|(x, y)| add_normalised(rows, moments, [scale, offset], x, y));
    }

    /// Mean and deviation of every group, for all of its channels.
    fn moments(self, rows: Rows, x: &[f32], tape: &mut GroupNormTape) {
        let c = self.channels;
        let len = rows.block * c;
        let per_group = (rows.count * c / self.groups()) as f64;
        let GroupNormTape {
            mean,
            inverse_deviation,
            sums,
            ..
        } = tape;
        self.spread(
            sums.columns(x, rows, c),
            |sum| (sum / per_group) as f32,
            mean,
        );
        let squares = sums.over_blocks(x.len().div_ceil(len), c, |block, partial| {
            let x = &x[block * len..x.len().min((block + 1) * len)];
            add_squares(rows, x, mean, partial);
        });
        let inverse = |sum: f64| (sum / per_group + f64::from(EPSILON)).sqrt().recip() as f32;
        self.spread(squares, inverse, inverse_deviation);
    }

    /// Turns `d`, the gradient by `y`, into the gradient by `x`; adds those by scale and offset to `d_affine`.
    ///
    /// `x` is normalised as [`GroupNorm::forward`] left it. Leaves padding as it is.
    pub fn backward(
        self,
        rows: Rows,
        [scale, offset]: [&[f32]; 2],
        x: &[f32],
        tape: &mut GroupNormTape,
        d: &mut [f32],
        [d_scale, d_offset]: [&mut [f32]; 2],
    ) {
        let c = self.channels;
        let len = rows.block * c;
        let per_group = (rows.count * c / self.groups()) as f64;
        let GroupNormTape {
            mean,
            inverse_deviation,
            slant,
            sums,
        } = tape;
        // Through SiLU to the gradient by scale * x + offset; sums for those by scale and offset.
        let sums = sums.while_changing(d, len, 2 * c, |block, d, partial| {
            let x = &x[block * len..][..d.len()];
            let (d_scale, d_offset) = partial.split_at_mut(c);
            activate_backward(rows, [scale, offset], x, d, [d_scale, d_offset]);
        });
        let (by_scale, by_offset) = sums.split_at(c);
        for k in 0..c {
            d_scale[k] += by_scale[k] as f32;
            d_offset[k] += by_offset[k] as f32;
        }
        // Means over each group of scale d and of scale d x, then (scale d - mean - x slant) / deviation.
        let weighted = |sums: &[f64], means: &mut Vec<f32>| {
            means.clear();
            for (sums, scale) in self.chunks(sums).zip(scale.chunks(c / self.groups())) {
                let sum: f64 = sums.iter().zip(scale).map(|(s, w)| s * f64::from(*w)).sum();
                means.resize(means.len() + sums.len(), (sum / per_group) as f32);
            }
        };
        weighted(by_offset, mean);
        weighted(by_scale, slant);
        d.par_chunks_mut(len)
            .zip(x.par_chunks(len))
            .for_each(|(d, x)| {
                normalise_backward(rows, scale, [mean, slant, inverse_deviation], x, d);
            });
    }

    fn chunks<T>(self, channels: &[T]) -> impl Iterator<Item = &[T]> {
        channels.chunks_exact(self.channels / self.groups())
    }

    /// `of` the sum over each group, for all of its channels.
    fn spread(self, sums: &[f64], of: impl Fn(f64) -> f32, values: &mut Vec<f32>) {
        values.clear();
        for group in self.chunks(sums) {
            let value = of(group.iter().sum());
            values.resize(values.len() + group.len(), value);
        }
    }
}

/// A GroupNorm with an affine map of its own.
#[derive(Clone, Debug)]
pub struct AffineNorm {
    pub norm: GroupNorm,
    /// Scale, then offset.
    affine: Range<usize>,
}

impl AffineNorm {
    /// Adds the norm's tensors; it starts as the identity.
    pub fn declare(table: &mut Table, name: &str, norm: GroupNorm) -> Self {
        let channels = norm.channels;
        let weight = Initial::Constant(1.0);
        let weight = table.push(format!("{name}.weight"), &[channels], weight);
        let bias = table.push(format!("{name}.bias"), &[channels], Initial::Constant(0.0));
        Self {
            norm,
            affine: weight.start..bias.end,
        }
    }

    /// [`GroupNorm::forward`].
    pub fn forward(
        &self,
        params: &[f32],
        rows: Rows,
        x: &mut [f32],
        tape: &mut GroupNormTape,
        y: &mut [f32],
    ) {
        let affine = params[self.affine.clone()].split_at(self.norm.channels);
        self.norm.forward(rows, affine.into(), x, tape, y);
    }

    /// [`GroupNorm::backward`]; adds to `gradient`.
    pub fn backward(
        &self,
        params: &[f32],
        rows: Rows,
        x: &[f32],
        tape: &mut GroupNormTape,
        d: &mut [f32],
        gradient: &mut [f32],
    ) {
        let channels = self.norm.channels;
        let affine = params[self.affine.clone()].split_at(channels);
        let d_affine = gradient[self.affine.clone()].split_at_mut(channels);
        self.norm
            .backward(rows, affine.into(), x, tape, d, d_affine.into());
    }
}

/// Features as a norm leaves them.
#[derive(Debug, Default)]
pub struct Normed {
    pub features: Vec<f32>,
    pub tape: GroupNormTape,
}

vectorised! {
    /// Adds the squared distances from the mean, column by column.
    fn add_squares(rows: Rows, x: &'a [f32], mean: &'a [f32], sums: &'a mut [f32]) {
        let c = sums.len();
        let mean = &mean[..c];
        for line in rows.lines(x.len(), c) {
            for x in x[line].chunks_exact(c) {
                for k in 0..c {
                    let distance = x[k] - mean[k];
                    sums[k] = distance.mul_add(distance, sums[k]);
                }
            }
        }
    }
}

vectorised! {
    /// `x = (x - mean) / deviation`, `y = SiLU(scale * x + offset)`.
    fn normalise(
        rows: Rows,
        moments: [&'a [f32]; 2],
        affine: [&'a [f32]; 2],
        x: &'a mut [f32],
        y: &'a mut [f32],
    ) {
        let c = affine[0].len();
        let [mean, inverse_deviation] = moments.map(|values| &values[..c]);
        let [scale, offset] = affine.map(|values| &values[..c]);
        for line in rows.lines(x.len(), c) {
            let y = y[line.clone()].chunks_exact_mut(c);
            for (x, y) in x[line].chunks_exact_mut(c).zip(y) {
                for k in 0..c {
                    x[k] = (x[k] - mean[k]) * inverse_deviation[k];
                    y[k] = silu(x[k].mul_add(scale[k], offset[k])).0;
                }
            }
        }
    }
}

vectorised! {
    /// `y = x + scale * (x - mean) / deviation + offset`.
    fn add_normalised(
        rows: Rows,
        moments: [&'a [f32]; 2],
        affine: [&'a [f32]; 2],
        x: &'a [f32],
        y: &'a mut [f32],
    ) {
        let c = affine[0].len();
        let [mean, inverse_deviation] = moments.map(|values| &values[..c]);
        let [scale, offset] = affine.map(|values| &values[..c]);
        for line in rows.lines(x.len(), c) {
            let y = y[line.clone()].chunks_exact_mut(c);
            for (x, y) in x[line].chunks_exact(c).zip(y) {
                for k in 0..c {
                    let normalised = (x[k] - mean[k]) * inverse_deviation[k];
                    y[k] = x[k] + normalised.mul_add(scale[k], offset[k]);
                }
            }
        }
    }
}

vectorised! {
    /// Gradient before SiLU in place of the gradient behind it; adds those by scale and offset.
    fn activate_backward(
        rows: Rows,
        affine: [&'a [f32]; 2],
        x: &'a [f32],
        d: &'a mut [f32],
        d_affine: [&'a mut [f32]; 2],
    ) {
        let c = affine[0].len();
        let [scale, offset] = affine.map(|values| &values[..c]);
        let [d_scale, d_offset] = d_affine.map(|values| &mut values[..c]);
        for line in rows.lines(d.len(), c) {
            let x = x[line.clone()].chunks_exact(c);
            for (d, x) in d[line].chunks_exact_mut(c).zip(x) {
                for k in 0..c {
                    d[k] *= silu(x[k].mul_add(scale[k], offset[k])).1;
                    d_scale[k] = d[k].mul_add(x[k], d_scale[k]);
                    d_offset[k] += d[k];
                }
            }
        }
    }
}

vectorised! {
    /// `(scale d - mean - x slant) / deviation` in place of `d`.
    fn normalise_backward(
        rows: Rows,
        scale: &'a [f32],
        moments: [&'a [f32]; 3],
        x: &'a [f32],
        d: &'a mut [f32],
    ) {
        let c = scale.len();
        let [mean, slant, inverse_deviation] = moments.map(|values| &values[..c]);
        for line in rows.lines(d.len(), c) {
            let x = x[line.clone()].chunks_exact(c);
            for (d, x) in d[line].chunks_exact_mut(c).zip(x) {
                for k in 0..c {
                    d[k] = (scale[k] * d[k] - mean[k] - x[k] * slant[k]) * inverse_deviation[k];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::kernels::check::{assert_close, assert_is_gradient, numbers, single};

    const NORM: GroupNorm = GroupNorm {
        channels: 12,
        most_groups: 8,
    };

    /// The definition, in f64.
    fn normalise(x: &[f64], scale: &[f64], offset: &[f64]) -> Vec<f64> {
        let (c, size) = (NORM.channels, NORM.channels / NORM.groups());
        let mut y = vec![0.0; x.len()];
        for group in 0..NORM.groups() {
            let of_group = |index: &usize| index % c / size == group;
            let members: Vec<usize> = (0..x.len()).filter(of_group).collect();
            let mean = |of: &dyn Fn(f64) -> f64| {
                members.iter().map(|k| of(x[*k])).sum::<f64>() / members.len() as f64
            };
            let centre = mean(&|x| x);
            let variance = mean(&|x| (x - centre).powi(2));
            for &k in &members {
                let normalised = (x[k] - centre) / (variance + 1e-5).sqrt();
                let m = scale[k % c] * normalised + offset[k % c];
                y[k] = m / (1.0 + (-m).exp());
            }
        }
        y
    }

    /// More points than a block holds.
    #[test]
    fn output_and_gradients_are_those_of_the_definition() {
        let (c, points) = (NORM.channels, 300);
        let rows = Rows::points(points);
        let (x, weights) = (numbers(1, points * c), numbers(2, points * c));
        let (scale, offset) = (numbers(3, c), numbers(4, c));
        let (scale32, offset32) = (single(&scale), single(&offset));
        let affine = [&scale32[..], &offset32[..]];
        let mut tape = GroupNormTape::default();
        let (mut features, mut y) = (single(&x), vec![f32::NAN; x.len()]);
        NORM.forward(rows, affine, &mut features, &mut tape, &mut y);
        assert_close(&y, &normalise(&x, &scale, &offset));

        let (mut d, mut d_scale, mut d_offset) = (single(&weights), vec![0.0; c], vec![0.0; c]);
        let d_affine = [&mut d_scale[..], &mut d_offset[..]];
        NORM.backward(rows, affine, &features, &mut tape, &mut d, d_affine);
        assert_is_gradient(&d, &x, &weights, |x| normalise(x, &scale, &offset));
        assert_is_gradient(&d_scale, &scale, &weights, |s| normalise(&x, s, &offset));
        assert_is_gradient(&d_offset, &offset, &weights, |o| normalise(&x, &scale, o));
    }

    #[test]
    fn groups_divide_the_channels() {
        let groups = |channels| GroupNorm::new(channels).groups();
        assert_eq!([80, 112, 12, 6, 5].map(groups), [8, 8, 4, 2, 1]);
        let groups = |channels| GroupNorm::authors(channels).groups();
        assert_eq!([80, 112, 64, 12, 5].map(groups), [16, 16, 32, 4, 1]);
    }
}
