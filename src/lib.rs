//! Tendon-driven continuum robots: simulate, see, learn, predict, evaluate.
pub mod pipeline;
pub mod report;

pub use tdcr_learn as learn;
pub use tdcr_sim as sim;
