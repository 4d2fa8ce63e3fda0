//! Optimisers with clipping by the global norm, and the running average of the weights.

use serde::{Deserialize, Serialize};

use super::orthogonal::Orthogonaliser;
use crate::net::TensorSpec;
use crate::pool::Pool;

/// AdamW's decays of the first and second moments, and the term that keeps the quotient finite.
const BETA: [f64; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-8;

/// Decay of Muon's momentum.
const MOMENTUM: f32 = 0.95;

/// Parameters that one task updates.
const STRIPE: usize = 8192;

/// Shortest side of a hidden layer's matrix; those with a shorter one are input and output layers.
const HIDDEN: usize = 16;

/// Optimiser: how gradients move the weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Optimizer {
    /// AdamW for all weights (Loshchilov and Hutter 2019): the paper's.
    #[default]
    AdamW,
    /// Muon for the hidden layers' matrices (Jordan et al. 2024): each step is their momentum, made orthogonal, so that
    /// all directions of a layer learn at one rate; AdamW for all other weights.
    Muon {
        /// Learning rate of the matrices after warm-up; it follows the same schedule as AdamW's.
        learning_rate: f64,
    },
}

impl Optimizer {
    /// Muon at the rate that learned fastest in this project's measurements.
    pub const MUON: Self = Self::Muon {
        learning_rate: 0.02,
    };

    /// The same optimiser, with its own learning rate (if it has one) multiplied by `factor`.
    pub fn scaled(self, factor: f64) -> Self {
        match self {
            Self::AdamW => Self::AdamW,
            Self::Muon { learning_rate } => Self::Muon {
                learning_rate: learning_rate * factor,
            },
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::AdamW => "adamw",
            Self::Muon { .. } => "muon",
        }
    }
}

/// Moments of the gradient, one per parameter. Of a matrix under Muon, the first is its momentum, the second stays 0.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Moments {
    pub first: Vec<f32>,
    pub second: Vec<f32>,
}

/// Moves the weights step by step.
#[derive(Debug)]
pub(super) struct Updater {
    pub moments: Moments,
    /// All parameters, in order.
    pieces: Vec<Piece>,
    orthogonalisers: Pool<Orthogonaliser>,
}

/// Parameters that one task updates.
#[derive(Clone, Copy, Debug)]
enum Piece {
    /// So many numbers, by AdamW.
    Elements(usize),
    /// A matrix `(outputs, inputs)`, by Muon.
    Matrix([usize; 2]),
}

impl Piece {
    fn len(self) -> usize {
        match self {
            Self::Elements(len) => len,
            Self::Matrix([outputs, inputs]) => outputs * inputs,
        }
    }
}

/// Inputs of one update.
#[derive(Clone, Copy, Debug)]
pub(super) struct Update {
    /// Step number, the first is 1.
    pub step: u64,
    pub learning_rate: f64,
    /// Muon's.
    pub matrix_learning_rate: f64,
    pub weight_decay: f64,
    /// Decay of the running average of the weights.
    pub average_decay: f64,
    /// Factor on the gradient.
    pub gradient_scale: f64,
}

/// Some parameters, with their gradients, moments and averages.
struct Slices<'a> {
    gradient: &'a [f32],
    params: &'a mut [f32],
    average: &'a mut [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
}

impl<'a> Slices<'a> {
    fn split_at(self, middle: usize) -> [Self; 2] {
        let gradient = self.gradient.split_at(middle);
        let params = self.params.split_at_mut(middle);
        let average = self.average.split_at_mut(middle);
        let first = self.first.split_at_mut(middle);
        let second = self.second.split_at_mut(middle);
        let left = Self {
            gradient: gradient.0,
            params: params.0,
            average: average.0,
            first: first.0,
            second: second.0,
        };
        let right = Self {
            gradient: gradient.1,
            params: params.1,
            average: average.1,
            first: first.1,
            second: second.1,
        };
        [left, right]
    }
}

