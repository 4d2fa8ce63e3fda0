//! What is computed once per cloud: from flow time and condition to the modulation of every block (FiLM: Perez et al.,
//! AAAI 2018).

use std::ops::Range;

use super::condition::{Condition, ConditionTape};
use super::time_features::TimeFeatures;
use crate::net::kernels::float32::{activate, add, multiply};
use crate::net::layers::Dense;
use crate::net::parameters::{Initial, Table};

/// What the embedding `e` is made from, and how: fields of [`MlpShape`](super::MlpShape).
#[derive(Clone, Copy, Debug)]
pub struct EmbeddingShape {
    pub embedding: usize,
    pub condition_dim: usize,
    pub condition_blocks: usize,
    pub time_features: TimeFeatures,
}

/// Embeds `(t, c)` as `e` (paper, Eq. embedding_fusion) and maps `e` to a cloud's modulation vector.
///
/// That vector is `[parts | scale_0 | offset_0 | scale_1 | ...]`: what is affine in `e`, such as the embedding's share of
/// the input layer; then per FiLM block the norm's affine map and FiLM folded into one, `scale = w (1 + gamma)`,
/// `offset = b (1 + gamma) + beta`.
#[derive(Clone, Debug)]
pub struct Conditioner {
    features: TimeFeatures,
    time: Dense,
    condition: Condition,
    /// All parts and every block's gamma and beta: all affine in `e`, so one layer.
    head: Dense,
    /// Length of the parts.
    parts: usize,
    /// Features of every FiLM block.
    films: Vec<usize>,
    /// The norms' weight and bias per block.
    norms: Range<usize>,
}

/// A part of the modulation vector that is affine in `e`.
pub struct Part<'a> {
    name: &'a str,
    len: usize,
    initial: Initial,
}

impl<'a> Part<'a> {
    pub fn new(name: &'a str, len: usize, initial: Initial) -> Self {
        Self { name, len, initial }
    }
}

/// A block that FiLM modulates: the name of its tensors, its features, and how FiLM's weights start. Its biases start at zero.
pub struct Film {
    pub name: String,
    pub width: usize,
    pub initial: Initial,
}

/// Intermediate results for `B` clouds, and their gradients.
#[derive(Debug, Default)]
pub struct ConditionerTape {
    features: Vec<f32>,
    time: Branch,
    condition: ConditionTape,
    embedding: Vec<f32>,
    film: Vec<f32>,
    /// Modulation vectors, `(B, M)`.
    pub modulation: Vec<f32>,
    d_film: Vec<f32>,
    d_embedding: Vec<f32>,
    d_branch: Vec<f32>,
}

