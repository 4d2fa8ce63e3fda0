//! Flow matching (Lipman et al., ICLR 2023): the straight path from prior to data, their coupling, random streams, and the
//! sampler that integrates a learned velocity field ([`VelocityField`]).

mod coupling;
mod error;
mod multistep;
mod path;
mod random;
mod reach;
mod sampler;
mod time_grid;

pub use coupling::Coupling;
pub use error::FlowError;
pub use path::{FlowPath, LATE_TIMES};
pub use random::{Stream, rng};
pub use reach::Reach;
pub use sampler::{ColorSteps, Method, Sampler, VelocityField};
pub use time_grid::TimeGrid;
