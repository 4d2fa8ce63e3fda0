//! What the network computes once per cloud: from flow time and condition to the modulation of every block.

use std::ops::Range;

use super::dense::Dense;
use super::kernels::{activate, add, multiply};
use super::shape::MlpShape;

/// Embeds `(t, c)` as `e` (paper, Eq. embedding_fusion) and maps `e` to a cloud's modulation vector.
///
/// That vector is `[shift | scale_0 | offset_0 | scale_1 | ...]`: the embedding's share of the input layer, and per block
/// LayerNorm's affine map and FiLM folded into one, `scale = w (1 + gamma)`, `offset = b (1 + gamma) + beta`.
#[derive(Clone, Debug)]
pub(super) struct Conditioner {
    width: usize,
    time: Dense,
    condition: Dense,
    /// The shift and every block's gamma and beta: all linear in `e`, so one layer.
    head: Dense,
    /// LayerNorm's weight and bias per block, `(L, 2, H)`.
    norms: Range<usize>,
}

/// Intermediate results for `B` clouds, and room for their gradients.
#[derive(Debug, Default)]
pub(super) struct ConditionerTape {
    features: Vec<f32>,
    time: Branch,
    condition: Branch,
    embedding: Vec<f32>,
    film: Vec<f32>,
    /// Modulation vectors, `(B, M)`.
    pub modulation: Vec<f32>,
    d_film: Vec<f32>,
    d_embedding: Vec<f32>,
    d_branch: Vec<f32>,
}

/// Dense layer and SiLU of one of the two summands of `e`, `(B, E)`.
#[derive(Debug, Default)]
struct Branch {
    linear: Vec<f32>,
    activated: Vec<f32>,
    slope: Vec<f32>,
}

impl Branch {
    fn forward(&mut self, layer: &Dense, params: &[f32], x: &[f32]) {
        let len = x.len() / layer.inputs * layer.outputs;
        for buffer in [&mut self.linear, &mut self.activated, &mut self.slope] {
            buffer.resize(len, 0.0);
        }
        layer.forward(params, x, &mut self.linear);
        activate(&self.linear, &mut self.activated, &mut self.slope);
    }
}

impl Conditioner {
    pub fn new(shape: &MlpShape) -> Self {
        let part = |name: &str| shape.tensor_range(name);
        let last = shape.blocks().checked_sub(1);
        // The end of the last block's tensor, or of the shift's where there is no block.
        let end = |tensor: &str, shift: &str| match last {
            Some(l) => part(&format!("blocks.{l}.{tensor}")).end,
            None => part(shift).end,
        };
        let head_bias_end = end("film.bias", "shift.bias");
        Self {
            width: shape.width,
            time: Dense {
                inputs: shape.embedding,
                outputs: shape.embedding,
                weight: part("time.weight"),
                bias: part("time.bias"),
            },
            condition: Dense {
                inputs: shape.condition_dim,
                outputs: shape.embedding,
                weight: part("condition.weight"),
                bias: part("condition.bias"),
            },
            head: Dense {
                inputs: shape.embedding,
                outputs: shape.modulation_len(),
                weight: part("shift.weight").start..end("film.weight", "shift.weight"),
                bias: part("shift.bias").start..head_bias_end,
            },
            norms: head_bias_end..part("input.weight").start,
        }
    }

    /// Fills `tape.modulation` for the clouds at flow times `(B)` under conditions `(B, D)`.
    pub fn forward(
        &self,
        params: &[f32],
        times: &[f32],
        conditions: &[f32],
        tape: &mut ConditionerTape,
    ) {
        time_features(times, self.time.inputs, &mut tape.features);
        tape.time.forward(&self.time, params, &tape.features);
        tape.condition.forward(&self.condition, params, conditions);
        tape.embedding.clone_from(&tape.time.activated);
        add(&tape.condition.activated, &mut tape.embedding);
        tape.film.resize(times.len() * self.head.outputs, 0.0);
        self.head.forward(params, &tape.embedding, &mut tape.film);
        tape.modulation.clone_from(&tape.film);
        for modulation in tape.modulation.chunks_exact_mut(self.head.outputs) {
            self.fold_norms(&params[self.norms.clone()], modulation);
        }
    }

