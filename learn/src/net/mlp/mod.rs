//! The MLP.

mod batch;
mod conditioner;
mod shape;
mod shares;
mod trunk;
mod trunk_bf16;
mod trunk_f32;
mod trunk_tiles;
mod velocity;

pub use batch::{Batch, Loss};
pub use conditioner::{Conditioner, ConditionerTape, Part};
pub use shape::MlpShape;
pub use shares::{PointPass, STRIPE, Share, add_trunk_gradients, divide, reset};
pub use trunk::Trunk;
pub use trunk_bf16::PackedTrunk;
pub use trunk_tiles::TrunkTapes;
pub use velocity::{Mlp, MlpWorkspace};
