//! Clouds in, a trained shape predictor out.
pub mod data;
pub mod flow;
pub mod net;
pub mod train;
