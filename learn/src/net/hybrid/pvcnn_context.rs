//! The authors' context network, as a trained network has it: no backward pass.

use super::context_kind::{Context, Split};
use super::context_shape::{ContextShape, STAGES, Stage, block_name};
use crate::net::kernels::bfloat16::Operands;
use crate::net::kernels::float32::{Rows, activate, fill_rows};
use crate::net::layers::{AffineNorm, BatchNorm, Dense, GroupNorm, Normed, Passes, Weights};
use crate::net::mlp::{Cloud, Conditioner, ConditionerTape, EmbeddingShape, Film, Part};
use crate::net::parameters::{Initial, Table, fan_in};
use crate::net::voxel::{Grid, PVCNN_EPSILON, PvcnnBlock, PvcnnInput, PvcnnScratch, Voxels};

/// What the voxels' cube is wider than the ball of the points, in normalised units.
const SLACK: f32 = 1e-6;

/// Point-voxel context `(N, F)` of a cloud's points `(N, C)`, with an embedding `e'` of its own of flow time and condition:
///
/// ```text
/// f_1 = blocks(ReLU(BN(W_1 x + W_e e' + b)))            first stage; PvcnnBlock each
/// f_s = blocks(ReLU(BN(W_s f_(s-1) + b_s)))             further stages, on coarser grids
/// g   = W_2 SiLU(W_1 max f_3 + b_1) + b_2               max over the points
/// c   = W_o SiLU(GN(W_j [f_1 | f_2 | f_3 | g] + b_j)) + b_o
/// ```
///
/// `W_o` and `b_o` start at zero, and so does the context.
#[derive(Clone, Debug)]
pub struct PvcnnContext {
    conditioner: Conditioner,
    features: usize,
    stages: Vec<PvcnnStage>,
    global: [Dense; 2],
    join: Dense,
    join_norm: AffineNorm,
    output: Dense,
}

#[derive(Clone, Debug)]
struct PvcnnStage {
    grid: Grid,
    project: Dense,
    norm: BatchNorm,
    blocks: Vec<PvcnnBlock>,
}

/// Buffers of one cloud's pass.
#[derive(Debug)]
pub struct PvcnnTape {
    conditioner: ConditionerTape,
    voxels: Vec<Voxels>,
    scratch: PvcnnScratch,
    /// Outputs of the stages.
    features: [Vec<f32>; STAGES],
    spare: Vec<f32>,
    /// Maximum over the points, and the layers on it.
    global: [Vec<f32>; 4],
    concatenated: Vec<f32>,
    joined: Normed,
    activated: Vec<f32>,
    operands: Operands,
    /// The context of the points, `(N, F)`.
    pub context: Vec<f32>,
}

/// With an embedding of its own, beside the head's. Its products are of floats in either operand type, as the authors have it.
impl Context for PvcnnContext {
    type Tape = PvcnnTape;
    type Packed = ();

    fn modulation(
        _: &ContextShape,
        _embedding: usize,
        _inputs: usize,
    ) -> (Vec<Part<'static>>, Vec<Film>) {
        (Vec::new(), Vec::new())
    }

    fn modulation_lengths(_: &ContextShape) -> [usize; 2] {
        [0, 0]
    }

    fn declare(
        table: &mut Table,
        shape: &ContextShape,
        embedding_shape: EmbeddingShape,
        inputs: usize,
    ) -> Self {
        let embedding = embedding_shape.embedding;
        let first = fan_in(embedding + inputs);
        let parts = [
            Part::new("context.from_embedding", shape.features, fan_in(embedding)),
            Part::new("context.shift", shape.stages[0].channels, first),
        ];
        let films: Vec<Film> = shape.films().collect();
        let conditioner = Conditioner::declare(table, "context.", embedding_shape, &parts, &films);

        let mut before = inputs;
        let stages = shape.stages.into_iter().enumerate();
        let stages = stages.map(|(s, stage)| {
            let name = format!("context.stages.{s}.project");
            let Stage {
                channels,
                resolution,
            } = stage;
            let project = match s {
                // Its bias is part of the embedding's share.
                0 => Dense::declare_unbiased(table, &name, before, channels, first),
                _ => Dense::declare(table, &name, before, channels, fan_in(before)),
            };
            before = channels;
            let grid = Grid { resolution };
            let norm = format!("{name}_norm");
            PvcnnStage {
                grid,
                project,
                norm: BatchNorm::declare(table, &norm, channels, PVCNN_EPSILON, 0.0),
                blocks: (0..shape.blocks)
                    .map(|b| PvcnnBlock::declare(table, &block_name(s, b), channels, grid))
                    .collect(),
            }
        });
        let stages: Vec<PvcnnStage> = stages.collect();
        let global = [0, 1].map(|k| {
            let name = format!("context.global.{k}");
            Dense::declare(table, &name, before, before, fan_in(before))
        });
        let all = before
            + shape
                .stages
                .map(|stage| stage.channels)
                .iter()
                .sum::<usize>();
        let joined = shape.joined;
        Self {
            conditioner,
            features: shape.features,
            stages,
            global,
            join: Dense::declare(table, "context.join", all, joined, fan_in(all)),
            join_norm: AffineNorm::declare(table, "context.join_norm", GroupNorm::authors(joined)),
            output: Dense::declare(
                table,
                "context.output",
                joined,
                shape.features,
                Initial::Constant(0.0),
            ),
        }
    }

