//! AdamW with clipping by the global norm, and the running average of the weights.

use rayon::prelude::*;

/// Decays of the first and second moments, and the term that keeps the quotient finite.
const BETA: [f64; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-8;

/// Parameters that one task updates.
const STRIPE: usize = 8192;

/// Adam's moments of the gradient, one per parameter (Loshchilov and Hutter 2019, Algorithm 2).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AdamW {
    pub first_moment: Vec<f32>,
    pub second_moment: Vec<f32>,
}

/// What one update is made with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Update {
    /// Step number, the first is 1.
    pub step: u64,
    pub learning_rate: f64,
    pub weight_decay: f64,
    /// Decay of the running average of the weights.
    pub average_decay: f64,
    /// Factor on the gradient.
    pub gradient_scale: f64,
}

impl AdamW {
    pub fn new(parameters: usize) -> Self {
        Self {
            first_moment: vec![0.0; parameters],
            second_moment: vec![0.0; parameters],
        }
    }

    /// Moves `params` against `gradient`, and `average` towards the new `params`.
    pub fn update(
        &mut self,
        update: &Update,
        gradient: &[f32],
        params: &mut [f32],
        average: &mut [f32],
    ) {
        let step = update.step as f64;
        let kept = (1.0 - update.learning_rate * update.weight_decay) as f32;
        let rate = (update.learning_rate / (1.0 - BETA[0].powf(step))) as f32;
        let unbias = (1.0 / (1.0 - BETA[1].powf(step)).sqrt()) as f32;
        let gradient_scale = update.gradient_scale as f32;
        let [gain1, gain2] = BETA.map(|beta| (1.0 - beta) as f32);
        let average_gain = (1.0 - update.average_decay) as f32;
        params
            .par_chunks_mut(STRIPE)
            .zip(average.par_chunks_mut(STRIPE))
            .zip(gradient.par_chunks(STRIPE))
            .zip(self.first_moment.par_chunks_mut(STRIPE))
            .zip(self.second_moment.par_chunks_mut(STRIPE))
            .for_each(|((((params, average), gradient), first), second)| {
                let weights = params.iter_mut().zip(average).zip(gradient);
                for (((p, a), g), (m, v)) in weights.zip(first.iter_mut().zip(second)) {
                    let g = gradient_scale * g;
                    *m += gain1 * (g - *m);
                    *v += gain2 * (g * g - *v);
                    *p = kept * *p - rate * *m / (unbias * v.sqrt() + EPSILON);
                    *a += average_gain * (*p - *a);
                }
            });
    }
}

/// Euclidean norm of `gradient`, summed in a fixed order.
pub(super) fn norm(gradient: &[f32]) -> f64 {
    sum_of_squares(gradient).sqrt()
}

/// Sum of squares, of halves in parallel.
fn sum_of_squares(numbers: &[f32]) -> f64 {
    if numbers.len() <= STRIPE {
        return numbers.iter().map(|x| f64::from(*x).powi(2)).sum();
    }
    let (left, right) = numbers.split_at(numbers.len() / 2);
    let (left, right) = rayon::join(|| sum_of_squares(left), || sum_of_squares(right));
    left + right
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One parameter, gradients 0.5 then -0.2; expected values from the algorithm worked by hand.
    #[test]
    fn adamw_makes_the_steps_of_its_algorithm() {
        let mut optimizer = AdamW::new(1);
        let (mut params, mut average) = ([1.0], [1.0]);
        let mut update = Update {
            step: 1,
            learning_rate: 0.1,
            weight_decay: 0.01,
            average_decay: 0.75,
            gradient_scale: 1.0,
        };
        optimizer.update(&update, &[0.5], &mut params, &mut average);
        // m = 0.05, v = 2.5e-4, quotient 1: 0.999 - 0.1.
        assert!((params[0] - 0.899).abs() < 1e-6);
        assert!((average[0] - 0.97475).abs() < 1e-6);
        update.step = 2;
        optimizer.update(&update, &[-0.2], &mut params, &mut average);
        // m = 0.025 (unbiased 0.025/0.19), v = 2.8975e-4 (unbiased 2.8975e-4/1.999e-3).
        let expected = 0.899 * 0.999 - 0.1 * (0.025 / 0.19) / (2.8975e-4f64 / 1.999e-3).sqrt();
        assert!((f64::from(params[0]) - expected).abs() < 1e-6);
    }

    #[test]
    fn norm_is_euclidean() {
        assert_eq!(norm(&[3.0, 0.0, -4.0]), 5.0);
        assert!((norm(&vec![0.1; 20_000]) - (20_000f64 * 0.01).sqrt()).abs() < 1e-6);
    }
}
