//! First and last layer about bfloat16 products: their few inputs or outputs stay floats.

use pulp::Simd;

use super::pass::Keep;
use crate::channels::{Channels, DIM};
use crate::net::kernels::bfloat16::{DEPTH, Kernel, Lanes, Part, Tiles, parts, parts_mut};

/// Numbers per velocity of a point with a colour; without, there are [`DIM`].
const MOST: usize = Channels::XyzRgb.count();

/// The rows of a matrix `(C, H)`.
#[inline(always)]
fn rows_of<const C: usize>(weight: &[f32]) -> [&[Part<f32>]; C] {
    let width = weight.len() / C;
    let mut rows = [&[][..]; C];
    for (row, numbers) in rows.iter_mut().zip(weight.chunks_exact(width)) {
        *row = parts(numbers);
    }
    rows
}

/// A layer from few numbers: rows of features `y = shift + W x`.
pub struct InputLayer<'a> {
    /// `(T, I)`.
    pub points: &'a [f32],
    /// `W^T`, `(I, H)`.
    pub weight: &'a [f32],
    pub shift: &'a [f32],
    pub features: &'a mut [f32],
}

impl Kernel for InputLayer<'_> {
    #[inline(always)]
    fn run_with<S: Simd>(self, _: S, _: impl Lanes) {
        let width = self.shift.len();
        let inputs = self.weight.len() / width;
        let stride = self.features.len() / (self.points.len() / inputs);
        let rows = self.features.chunks_exact_mut(stride);
        for (features, point) in rows.zip(self.points.chunks_exact(inputs)) {
            let features = &mut features[..width];
            features.copy_from_slice(self.shift);
            for (x, weight) in point.iter().zip(self.weight.chunks_exact(width)) {
                features
                    .iter_mut()
                    .zip(weight)
                    .for_each(|(y, w)| *y = w.mul_add(*x, *y));
            }
        }
    }
}

/// Gradient by the weight of [`InputLayer`]: adds `d^T x` to `d_weight`, which is `(I, H)` as the weight is there.
pub struct InputBackward<'a> {
    pub points: &'a [f32],
    pub d: &'a [f32],
    pub d_weight: &'a mut [f32],
    pub width: usize,
}

impl Kernel for InputBackward<'_> {
    #[inline(always)]
    fn run_with<S: Simd>(self, _: S, _: impl Lanes) {
        let width = self.width;
        let inputs = self.d_weight.len() / width;
        let stride = self.d.len() / (self.points.len() / inputs);
        let rows = self
            .d
            .chunks_exact(stride)
            .zip(self.points.chunks_exact(inputs));
        for (d, point) in rows {
            for (x, d_weight) in point.iter().zip(self.d_weight.chunks_exact_mut(width)) {
                d_weight
                    .iter_mut()
                    .zip(&d[..width])
                    .for_each(|(w, d)| *w = d.mul_add(*x, *w));
            }
        }
    }
}

/// A layer to few numbers behind SiLU: rows `y = W SiLU(h) + b`.
pub struct OutputLayer<'a> {
    pub features: &'a [f32],
    /// `(C, H)`.
    pub weight: &'a [f32],
    pub bias: &'a [f32],
    pub keep: Keep,
    /// SiLU of the features and its slope, both `(T, H)`.
    pub kept: [&'a mut [u16]; 2],
    pub outputs: &'a mut [f32],
}

impl Kernel for OutputLayer<'_> {
    #[inline(always)]
    fn run_with<S: Simd>(self, _: S, lanes: impl Lanes) {
        match self.bias.len() {
            DIM => self.rows::<DIM>(lanes),
            _ => self.rows::<MOST>(lanes),
        }
    }
}

impl OutputLayer<'_> {
    #[inline(always)]
    fn rows<const C: usize>(self, lanes: impl Lanes) {
        let weights = rows_of::<C>(self.weight);
        let width = weights[0].len() * DEPTH;
        let stride = self.features.len() / (self.outputs.len() / C);
        let [values, slopes] = self.kept;
        let rows = self
            .features
            .chunks_exact(stride)
            .zip(self.outputs.chunks_exact_mut(C));
        for (row, (features, outputs)) in rows.enumerate() {
            let kept = match self.keep {
                Keep::EveryBlock => row * width..(row + 1) * width,
                Keep::Nothing => 0..0,
            };
            let values = parts_mut(&mut values[kept.clone()]);
            let mut kept = values.iter_mut().zip(parts_mut(&mut slopes[kept]));
            let mut sums = [lanes.splat(0.0); C];
            for (index, features) in parts(&features[..width]).iter().enumerate() {
                let [value, slope] = lanes.silu(lanes.load(features));
                for c in 0..C {
                    sums[c] = lanes.mul_add(lanes.load(&weights[c][index]), value, sums[c]);
                }
                if let Some((values, slopes)) = kept.next() {
                    *values = lanes.round(value);
                    *slopes = lanes.round(slope);
                }
            }
            for c in 0..C {
                outputs[c] = self.bias[c] + lanes.total(sums[c]);
            }
        }
    }
}

/// Backward pass of [`OutputLayer`]: the gradient by the features, also rounded as a left matrix and summed over the rows; adds
/// to the gradient by the weight.
pub struct OutputBackward<'a> {
    pub d_outputs: &'a [f32],
    pub weight: &'a [f32],
    pub kept: [&'a [u16]; 2],
    pub d_weight: &'a mut [f32],
    pub d_features: &'a mut [f32],
    pub rounded: &'a mut Tiles,
    pub sum: &'a mut [f32],
    pub channels: usize,
}

impl Kernel for OutputBackward<'_> {
    #[inline(always)]
    fn run_with<S: Simd>(self, _: S, lanes: impl Lanes) {
        match self.channels {
            DIM => self.rows::<DIM>(lanes),
            _ => self.rows::<MOST>(lanes),
        }
    }
}

impl OutputBackward<'_> {
    #[inline(always)]
    fn rows<const C: usize>(self, lanes: impl Lanes) {
        let weights = rows_of::<C>(self.weight);
        let width = weights[0].len() * DEPTH;
        let d_weights = parts_mut(self.d_weight);
        let stride = self.d_features.len() / (self.d_outputs.len() / C);
        let rows = self.d_features.chunks_exact_mut(stride);
        for (row, (d_features, d_outputs)) in
            rows.zip(self.d_outputs.as_chunks::<C>().0).enumerate()
        {
            let kept = row * width..(row + 1) * width;
            let values = parts(&self.kept[0][kept.clone()]);
            let slopes = parts(&self.kept[1][kept]);
            let d_features = parts_mut(&mut d_features[..width]);
            let sums = parts_mut(self.sum);
            for (index, rounded) in self.rounded.row_mut(row).enumerate() {
                let value = lanes.widen(&values[index]);
                let mut by_s = lanes.splat(0.0);
                for c in 0..C {
                    let d_output = lanes.splat(d_outputs[c]);
                    by_s = lanes.mul_add(lanes.load(&weights[c][index]), d_output, by_s);
                    let d_weight = &mut d_weights[c * width / DEPTH + index];
                    lanes.store(
                        lanes.mul_add(value, d_output, lanes.load(d_weight)),
                        d_weight,
                    );
                }
                let by_h = lanes.mul(by_s, lanes.widen(&slopes[index]));
                lanes.store(by_h, &mut d_features[index]);
                lanes.store(lanes.add(by_h, lanes.load(&sums[index])), &mut sums[index]);
                *rounded = lanes.round(by_h);
            }
        }
    }
}