impl Updater {
    /// An optimiser without moments, for parameters that consist of `tensors`, in order and without gaps.
    pub fn new(optimizer: Optimizer, tensors: &[TensorSpec]) -> Self {
        let mut pieces = Vec::new();
        for tensor in tensors {
            match (optimizer, &tensor.shape[..]) {
                (Optimizer::Muon { .. }, &[outputs, inputs]) if outputs.min(inputs) >= HIDDEN => {
                    pieces.push(Piece::Matrix([outputs, inputs]));
                }
                _ => {
                    let stripes = tensor.range.clone().step_by(STRIPE);
                    let len = |start: usize| STRIPE.min(tensor.range.end - start);
                    pieces.extend(stripes.map(|start| Piece::Elements(len(start))));
                }
            }
        }
        let parameters = pieces.iter().map(|piece| piece.len()).sum();
        Self {
            moments: Moments {
                first: vec![0.0; parameters],
                second: vec![0.0; parameters],
            },
            pieces,
            orthogonalisers: Pool::default(),
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
        let slices = Slices {
            gradient,
            params,
            average,
            first: &mut self.moments.first,
            second: &mut self.moments.second,
        };
        update.run(&self.pieces, slices, &self.orthogonalisers);
    }
}

impl Update {
    /// Piece by piece in parallel, halving their list.
    fn run(&self, pieces: &[Piece], slices: Slices, orthogonalisers: &Pool<Orthogonaliser>) {
        match pieces {
            [] => {}
            [Piece::Elements(_)] => self.adamw(slices),
            [Piece::Matrix(shape)] => orthogonalisers
                .with(Orthogonaliser::default, |orthogonaliser| {
                    self.muon(*shape, slices, orthogonaliser)
                }),
            _ => {
                let (left, right) = pieces.split_at(pieces.len() / 2);
                let middle = left.iter().map(|piece| piece.len()).sum();
                let [a, b] = slices.split_at(middle);
                rayon::join(
                    || self.run(left, a, orthogonalisers),
                    || self.run(right, b, orthogonalisers),
                );
            }
        }
    }

    /// AdamW (Loshchilov and Hutter 2019, Algorithm 2).
    fn adamw(&self, slices: Slices) {
        let step = self.step as f64;
        let kept = (1.0 - self.learning_rate * self.weight_decay) as f32;
        let rate = (self.learning_rate / (1.0 - BETA[0].powf(step))) as f32;
        let unbias = (1.0 / (1.0 - BETA[1].powf(step)).sqrt()) as f32;
        let gradient_scale = self.gradient_scale as f32;
        let [gain1, gain2] = BETA.map(|beta| (1.0 - beta) as f32);
        let average_gain = (1.0 - self.average_decay) as f32;
        let weights = (slices.params.iter_mut().zip(slices.average)).zip(slices.gradient);
        let moments = slices.first.iter_mut().zip(slices.second);
        for (((p, a), g), (m, v)) in weights.zip(moments) {
            let g = gradient_scale * g;
            *m += gain1 * (g - *m);
            *v += gain2 * (g * g - *v);
            *p = kept * *p - rate * *m / (unbias * v.sqrt() + EPSILON);
            *a += average_gain * (*p - *a);
        }
    }

