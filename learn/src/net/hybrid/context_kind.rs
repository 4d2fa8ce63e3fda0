//! What the Hybrid asks of its context network, of which there are two kinds.

use std::fmt;

use super::context_shape::ContextShape;
use crate::net::layers::{Passes, Weights};
use crate::net::mlp::{Cloud, EmbeddingShape, Film, Part};
use crate::net::parameters::Table;

/// A cloud's modulation vector, or the gradient by it, in parts: of the context that the embedding gives, of the context network's
/// first layer, of the head, of the context network's blocks.
#[derive(Clone, Copy)]
pub struct Split<T> {
    pub global: T,
    pub shift: T,
    pub head: T,
    pub films: T,
}

/// A context network: features of the cloud about a point, and one for all points that the embedding gives.
pub trait Context: Clone + fmt::Debug {
    /// Buffers of one cloud's passes.
    type Tape: fmt::Debug;
    /// The weights in tiles.
    type Packed: Default + fmt::Debug;

    /// What it adds to the modulation vector: parts before the head's, and blocks after them.
    fn modulation(
        shape: &ContextShape,
        embedding: usize,
        inputs: usize,
    ) -> (Vec<Part<'static>>, Vec<Film>);

    /// Lengths of [`Split::global`] and [`Split::shift`].
    fn modulation_lengths(shape: &ContextShape) -> [usize; 2];

    /// Adds its tensors, for points of `inputs` numbers.
    fn declare(
        table: &mut Table,
        shape: &ContextShape,
        embedding: EmbeddingShape,
        inputs: usize,
    ) -> Self;

    /// Buffers for a cloud.
    fn tape(&self) -> Self::Tape;

    /// Floating-point operations of the forward pass over `points` points, products alone.
    fn flops(&self, points: usize) -> u64;

    /// Packs its weights.
    fn pack(&self, params: &[f32], passes: Passes, packed: &mut Self::Packed);

    /// The context of the cloud's points `(N, F)`, and the one `(F)` that the embedding gives.
    fn contexts<'a>(
        &self,
        weights: Weights<'a, Self::Packed>,
        cloud: Cloud<'a>,
        modulation: Split<&'a [f32]>,
        tape: &'a mut Self::Tape,
    ) -> (&'a [f32], &'a [f32]);
}
