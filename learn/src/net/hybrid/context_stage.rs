//! A stage of the context network: blocks with one number of channels, on grids of one resolution.

use rayon::prelude::*;

use super::context_shape::{Stage, block_name};
use crate::net::layers::{Dense, PackedWeight, Passes, Weights};
use crate::net::parameters::Table;
use crate::net::voxel::{Grid, PackedPvBlock, PvBlock, PvInput, PvScratch, PvTape, Voxels};

#[derive(Clone, Debug)]
pub struct StageNet {
    grid: Grid,
    /// From the points or the stage before, into the first block's features.
    pub project: Dense,
    blocks: Vec<PvBlock>,
}

/// The stage's weights in tiles.
#[derive(Debug, Default)]
pub struct PackedStage {
    /// Not used by the first stage, whose projection has few inputs.
    pub project: PackedWeight,
    blocks: Vec<PackedPvBlock>,
}

/// Buffers of one cloud's forward and backward pass.
#[derive(Debug)]
pub struct StageTape {
    pub voxels: Voxels,
    /// Input of every block, then the stage's output.
    features: Vec<Vec<f32>>,
    blocks: Vec<PvTape>,
    scratch: PvScratch,
    /// Gradient by the stage's output, then by its input.
    pub d: Vec<f32>,
}

impl StageTape {
    /// Input of the first block.
    pub fn input_mut(&mut self) -> &mut Vec<f32> {
        &mut self.features[0]
    }

    /// Output of the last block.
    pub fn output(&self) -> &[f32] {
        self.features
            .last()
            .expect("the features end with the output")
    }
}

impl StageNet {
    /// Adds the blocks' tensors of stage `s` behind those of `project`.
    pub fn declare(
        table: &mut Table,
        s: usize,
        Stage {
            channels,
            resolution,
        }: Stage,
        project: Dense,
        blocks: usize,
    ) -> Self {
        let grid = Grid { resolution };
        let blocks = (0..blocks)
            .map(|b| PvBlock::declare(table, &block_name(s, b), channels, grid))
            .collect();
        Self {
            grid,
            project,
            blocks,
        }
    }

    /// Floating-point operations of the forward pass over `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        let blocks = self.blocks.iter().map(|block| block.flops(points));
        self.project.flops(points) + blocks.sum::<u64>()
    }

    /// Packs the stage's weights.
    pub fn pack(&self, params: &[f32], passes: Passes, packed: &mut PackedStage) {
        packed.project.set(&self.project, params, passes);
        packed
            .blocks
            .resize_with(self.blocks.len(), PackedPvBlock::default);
        let blocks = self.blocks.par_iter().zip(&mut packed.blocks);
        blocks.for_each(|(block, packed)| block.pack(params, passes, packed));
    }

    /// Buffers for a cloud.
    pub fn tape(&self) -> StageTape {
        StageTape {
            voxels: Voxels::new(self.grid, 0.0),
            features: vec![Vec::new(); self.blocks.len() + 1],
            blocks: self.blocks.iter().map(|_| PvTape::default()).collect(),
            scratch: PvScratch::default(),
            d: Vec::new(),
        }
    }

    /// The stage's blocks; takes their scales and offsets from the front of `films`.
    pub fn forward(&self, weights: Weights<PackedStage>, films: &mut &[f32], tape: &mut StageTape) {
        let c = self.project.outputs;
        for (b, (block, block_tape)) in self.blocks.iter().zip(&mut tape.blocks).enumerate() {
            let (film, rest) = films.split_at(2 * c);
            *films = rest;
            let (input, output) = tape.features.split_at_mut(b + 1);
            let input = PvInput {
                weights: weights.of(|packed| &packed.blocks[b]),
                film: film.split_at(c).into(),
                voxels: &tape.voxels,
                features: &input[b],
            };
            block.forward(input, block_tape, &mut tape.scratch, &mut output[0]);
        }
    }

    /// Turns `tape.d` from the gradient by the output into that by the first block's input; takes the blocks' scales
    /// and offsets, and their gradients, from the ends of `films` and `d_films`.
    pub fn backward(
        &self,
        weights: Weights<PackedStage>,
        films: &mut &[f32],
        tape: &mut StageTape,
        gradient: &mut [f32],
        d_films: &mut &mut [f32],
    ) {
        let c = self.project.outputs;
        for (b, block) in self.blocks.iter().enumerate().rev() {
            let (rest, film) = films.split_at(films.len() - 2 * c);
            *films = rest;
            let start = d_films.len() - 2 * c;
            let d_film = d_films
                .split_off_mut(start..)
                .expect("a gradient per scale and offset");
            let input = PvInput {
                weights: weights.of(|packed| &packed.blocks[b]),
                film: film.split_at(c).into(),
                voxels: &tape.voxels,
                features: &tape.features[b],
            };
            let d_film = d_film.split_at_mut(c).into();
            let StageTape {
                blocks, scratch, d, ..
            } = tape;
            block.backward(input, &mut blocks[b], scratch, d, gradient, d_film);
        }
    }
}
