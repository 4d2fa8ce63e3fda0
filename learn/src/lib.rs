//! Clouds in, a trained shape predictor out.
