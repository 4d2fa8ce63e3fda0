//! Clouds in, a trained shape predictor out.
mod atomic;
pub mod data;
pub mod flow;
pub mod metrics;
pub mod net;
pub mod train;
