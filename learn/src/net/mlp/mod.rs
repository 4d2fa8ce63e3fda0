//! The MLP: every point alone, under FiLM by flow time and condition. The Hybrid's head is one too.
//!
//! Symbols as in the page of [`net`](crate::net): `e` `(E)` is the embedding of flow time and condition; a cloud's *modulation*
//! vector holds all that is affine in `e`. `B` clouds of `N` points have `C` numbers each, `H` features inside.
//!
//! | file | holds |
//! |---|---|
//! | `point_features` | what the input layer takes of a point |
//! | `time_features` | what it sees of the flow time |
//! | `condition` | the condition's way to the embedding |
//! | `conditioner` | what is computed once per cloud: the modulation vector |
//! | `trunk` | the layers that act on points, and the trait of a pass over a tile of them |
//! | `trunk_f32`, `trunk_bf16` | that pass in either operand type |
//! | `trunk_tiles` | the trunk on any number of points |
//! | `shape` | sizes and their bounds |
//! | `batch` | what a network is trained on, and the loss |
//! | `shares` | a batch divided for parallel work |
//! | `velocity` | the network |
//!
//! The FiLM gains and the command's part of the input layer are computed once per cloud, only the trunk per point. Points go
//! through in tiles that stay in cache; products of floats are faer's, element-wise loops are vectorised by pulp. Both choose
//! their kernels at run time; `tests/python/test_kernels.py` runs them under QEMU as processors without AVX-512 and AVX2 would.

mod batch;
mod condition;
mod conditioner;
mod point_features;
mod shape;
mod shares;
mod time_features;
mod trunk;
mod trunk_bf16;
mod trunk_f32;
mod trunk_tiles;
mod velocity;

pub use batch::{Batch, Cloud, Loss};
pub use conditioner::{Conditioner, ConditionerTape, EmbeddingShape, Film, Part};
pub use point_features::point_inputs;
pub use shape::MlpShape;
pub use shares::{PointPass, STRIPE, Share, add_gradients, divide};
pub use time_features::TimeFeatures;
pub use trunk::Trunk;
pub use trunk_bf16::PackedTrunk;
pub use trunk_tiles::TrunkTapes;
pub use velocity::{Mlp, MlpWorkspace};
