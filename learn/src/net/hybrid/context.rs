//! The context network: features of the cloud about a point.

use faer::Accum;
use rayon::prelude::*;

use super::context_kind::{Context, Split};
use super::context_shape::{ContextShape, STAGES};
use super::context_stage::{PackedStage, StageNet, StageTape};
use crate::net::kernels::bfloat16::Operands;
use crate::net::kernels::float32::{Rows, Sums, fill_rows};
use crate::net::layers::{AffineNorm, Dense, GroupNorm, Normed, PackedWeight, Passes, Weights};
use crate::net::mlp::{Cloud, EmbeddingShape, Film, Part};
use crate::net::parameters::{Initial, Table, fan_in};

/// Point-voxel context `(N, F)` of a cloud's points `(N, C)`, from channels `[e | x]`:
///
/// ```text
/// f_1 = blocks(W_1 x + W_e e + b)                    first stage; PvBlock each
/// f_s = blocks(W_s f_(s-1) + b_s)                    further stages, on coarser grids
/// g   = max over the points of f_3
/// c   = W_o SiLU(GN(W_j [f_1 | f_2 | f_3 | g] + b_j)) + b_o
/// ```
///
/// `W_j` is stored as its shares. `W_o` and `b_o` start at zero, and so does the context.
#[derive(Clone, Debug)]
pub struct ContextNet {
    stages: Vec<StageNet>,
    /// One share of the joining layer per stage; then the maximum's, which has the bias.
    joins: Vec<Dense>,
    join_maximum: Dense,
    join_norm: AffineNorm,
    output: Dense,
}

/// The network's weights in tiles.
#[derive(Debug, Default)]
pub struct PackedContext {
    stages: Vec<PackedStage>,
    joins: Vec<PackedWeight>,
    output: PackedWeight,
}

/// Memory of one cloud's forward and backward pass.
#[derive(Debug)]
pub struct ContextTape {
    stages: Vec<StageTape>,
    maximum: Vec<f32>,
    /// The point that has it, per feature.
    highest: Vec<usize>,
    shift: Vec<f32>,
    joined: Normed,
    activated: Vec<f32>,
    /// The context, `(N, F)`.
    pub context: Vec<f32>,
    d_maximum: Vec<f32>,
    d_activated: Vec<f32>,
    sums: Sums,
    operands: Operands,
}

/// Modulated by the embedding of the head.
impl Context for ContextNet {
    type Tape = ContextTape;
    type Packed = PackedContext;

    fn modulation(
        shape: &ContextShape,
        embedding: usize,
        inputs: usize,
    ) -> (Vec<Part<'static>>, Vec<Film>) {
        let parts = shape.parts(embedding, inputs);
        (parts.into(), shape.films().collect())
    }

    fn modulation_lengths(shape: &ContextShape) -> [usize; 2] {
        [shape.features, shape.stages[0].channels]
    }

    fn declare(
        table: &mut Table,
        shape: &ContextShape,
        embedding: EmbeddingShape,
        inputs: usize,
    ) -> Self {
        let mut before = inputs;
        let mut stages = Vec::new();
        for (s, stage) in shape.stages.into_iter().enumerate() {
            let name = format!("context.stages.{s}.project");
            // The first projection's bias is part of the embedding's share.
            let project = match s {
                0 => Dense::declare_unbiased(
                    table,
                    &name,
                    before,
                    stage.channels,
                    fan_in(before + embedding.embedding),
                ),
                _ => Dense::declare(table, &name, before, stage.channels, fan_in(before)),
            };
            before = stage.channels;
            stages.push(StageNet::declare(table, s, stage, project, shape.blocks));
        }
        let all = shape
            .stages
            .iter()
            .map(|stage| stage.channels)
            .sum::<usize>();
        let (joined, initial) = (shape.joined, fan_in(all + before));
        let joins = shape.stages.iter().enumerate().map(|(s, stage)| {
            Dense::declare_unbiased(
                table,
                &format!("context.joins.{s}"),
                stage.channels,
                joined,
                initial,
            )
        });
        let joins = joins.collect();
        Self {
            stages,
            joins,
            join_maximum: Dense::declare(table, "context.join_maximum", before, joined, initial),
            join_norm: AffineNorm::declare(table, "context.join_norm", GroupNorm::new(joined)),
            output: Dense::declare(
                table,
                "context.output",
                joined,
                shape.features,
                Initial::Constant(0.0),
            ),
        }
    }