    fn tape(&self) -> PvcnnTape {
        let stages = self.stages.iter();
        PvcnnTape {
            conditioner: ConditionerTape::default(),
            voxels: stages.map(|stage| Voxels::new(stage.grid, SLACK)).collect(),
            scratch: PvcnnScratch::default(),
            features: Default::default(),
            spare: Vec::new(),
            global: Default::default(),
            concatenated: Vec::new(),
            joined: Normed::default(),
            activated: Vec::new(),
            operands: Operands::default(),
            context: Vec::new(),
        }
    }

    fn flops(&self, points: usize) -> u64 {
        let stages = self.stages.iter().map(|stage| {
            let blocks = stage.blocks.iter().map(|block| block.flops(points));
            stage.project.flops(points) + blocks.sum::<u64>()
        });
        let global = self.global.iter().map(|layer| layer.flops(1));
        let join = self.join.flops(points) + self.output.flops(points);
        self.conditioner.flops() + stages.sum::<u64>() + global.sum::<u64>() + join
    }

    fn pack(&self, _params: &[f32], _: Passes, (): &mut ()) {}

    fn contexts<'a>(
        &self,
        weights: Weights<'a, ()>,
        cloud: Cloud<'a>,
        _: Split<&'a [f32]>,
        tape: &'a mut PvcnnTape,
    ) -> (&'a [f32], &'a [f32]) {
        let params = weights.params;
        let Cloud {
            time,
            condition,
            points,
        } = cloud;
        self.conditioner
            .forward(params, &[time], condition, &mut tape.conditioner);
        let modulation = &tape.conditioner.modulation[..];
        let (global, rest) = modulation.split_at(self.features);
        let (shift, mut films) = rest.split_at(self.stages[0].project.outputs);
        let weights = Weights {
            params,
            packed: None,
        };
        let columns = self.stages[0].project.inputs;
        let rows = Rows::points(points.len() / columns);
        for (s, (stage, voxels)) in self.stages.iter().zip(&mut tape.voxels).enumerate() {
            voxels.place(points, columns);
            let c = stage.project.outputs;
            let (before, after) = tape.features.split_at_mut(s);
            let (h, spare) = (&mut after[0], &mut tape.spare);
            h.resize(rows.count * c, 0.0);
            let operands = &mut tape.operands;
            match before.last() {
                None => {
                    fill_rows(h, shift);
                    stage.project.par_add_product(weights, operands, points, h);
                }
                Some(before) => stage.project.par_forward(weights, operands, before, h),
            }
            stage.norm.forward(params, rows, h);
            for block in &stage.blocks {
                let (film, rest) = films.split_at(2 * c);
                films = rest;
                let input = PvcnnInput {
                    params,
                    film: film.split_at(c).into(),
                    voxels,
                    features: h,
                };
                block.forward(input, &mut tape.scratch, spare);
                std::mem::swap(h, spare);
            }
        }
        let PvcnnTape {
            features,
            global: branch,
            concatenated,
            joined,
            activated,
            operands,
            context,
            ..
        } = tape;
        self.join(weights.params, rows, features, branch, concatenated);
        let Normed {
            features: joined,
            tape: norm,
        } = joined;
        joined.resize(rows.count * self.join.outputs, 0.0);
        activated.resize(joined.len(), 0.0);
        context.resize(rows.count * self.features, 0.0);
        self.join
            .par_forward(weights, operands, concatenated, joined);
        self.join_norm
            .forward(params, rows, joined, norm, activated);
        self.output
            .par_forward(weights, operands, activated, context);
        (context, global)
    }
}

impl PvcnnContext {
    /// Fills `concatenated` with `[f_1 | f_2 | f_3 | g]`.
    fn join(
        &self,
        params: &[f32],
        rows: Rows,
        features: &[Vec<f32>; STAGES],
        [maximum, hidden, slope, global]: &mut [Vec<f32>; 4],
        concatenated: &mut Vec<f32>,
    ) {
        let [first, second] = &self.global;
        let c = first.inputs;
        let last = &features[STAGES - 1];
        maximum.clear();
        maximum.extend_from_slice(&last[..c]);
        for row in last.chunks_exact(c) {
            let pairs = maximum.iter_mut().zip(row);
            pairs.for_each(|(most, value)| *most = most.max(*value));
        }
        // g = W_2 SiLU(W_1 max f_3 + b_1) + b_2.
        for buffer in [&mut *hidden, slope, global] {
            buffer.resize(c, 0.0);
        }
        first.forward(params, maximum, global);
        activate(global, hidden, slope);
        second.forward(params, hidden, global);

        concatenated.clear();
        for row in 0..rows.count {
            for (stage, features) in self.stages.iter().zip(features) {
                let c = stage.project.outputs;
                concatenated.extend_from_slice(&features[row * c..(row + 1) * c]);
            }
            concatenated.extend_from_slice(global);
        }
    }
}
