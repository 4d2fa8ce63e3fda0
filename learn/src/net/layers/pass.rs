//! Parameters as layers take them.

/// All parameters, and the weights of one layer or more in tiles where their products are of bfloat16 numbers.
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
    /// The same for a part of the layers.
    pub fn of<Q>(self, part: impl FnOnce(&'a P) -> &'a Q) -> Weights<'a, Q> {
        Weights {
            params: self.params,
            packed: self.packed.map(part),
        }
    }

    /// The same in floats.
    pub fn floats(self) -> Self {
        Self {
            packed: None,
            ..self
        }
    }
}