    fn tape(&self) -> ContextTape {
        ContextTape {
            stages: self.stages.iter().map(StageNet::tape).collect(),
            maximum: Vec::new(),
            highest: Vec::new(),
            shift: Vec::new(),
            joined: Normed::default(),
            activated: Vec::new(),
            context: Vec::new(),
            d_maximum: Vec::new(),
            d_activated: Vec::new(),
            sums: Sums::default(),
            operands: Operands::default(),
        }
    }

    fn flops(&self, points: usize) -> u64 {
        let stages = self.stages.iter().map(|stage| stage.flops(points));
        let joins = self.joins.iter().chain([&self.output]);
        let joins = joins.map(|layer| layer.flops(points));
        stages.sum::<u64>() + joins.sum::<u64>() + self.join_maximum.flops(1)
    }

    fn pack(&self, params: &[f32], passes: Passes, packed: &mut PackedContext) {
        packed
            .stages
            .resize_with(self.stages.len(), PackedStage::default);
        packed
            .joins
            .resize_with(self.joins.len(), PackedWeight::default);
        let stages = self.stages.par_iter().zip(&mut packed.stages);
        stages.for_each(|(stage, packed)| stage.pack(params, passes, packed));
        for (join, packed) in self.joins.iter().zip(&mut packed.joins) {
            packed.set(join, params, passes);
        }
        packed.output.set(&self.output, params, passes);
    }

    fn contexts<'a>(
        &self,
        weights: Weights<'a, PackedContext>,
        cloud: Cloud<'a>,
        modulation: Split<&'a [f32]>,
        tape: &'a mut ContextTape,
    ) -> (&'a [f32], &'a [f32]) {
        self.forward(ContextInput::new(weights, cloud, modulation), tape);
        (&tape.context, modulation.global)
    }
}

impl ContextNet {
    /// Fills `tape.context`.
    pub fn forward(&self, input: ContextInput, tape: &mut ContextTape) {
        let ContextInput {
            weights,
            points,
            shift,
            mut films,
        } = input;
        let operands = &mut tape.operands;
        let count = points.len() / self.stages[0].project.inputs;
        // f_s: the points' features, projected to the stage's channels, through its blocks.
        for (s, stage) in self.stages.iter().enumerate() {
            let (before, tape) = tape.stages.split_at_mut(s);
            let tape = &mut tape[0];
            tape.voxels.place(points, self.stages[0].project.inputs);
            let first = tape.input_mut();
            first.resize(count * stage.project.outputs, 0.0);
            let stage_weights = weights.of(|packed| &packed.stages[s]);
            let project = stage_weights.of(|packed| &packed.project);
            match before.last() {
                None => {
                    fill_rows(first, shift);
                    let project = project.floats();
                    stage
                        .project
                        .par_add_product(project, operands, points, first);
                }
                Some(before) => {
                    stage
                        .project
                        .par_forward(project, operands, before.output(), first)
                }
            }
            stage.forward(stage_weights, &mut films, tape);
        }
        self.join(weights, count, tape);
    }

    /// The context from the stages' outputs.
    fn join(&self, weights: Weights<PackedContext>, count: usize, tape: &mut ContextTape) {
        let params = weights.params;
        let last = tape.stages[STAGES - 1].output();
        let channels = self.join_maximum.inputs;
        // g, the maximum over the points, and the point that has it.
        tape.maximum.clear();
        tape.maximum.extend_from_slice(&last[..channels]);
        tape.highest.clear();
        tape.highest.resize(channels, 0);
        for (index, row) in last.chunks_exact(channels).enumerate() {
            for (k, value) in row.iter().enumerate() {
                if *value > tape.maximum[k] {
                    (tape.maximum[k], tape.highest[k]) = (*value, index);
                }
            }
        }
        tape.shift.resize(self.join_maximum.outputs, 0.0);
        self.join_maximum
            .forward(params, &tape.maximum, &mut tape.shift);

        let Normed {
            features,
            tape: norm,
        } = &mut tape.joined;
        features.resize(count * self.join_maximum.outputs, 0.0);
        tape.activated.resize(features.len(), 0.0);
        fill_rows(features, &tape.shift);
        let operands = &mut tape.operands;
        for (k, (join, stage)) in self.joins.iter().zip(&tape.stages).enumerate() {
            let weights = weights.of(|packed| &packed.joins[k]);
            join.par_add_product(weights, operands, stage.output(), features);
        }
        let rows = Rows::points(count);
        self.join_norm
            .forward(params, rows, features, norm, &mut tape.activated);
        tape.context.resize(count * self.output.outputs, 0.0);
        let output = weights.of(|packed| &packed.output);
        self.output
            .par_forward(output, operands, &tape.activated, &mut tape.context);
    }