/// Dense layer and SiLU of the flow time's summand of `e`, `(B, E)`.
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
    /// Adds the conditioner's tensors for an embedding, those of the embedding named after `prefix`, with `parts` and with FiLM
    /// blocks. Norms start as the identity.
    pub fn declare(
        table: &mut Table,
        prefix: &str,
        shape: EmbeddingShape,
        parts: &[Part],
        films: &[Film],
    ) -> Self {
        let embedding = shape.embedding;
        let zero = Initial::Constant(0.0);
        let initial = table.initial.embedding(embedding);
        let time = Dense::declare(
            table,
            &format!("{prefix}time"),
            embedding,
            embedding,
            initial,
        );
        let sizes = [shape.condition_dim, embedding, shape.condition_blocks];
        let initial = table.initial.embedding(shape.condition_dim);
        let condition = Condition::declare(table, prefix, sizes, initial);
        let weight = table.len();
        for Part { name, len, initial } in parts {
            table.push(format!("{name}.weight"), &[*len, embedding], *initial);
        }
        for film in films {
            let shape = [2 * film.width, embedding];
            table.push(format!("{}.film.weight", film.name), &shape, film.initial);
        }
        let bias = table.len();
        for Part { name, len, initial } in parts {
            table.push(format!("{name}.bias"), &[*len], initial.of_bias());
        }
        for Film { name, width, .. } in films {
            table.push(format!("{name}.film.bias"), &[2 * width], zero);
        }
        let norms = table.len();
        for Film { name, width, .. } in films {
            table.push(
                format!("{name}.norm.weight"),
                &[*width],
                Initial::Constant(1.0),
            );
            table.push(format!("{name}.norm.bias"), &[*width], zero);
        }
        Self {
            features: shape.time_features,
            time,
            condition,
            head: Dense {
                inputs: embedding,
                outputs: norms - bias,
                weight: weight..bias,
                bias: bias..norms,
            },
            parts: parts.iter().map(|part| part.len).sum(),
            films: films.iter().map(|film| film.width).collect(),
            norms: norms..table.len(),
        }
    }

    /// Length of a cloud's modulation vector.
    pub fn outputs(&self) -> usize {
        self.head.outputs
    }

    /// Floating-point operations of the forward pass, per cloud.
    pub fn flops(&self) -> u64 {
        self.time.flops(1) + self.condition.flops() + self.head.flops(1)
    }

    /// Fills `tape.modulation` for the clouds at flow times `(B)` under conditions `(B, D)`.
    pub fn forward(
        &self,
        params: &[f32],
        times: &[f32],
        conditions: &[f32],
        tape: &mut ConditionerTape,
    ) {
        // e = SiLU(W_t phi(t) + b_t) + SiLU(h(c)).
        (self.features).fill(times, self.time.inputs, &mut tape.features);
        tape.time.forward(&self.time, params, &tape.features);
        (self.condition).forward(params, conditions, &mut tape.condition);
        tape.embedding.clone_from(&tape.time.activated);
        add(&tape.condition.activated, &mut tape.embedding);
        // Parts, gamma and beta, affine in e; then with the norms folded in.
        tape.film.resize(times.len() * self.head.outputs, 0.0);
        self.head.forward(params, &tape.embedding, &mut tape.film);
        tape.modulation.clone_from(&tape.film);
        for modulation in tape.modulation.chunks_exact_mut(self.head.outputs) {
            self.fold_norms(&params[self.norms.clone()], modulation);
        }
    }

    /// Turns a row `[parts | gamma_0 | beta_0 | ...]` into `[parts | scale_0 | offset_0 | ...]`.
    fn fold_norms(&self, mut norms: &[f32], modulation: &mut [f32]) {
        let mut blocks = &mut modulation[self.parts..];
        for &h in &self.films {
            let (scale, offset) = blocks.split_off_mut(..2 * h).expect(WHOLE).split_at_mut(h);
            let (weight, bias) = norms.split_off(..2 * h).expect(WHOLE).split_at(h);
            for k in 0..h {
                let gain = 1.0 + scale[k];
                scale[k] = weight[k] * gain;
                offset[k] += bias[k] * gain;
            }
        }
    }

    /// Backward pass of [`Conditioner::forward`], from `d_modulation`, the gradient by the modulation vectors `(B, M)`. Adds
    /// to `gradient`.
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
        let d_embedding = &tape.d_embedding[..];
        (self.condition).backward(
            params,
            conditions,
            &mut tape.condition,
            d_embedding,
            gradient,
        );
        tape.d_branch.clear();
        tape.d_branch.extend_from_slice(d_embedding);
        multiply(&tape.time.slope, &mut tape.d_branch);
        (self.time).backward(gradient, &tape.features, &tape.d_branch);
    }

    /// Turns a row of gradients by `[scale | offset]` into gradients by `[gamma | beta]`; adds those by the norms.
    fn fold_norms_backward(
        &self,
        mut norms: &[f32],
        film: &[f32],
        d: &mut [f32],
        mut d_norms: &mut [f32],
    ) {
        let (mut film, mut d) = (&film[self.parts..], &mut d[self.parts..]);
        for &h in &self.films {
            let gamma = film.split_off(..2 * h).expect(WHOLE);
            let (d_scale, d_offset) = d.split_off_mut(..2 * h).expect(WHOLE).split_at_mut(h);
            let (weight, bias) = norms.split_off(..2 * h).expect(WHOLE).split_at(h);
            let (d_weight, d_bias) = d_norms.split_off_mut(..2 * h).expect(WHOLE).split_at_mut(h);
            for k in 0..h {
                let gain = 1.0 + gamma[k];
                d_weight[k] += d_scale[k] * gain;
                d_bias[k] += d_offset[k] * gain;
                d_scale[k] = d_scale[k] * weight[k] + d_offset[k] * bias[k];
            }
        }
    }
}

/// Why a block's part of a row is there.
const WHOLE: &str = "rows hold every block";
