//! The MLP.

mod batch;
mod conditioner;
mod shape;
mod trunk;
mod trunk_bf16;
mod velocity;

pub use batch::{
    Batch, COLOR_WEIGHT, Loss, PointPass, STRIPE, Share, Workspace, add_trunk_gradients, divide,
    reset,
};
pub use conditioner::{Conditioner, ConditionerTape, Part};
pub use shape::{
    Initial, MlpShape, ShapeError, Table, TensorSpec, fan_in, require_parameters, require_size,
};
pub use trunk::{Keep, Trunk, TrunkTapes};
pub use trunk_bf16::PackedTrunk;
pub use velocity::Mlp;