    /// Turns a row `[shift | gamma_0 | beta_0 | ...]` into `[shift | scale_0 | offset_0 | ...]`.
    fn fold_norms(&self, norms: &[f32], modulation: &mut [f32]) {
        let h = self.width;
        let blocks = modulation[h..].chunks_exact_mut(2 * h);
        for (block, norm) in blocks.zip(norms.chunks_exact(2 * h)) {
            let (scale, offset) = block.split_at_mut(h);
            let (weight, bias) = norm.split_at(h);
            for k in 0..h {
                let gain = 1.0 + scale[k];
                scale[k] = weight[k] * gain;
                offset[k] += bias[k] * gain;
            }
        }
    }

    /// Adds to `gradient` what follows from `d_modulation`, the gradient by the modulation vectors `(B, M)`.
    pub fn backward(
        &self,
        params: &[f32],
        conditions: &[f32],
        tape: &mut ConditionerTape,
        d_modulation: &[f32],
        gradient: &mut [f32],
    ) {
        tape.d_film.clear();
        tape.d_film.extend_from_slice(d_modulation);
        let rows = tape.d_film.chunks_exact_mut(self.head.outputs);
        for (d_film, film) in rows.zip(tape.film.chunks_exact(self.head.outputs)) {
            let norms = self.norms.clone();
            self.fold_norms_backward(&params[norms.clone()], film, d_film, &mut gradient[norms]);
        }
        self.head.backward(gradient, &tape.embedding, &tape.d_film);
        tape.d_embedding.resize(tape.embedding.len(), 0.0);
        self.head
            .backward_input(params, &tape.d_film, &mut tape.d_embedding);
        for (layer, branch, x) in [
            (&self.time, &tape.time, &tape.features[..]),
            (&self.condition, &tape.condition, conditions),
        ] {
            tape.d_branch.clone_from(&tape.d_embedding);
            multiply(&branch.slope, &mut tape.d_branch);
            layer.backward(gradient, x, &tape.d_branch);
        }
    }

    /// Turns a row of gradients by `[scale | offset]` into gradients by `[gamma | beta]`; adds those by the norms.
    fn fold_norms_backward(&self, norms: &[f32], film: &[f32], d: &mut [f32], d_norms: &mut [f32]) {
        let h = self.width;
        let blocks = d[h..]
            .chunks_exact_mut(2 * h)
            .zip(film[h..].chunks_exact(2 * h));
        let norms = norms
            .chunks_exact(2 * h)
            .zip(d_norms.chunks_exact_mut(2 * h));
        for ((d, film), (norm, d_norm)) in blocks.zip(norms) {
            let (d_scale, d_offset) = d.split_at_mut(h);
            let (weight, bias) = norm.split_at(h);
            let (d_weight, d_bias) = d_norm.split_at_mut(h);
            for k in 0..h {
                let gain = 1.0 + film[k];
                d_weight[k] += d_scale[k] * gain;
                d_bias[k] += d_offset[k] * gain;
                d_scale[k] = d_scale[k] * weight[k] + d_offset[k] * bias[k];
            }
        }
    }
}

/// Sinusoidal features `(B, E)` of flow times: `E/2` cosines, then `E/2` sines, of `t exp(-ln(10000) k / (E/2))`.
fn time_features(times: &[f32], embedding: usize, features: &mut Vec<f32>) {
    let half = embedding / 2;
    features.clear();
    for &time in times {
        let angle = |k: usize| f64::from(time) * 1e4f64.powf(-(k as f64) / half as f64);
        features.extend((0..half).map(|k| angle(k).cos() as f32));
        features.extend((0..half).map(|k| angle(k).sin() as f32));
    }
}