    /// Muon with Nesterov's momentum (Jordan et al. 2024); the step of a tall matrix is scaled by the square root of its ratio
    /// of sides.
    fn muon(
        &self,
        [outputs, inputs]: [usize; 2],
        slices: Slices,
        orthogonaliser: &mut Orthogonaliser,
    ) {
        let gradient_scale = self.gradient_scale as f32;
        let momenta = slices.first.iter_mut().zip(slices.gradient);
        let ahead = momenta.map(|(m, g)| {
            let g = gradient_scale * g;
            *m = MOMENTUM * *m + g;
            g + MOMENTUM * *m
        });
        let direction = orthogonaliser.run(ahead, [outputs, inputs]);
        let kept = (1.0 - self.matrix_learning_rate * self.weight_decay) as f32;
        let tall = (outputs as f64 / inputs as f64).max(1.0).sqrt();
        let rate = (self.matrix_learning_rate * tall) as f32;
        let average_gain = (1.0 - self.average_decay) as f32;
        let weights = slices.params.iter_mut().zip(slices.average);
        for ((p, a), d) in weights.zip(direction) {
            *p = kept * *p - rate * *d;
            *a += average_gain * (*p - *a);
        }
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
    use crate::net::TensorRole;

    fn tensor(start: usize, shape: &[usize]) -> TensorSpec {
        TensorSpec {
            role: TensorRole::Learned,
            name: format!("from {start}"),
            shape: shape.to_vec(),
            range: start..start + shape.iter().product::<usize>(),
        }
    }

    const FIRST: Update = Update {
        step: 1,
        learning_rate: 0.1,
        matrix_learning_rate: 0.5,
        weight_decay: 0.01,
        average_decay: 0.75,
        gradient_scale: 1.0,
    };

    /// One parameter, gradients 0.5 then -0.2; expected values from the algorithm worked by hand.
    #[test]
    fn adamw_makes_the_steps_of_its_algorithm() {
        let mut updater = Updater::new(Optimizer::AdamW, &[tensor(0, &[1])]);
        let (mut params, mut average) = ([1.0], [1.0]);
        updater.update(&FIRST, &[0.5], &mut params, &mut average);
        // m = 0.05, v = 2.5e-4, quotient 1: 0.999 - 0.1.
        assert!((params[0] - 0.899).abs() < 1e-6);
        assert!((average[0] - 0.97475).abs() < 1e-6);
        let second = Update { step: 2, ..FIRST };
        updater.update(&second, &[-0.2], &mut params, &mut average);
        // m = 0.025 (unbiased 0.025/0.19), v = 2.8975e-4 (unbiased 2.8975e-4/1.999e-3).
        let expected = 0.899 * 0.999 - 0.1 * (0.025 / 0.19) / (2.8975e-4f64 / 1.999e-3).sqrt();
        assert!((f64::from(params[0]) - expected).abs() < 1e-6);
    }

    /// A gradient that is a multiple of a permutation has one singular value: the step is the permutation times what the
    /// five iterations make of `1/sqrt(n)`, times the rate; worked by hand for both steps.
    #[test]
    fn muon_steps_by_the_rate_in_every_direction_of_a_matrix() {
        let n = HIDDEN;
        let mut updater = Updater::new(Optimizer::MUON, &[tensor(0, &[n, n])]);
        let shifted = |row: usize| row * n + (row + 1) % n;
        let mut gradient = vec![0.0; n * n];
        (0..n).for_each(|row| gradient[shifted(row)] = 1e-3);
        let mut reached = 1.0 / (n as f64).sqrt();
        for _ in 0..5 {
            let square = reached * reached;
            reached *= 3.4445 - 4.7750 * square + 2.0315 * square * square;
        }
        let (mut params, mut average) = (vec![1.0; n * n], vec![1.0; n * n]);
        updater.update(&FIRST, &gradient, &mut params, &mut average);
        let kept = 1.0 - 0.5 * 0.01;
        let expected = kept - 0.5 * reached;
        let found = f64::from(params[shifted(3)]);
        assert!((found - expected).abs() < 1e-4, "{found} for {expected}");
        assert!((f64::from(params[0]) - kept).abs() < 1e-6);
        let middle = 0.75 + 0.25 * expected;
        assert!((f64::from(average[shifted(3)]) - middle).abs() < 1e-4);
        // Without a gradient, the momentum goes on the same way.
        gradient.fill(0.0);
        let second = Update { step: 2, ..FIRST };
        updater.update(&second, &gradient, &mut params, &mut average);
        let found = f64::from(params[shifted(3)]);
        let expected = expected * kept - 0.5 * reached;
        assert!((found - expected).abs() < 1e-4, "{found} for {expected}");
    }

    #[test]
    fn muon_leaves_thin_matrices_and_vectors_to_adamw() {
        let tensors = [
            tensor(0, &[64, 3]),
            tensor(192, &[20_000]),
            tensor(20_192, &[3, 64]),
        ];
        let run = |optimizer| {
            let mut updater = Updater::new(optimizer, &tensors);
            let gradient: Vec<f32> = (0..20_384).map(|k| (k as f32).sin()).collect();
            let (mut params, mut average) = (vec![1.0; 20_384], vec![1.0; 20_384]);
            updater.update(&FIRST, &gradient, &mut params, &mut average);
            params
        };
        assert_eq!(run(Optimizer::MUON), run(Optimizer::AdamW));
    }

    #[test]
    fn norm_is_euclidean() {
        assert_eq!(norm(&[3.0, 0.0, -4.0]), 5.0);
        assert!((norm(&vec![0.1; 20_000]) - (20_000f64 * 0.01).sqrt()).abs() < 1e-6);
    }
}
