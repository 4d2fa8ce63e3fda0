//! Squeeze and excitation: a gain per channel from the channels' means.

use super::dense::Dense;
use crate::net::kernels::float32::reset;
use crate::net::parameters::{Table, fan_in};

/// Channels per hidden feature.
const REDUCTION: usize = 8;

/// Gains `a = sigmoid(W_2 max(W_1 s, 0))` from the mean `s` of every channel over the voxels (Hu et al. 2018).
///
/// Hidden features are an eighth of the channels, and no layer has a bias, as in PVCNN.
#[derive(Clone, Debug)]
pub struct Squeeze {
    reduce: Dense,
    expand: Dense,
}

/// Intermediate results of one cloud.
#[derive(Debug, Default)]
pub struct SqueezeTape {
    /// Mean of every channel, `(C)`: the input.
    pub means: Vec<f32>,
    hidden: Vec<f32>,
    /// Gain of every channel, `(C)`: the output.
    pub gains: Vec<f32>,
    /// Gradient by the gains, `(C)`, before [`Squeeze::backward`]; by the means behind it.
    pub d: Vec<f32>,
    d_hidden: Vec<f32>,
}

impl Squeeze {
    /// Adds the layer's tensors; they start as PyTorch's.
    pub fn declare(table: &mut Table, name: &str, channels: usize) -> Self {
        let hidden = (channels / REDUCTION).max(1);
        let (reduce, expand) = (format!("{name}.reduce"), format!("{name}.expand"));
        Self {
            reduce: Dense::declare_unbiased(table, &reduce, channels, hidden, fan_in(channels)),
            expand: Dense::declare_unbiased(table, &expand, hidden, channels, fan_in(hidden)),
        }
    }

    /// Floating-point operations of the forward pass.
    pub fn flops(&self) -> u64 {
        self.reduce.flops(1) + self.expand.flops(1)
    }

    /// Gains from `tape.means`.
    pub fn forward(&self, params: &[f32], tape: &mut SqueezeTape) {
        reset(&mut tape.hidden, self.reduce.outputs);
        self.reduce
            .add_product(params, &tape.means, &mut tape.hidden);
        tape.hidden.iter_mut().for_each(|z| *z = z.max(0.0));
        reset(&mut tape.gains, self.expand.outputs);
        self.expand
            .add_product(params, &tape.hidden, &mut tape.gains);
        tape.gains
            .iter_mut()
            .for_each(|a| *a = 1.0 / (1.0 + (-*a).exp()));
    }

    /// Turns `tape.d` into the gradient by the means; adds those by the weights.
    pub fn backward(&self, params: &[f32], tape: &mut SqueezeTape, gradient: &mut [f32]) {
        for (d, a) in tape.d.iter_mut().zip(&tape.gains) {
            *d *= a * (1.0 - a);
        }
        self.expand.backward_weight(gradient, &tape.hidden, &tape.d);
        reset(&mut tape.d_hidden, self.reduce.outputs);
        self.expand
            .backward_input(params, &tape.d, &mut tape.d_hidden);
        for (d, z) in tape.d_hidden.iter_mut().zip(&tape.hidden) {
            if *z == 0.0 {
                *d = 0.0;
            }
        }
        self.reduce
            .backward_weight(gradient, &tape.means, &tape.d_hidden);
        self.reduce
            .backward_input(params, &tape.d_hidden, &mut tape.d);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::kernels::check::{assert_close, assert_is_gradient, numbers, single};

    const CHANNELS: usize = 24;
    const HIDDEN: usize = 3;

    /// The definition, in f64.
    fn gains(params: &[f64], means: &[f64]) -> Vec<f64> {
        let product = |weight: &[f64], x: &[f64]| -> Vec<f64> {
            let rows = weight.chunks(x.len());
            rows.map(|row| row.iter().zip(x).map(|(w, x)| w * x).sum())
                .collect()
        };
        let (reduce, expand) = params.split_at(CHANNELS * HIDDEN);
        let hidden: Vec<f64> = product(reduce, means).iter().map(|z| z.max(0.0)).collect();
        let gains = product(expand, &hidden);
        gains.iter().map(|a| 1.0 / (1.0 + (-a).exp())).collect()
    }

    #[test]
    fn output_and_gradients_are_those_of_the_definition() {
        let mut table = Table::default();
        let squeeze = Squeeze::declare(&mut table, "squeeze", CHANNELS);
        assert_eq!(table.len(), 2 * CHANNELS * HIDDEN);
        assert_eq!(squeeze.flops(), 2 * table.len() as u64);
        let (params, means) = (numbers(1, table.len()), numbers(5, CHANNELS));
        let weights = numbers(3, CHANNELS);
        let params32 = single(&params);
        let mut tape = SqueezeTape {
            means: single(&means),
            d: single(&weights),
            ..SqueezeTape::default()
        };
        squeeze.forward(&params32, &mut tape);
        assert_close(&tape.gains, &gains(&params, &means));
        let alive = tape.hidden.iter().filter(|z| **z > 0.0).count();
        assert!(
            (1..HIDDEN).contains(&alive),
            "{alive} of {HIDDEN} features are positive"
        );

        let mut gradient = vec![0.0; table.len()];
        squeeze.backward(&params32, &mut tape, &mut gradient);
        assert_is_gradient(&tape.d, &means, &weights, |means| gains(&params, means));
        assert_is_gradient(&gradient, &params, &weights, |params| gains(params, &means));
    }
}
