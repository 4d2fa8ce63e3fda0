//! What all layers' passes have in common: how they take parameters, and what they keep.

/// All parameters; where the operand type is bfloat16 also the weights of one layer or more, packed into tiles.
#[derive(Debug)]
pub struct Weights<'a, P> {
    pub params: &'a [f32],
    pub packed: Option<&'a P>,
}

impl<P> Clone for Weights<'_, P> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<P> Copy for Weights<'_, P> {}

impl<'a, P> Weights<'a, P> {
    /// The weights of a part of the layers.
    pub fn of<Q>(self, part: impl FnOnce(&'a P) -> &'a Q) -> Weights<'a, Q> {
        Weights {
            params: self.params,
            packed: self.packed.map(part),
        }
    }

    /// The same weights for products of floats.
    pub fn floats(self) -> Self {
        Self {
            packed: None,
            ..self
        }
    }
}

/// Which passes weights are packed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passes {
    /// The forward pass alone.
    Forward,
    /// Both.
    Training,
}

/// What a forward pass keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// All that a backward pass needs.
    EveryBlock,
    /// Nothing beyond a block: the blocks share memory, which then stays in the cache (a tenth faster).
    Nothing,
}