    /// Backward pass of [`ContextNet::forward`], from `d_context` `(N, F)`.
    ///
    /// Adds to `gradient`, and to the gradients by shift and films.
    pub fn backward(
        &self,
        input: ContextInput,
        d_context: &[f32],
        tape: &mut ContextTape,
        gradient: &mut [f32],
        [d_shift, mut d_films]: [&mut [f32]; 2],
    ) {
        let ContextInput {
            weights,
            points,
            mut films,
            ..
        } = input;
        self.join_backward(weights, d_context, tape, gradient);
        let (operands, sums) = (&mut tape.operands, &mut tape.sums);
        for (s, stage) in self.stages.iter().enumerate().rev() {
            let (before, tape_s) = tape.stages.split_at_mut(s);
            let tape_s = &mut tape_s[0];
            let stage_weights = weights.of(|packed| &packed.stages[s]);
            stage.backward(stage_weights, &mut films, tape_s, gradient, &mut d_films);
            let project = stage_weights.of(|packed| &packed.project);
            let d = &tape_s.d;
            match before.last_mut() {
                None => {
                    let project = project.floats();
                    stage
                        .project
                        .par_backward_weight(project, operands, gradient, points, d);
                    let rows = Rows::points(d.len() / d_shift.len());
                    sums.add_columns(d, rows, d_shift);
                }
                Some(before) => {
                    let both = [before.output(), d];
                    stage
                        .project
                        .par_backward(project, operands, gradient, both, sums);
                    stage.project.par_input_gradient(
                        project,
                        operands,
                        Accum::Add,
                        d,
                        &mut before.d,
                    );
                }
            }
        }
    }

    /// Gradients by the stages' outputs, as far as they come from the joining layer.
    fn join_backward(
        &self,
        weights: Weights<PackedContext>,
        d_context: &[f32],
        tape: &mut ContextTape,
        gradient: &mut [f32],
    ) {
        let rows = Rows::points(d_context.len() / self.output.outputs);
        let params = weights.params;
        let (d, sums, operands) = (&mut tape.d_activated, &mut tape.sums, &mut tape.operands);
        let output = weights.of(|packed| &packed.output);
        self.output.par_backward(
            output,
            operands,
            gradient,
            [&tape.activated, d_context],
            sums,
        );
        d.resize(tape.activated.len(), 0.0);
        self.output
            .par_input_gradient(output, operands, Accum::Replace, d_context, d);
        let Normed {
            features,
            tape: norm,
        } = &mut tape.joined;
        self.join_norm
            .backward(params, rows, features, norm, d, gradient);

        for (k, (join, stage)) in self.joins.iter().zip(&mut tape.stages).enumerate() {
            let weights = weights.of(|packed| &packed.joins[k]);
            join.par_backward_weight(weights, operands, gradient, stage.output(), d);
            stage.d.resize(rows.count * join.inputs, 0.0);
            join.par_input_gradient(weights, operands, Accum::Replace, d, &mut stage.d);
        }
        let d_shift = &mut tape.shift;
        d_shift.fill(0.0);
        sums.add_columns(d, rows, d_shift);
        self.join_maximum.backward(gradient, &tape.maximum, d_shift);
        tape.d_maximum.resize(tape.maximum.len(), 0.0);
        self.join_maximum
            .backward_input(params, d_shift, &mut tape.d_maximum);
        let d_last = &mut tape.stages[STAGES - 1].d;
        let channels = tape.maximum.len();
        for (k, (highest, d)) in tape.highest.iter().zip(&tape.d_maximum).enumerate() {
            d_last[highest * channels + k] += d;
        }
    }
}

/// What the context network acts on.
#[derive(Clone, Copy)]
pub struct ContextInput<'a> {
    pub weights: Weights<'a, PackedContext>,
    /// `(N, C)`.
    pub points: &'a [f32],
    /// The embedding's share of the first projection.
    pub shift: &'a [f32],
    /// Scale and offset of every block.
    pub films: &'a [f32],
}

impl<'a> ContextInput<'a> {
    pub fn new(
        weights: Weights<'a, PackedContext>,
        cloud: Cloud<'a>,
        modulation: Split<&'a [f32]>,
    ) -> Self {
        Self {
            weights,
            points: cloud.points,
            shift: modulation.shift,
            films: modulation.films,
        }
    }
}
