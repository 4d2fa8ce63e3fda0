//! Clouds in, a trained shape predictor out.
pub mod data;
pub mod metrics;
