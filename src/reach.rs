//! The command under which a trained network sees a wanted cloud: shape control of a robot that is known only from data.
//!
//! Predictions for commands near one another start from the same noise and are alike point by point
//! ([`Model::predict_alike`]), so that differences of them are derivatives of the predicted points `p_i` by the command: `J_i`. Each step
//! matches points of both clouds in two ways: with the nearest ones of the other cloud, as iterated closest points do (Besl and McKay, IEEE Trans.
//! Pattern Anal. Mach. Intell. 14, 1992), and one to one by optimal transport, which matches far clouds part by part where the nearest point is one of
//! another part. For each it takes the damped least-squares change of the command that brings matched points together, `min Σ |J_i d - (w_j - p_i)|² +
//! damping |d|²` within the commands of the training data and a trust region, for nearest points also two and four times as much, and goes the best of these ways.

use nalgebra::{DMatrix, DVector, Matrix3xX, Vector3};
use tdcr_control::quadratic::QuadraticProgram;
use tdcr_learn::flow::Sampler;
use tdcr_learn::metrics::{MetricError, emd_squared, nearest_distances, nearest_indices};
use tdcr_learn::predict::PredictError;
use tdcr_learn::train::Model;
use thiserror::Error;

/// Change of a command for a difference, and the first trust region, in parts of the command's range.
const DIFFERENCE: f64 = 0.01;
const FIRST_TRUST: f64 = 0.3;
/// Trust region below which a search has come to its end.
const SMALLEST_TRUST: f64 = 1e-4;
/// Multiples of a change that are tried: matched points that are nearest are nearer than those that belong together, so that its changes
/// are too small.
const NEAREST_LENGTHS: [f64; 3] = [1.0, 2.0, 4.0];
const TRANSPORT_LENGTHS: [f64; 1] = [1.0];
/// Most points that are matched one to one.
const TRANSPORTED: usize = 512;
/// Damping of changes, in units of the clouds' mean square extent per range.
const DAMPING: f64 = 1e-4;

/// How a command is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudSearch {
    /// Most steps.
    pub steps: usize,
    /// Points of the predicted clouds.
    pub points: usize,
    /// Mean distance between the clouds (m) at which the search ends.
    pub tolerance: f64,
    /// Seed of the noise that predictions start from.
    pub seed: u64,
}

impl Default for CloudSearch {
    fn default() -> Self {
        Self {
            steps: 20,
            points: 2048,
            tolerance: 0.0,
            seed: 0,
        }
    }
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudReached {
    /// The command, and the payload (kg) where the model takes one.
    pub condition: Vec<f64>,
    /// Mean distance of the points of each cloud from the other, the mean of both ways (m): before the first step, and after each.
    pub distances: Vec<f64>,
    /// The predicted cloud (m, world frame).
    pub cloud: Vec<[f32; 3]>,
}

impl CloudReached {
    /// The last distance (m).
    pub fn distance(&self) -> f64 {
        self.distances.last().copied().unwrap_or(f64::NAN)
    }
}

/// Why no command can be looked for.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CloudReachError {
    /// The wanted cloud is none.
    #[error("the wanted cloud: {0}")]
    Wanted(#[from] MetricError),
    /// The condition to start from does not fit, or the network has no cloud for it.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// No points to compare.
    #[error("{0} points of predicted clouds; expected 16 or more")]
    Points(usize),
}

/// Fewest points of a predicted cloud.
const FEWEST: usize = 16;

/// Looks for the command whose predicted cloud is nearest to the points `wanted` (m, world frame), from the condition `start`: the command,
/// and the payload (kg) where the model takes one, which stays. `go_on` is asked before each step whether to.
///
/// # Errors
/// [`CloudReachError`].
pub fn reach_cloud(
    model: &Model,
    sampler: &Sampler,
    wanted: &[[f32; 3]],
    start: &[f64],
    search: &CloudSearch,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<CloudReached, CloudReachError> {
    if search.points < FEWEST {
        return Err(CloudReachError::Points(search.points));
    }
    nearest_distances(wanted, wanted)?;
    let descent = Descent {
        model,
        // Spare points are left out by how they lie, which is not the same for two clouds.
        sampler: Sampler {
            spare: 0.0,
            ..*sampler
        },
        wanted,
        search,
        motors: motors(model),
    };
    let mut at = start.to_vec();
    let [mut cloud] = descent.clouds(&[at.clone()])?;
    let mut distances = vec![mean_distance(&cloud, wanted)?];
    let mut trust = FIRST_TRUST;
    for _ in 0..search.steps {
        let now = distances[distances.len() - 1];
        if now <= search.tolerance || trust < SMALLEST_TRUST || !go_on() {
            break;
        }
        let (to, there, distance) = descent.best(&at, &descent.changes(&at, trust)?)?;
        match distance < now {
            true => {
                (at, cloud) = (to, there);
                distances.push(distance);
                trust = (2.0 * trust).min(1.0);
            }
            false => {
                distances.push(now);
                trust /= 4.0;
            }
        }
    }
    Ok(CloudReached {
        condition: at,
        distances,
        cloud,
    })
}

/// Mean distance of the points of each cloud from the other, the mean of both ways (m).
///
/// # Errors
/// An empty cloud, or a coordinate that is not finite.
pub fn mean_distance(p: &[[f32; 3]], q: &[[f32; 3]]) -> Result<f64, MetricError> {
    let mean = |p, q| -> Result<f64, MetricError> {
        let distances = nearest_distances(p, q)?;
        Ok(distances.iter().sum::<f64>() / distances.len() as f64)
    };
    Ok((mean(p, q)? + mean(q, p)?) / 2.0)
}

/// Numbers of a condition that are a command's: all but the payload.
fn motors(model: &Model) -> usize {
    let all = model.provenance.normalisation.motor_min.len();
    let subject = model.provenance.subject.as_ref();
    match subject.and_then(|subject| subject.payload) {
        Some(_) => all - 1,
        None => all,
    }
}

/// A condition, its cloud (m), and how far that is from the wanted one in the mean (m).
type Trial = (Vec<f64>, Vec<[f32; 3]>, f64);

/// A predicted point, the wanted one that it is matched with, and what that counts.
#[derive(Clone, Copy)]
struct Pair {
    i: usize,
    j: usize,
    weight: f64,
}

struct Descent<'a> {
    model: &'a Model,
    sampler: Sampler,
    wanted: &'a [[f32; 3]],
    search: &'a CloudSearch,
    motors: usize,
}

impl Descent<'_> {
    /// Smallest and largest value of a motor in the training data, and how far they are apart.
    fn range(&self, motor: usize) -> [f64; 3] {
        let units = &self.model.provenance.normalisation;
        let (low, high) = (units.motor_min[motor], units.motor_max[motor]);
        [low, high, high - low]
    }

    fn clouds<const N: usize>(
        &self,
        conditions: &[Vec<f64>],
    ) -> Result<[Vec<[f32; 3]>; N], PredictError> {
        let mut clouds = self.predict(conditions)?.into_iter();
        Ok(std::array::from_fn(|_| clouds.next().unwrap_or_default()))
    }

    fn predict(&self, conditions: &[Vec<f64>]) -> Result<Vec<Vec<[f32; 3]>>, PredictError> {
        let CloudSearch { points, seed, .. } = *self.search;
        let predicted = self
            .model
            .predict_alike(conditions, points, seed, &self.sampler)?;
        Ok(predicted.into_iter().map(|cloud| cloud.points).collect())
    }

    /// The best of the conditions that changes lead to. With its cloud (m) and how far that is from the wanted one in the mean (m).
    fn best(&self, at: &[f64], changes: &[Vec<f64>]) -> Result<Trial, CloudReachError> {
        let to = |change: &Vec<f64>| -> Vec<f64> {
            let moved = at.iter().zip(change).map(|(at, change)| at + change);
            let clamped = moved.enumerate().map(|(k, value)| match k < self.motors {
                true => {
                    let [low, high, _] = self.range(k);
                    value.clamp(low, high)
                }
                false => value,
            });
            clamped.collect()
        };
        let tried: Vec<Vec<f64>> = changes.iter().map(to).collect();
        let mut best: Option<Trial> = None;
        for (condition, cloud) in tried.iter().zip(self.predict(&tried)?) {
            let distance = mean_distance(&cloud, self.wanted)?;
            if best.as_ref().is_none_or(|(.., least)| distance < *least) {
                best = Some((condition.clone(), cloud, distance));
            }
        }
        best.ok_or(CloudReachError::Points(0))
    }

    /// The changes of the condition that are tried in a step. Before they are lengthened, no motor's is larger than the share `trust` of its
    /// range.
    fn changes(&self, at: &[f64], trust: f64) -> Result<Vec<Vec<f64>>, CloudReachError> {
        // A motor that never moved in the data says nothing.
        let moved: Vec<usize> = (0..self.motors)
            .filter(|&k| self.range(k)[2] > 0.0)
            .collect();
        let mut conditions = vec![at.to_vec()];
        let mut steps = Vec::with_capacity(moved.len());
        for &k in &moved {
            let [low, high, width] = self.range(k);
            let step = match at[k] < (low + high) / 2.0 {
                true => DIFFERENCE * width,
                false => -DIFFERENCE * width,
            };
            let mut condition = at.to_vec();
            condition[k] += step;
            conditions.push(condition);
            steps.push(step / width);
        }
        let clouds = self.predict(&conditions)?;
        let here = &clouds[0];
        let slopes: Vec<Matrix3xX<f64>> = (0..here.len())
            .map(|i| {
                Matrix3xX::from_fn(moved.len(), |axis, k| {
                    f64::from(clouds[k + 1][i][axis] - here[i][axis]) / steps[k]
                })
            })
            .collect();
        let mut changes = Vec::new();
        for (pairs, lengths) in [
            (self.nearest(here)?, &NEAREST_LENGTHS[..]),
            (self.transported(here)?, &TRANSPORT_LENGTHS[..]),
        ] {
            let change = self.change(
                at,
                trust,
                &moved,
                self.normal_equations(here, &slopes, &pairs),
            );
            let times = |times: &f64| change.iter().map(|change| times * change).collect();
            changes.extend(lengths.iter().map(times));
        }
        Ok(changes)
    }

    /// The minimiser of damped normal equations, of the motors `moved` in parts of their ranges, as a change of the condition.
    fn change(
        &self,
        at: &[f64],
        trust: f64,
        moved: &[usize],
        (mut hessian, gradient): (DMatrix<f64>, DVector<f64>),
    ) -> Vec<f64> {
        let scale = hessian.trace() / moved.len() as f64;
        for k in 0..moved.len() {
            hessian[(k, k)] += DAMPING * scale + f64::MIN_POSITIVE;
        }
        let mut rows = DMatrix::zeros(2 * moved.len(), moved.len());
        let mut bounds = DVector::zeros(2 * moved.len());
        for (place, &k) in moved.iter().enumerate() {
            let [low, high, width] = self.range(k);
            (rows[(2 * place, place)], rows[(2 * place + 1, place)]) = (1.0, -1.0);
            bounds[2 * place] = ((high - at[k]) / width).clamp(0.0, trust);
            bounds[2 * place + 1] = ((at[k] - low) / width).clamp(0.0, trust);
        }
        let program = QuadraticProgram {
            hessian,
            gradient,
            rows,
            bounds,
        };
        let mut change = vec![0.0; at.len()];
        // Without a minimiser there is no step, and the trust region shrinks.
        if let Some(solved) = program.solve() {
            for (place, &k) in moved.iter().enumerate() {
                change[k] = solved.x[place] * self.range(k)[2];
            }
        }
        change
    }

    /// Each point with the nearest of the other cloud, both ways, each way's weights together 1.
    fn nearest(&self, here: &[[f32; 3]]) -> Result<Vec<Pair>, MetricError> {
        let pair = |i, j, count: usize| Pair {
            i,
            j,
            weight: 1.0 / count as f64,
        };
        let there = nearest_indices(here, self.wanted)?.into_iter().enumerate();
        let back = nearest_indices(self.wanted, here)?.into_iter().enumerate();
        let there = there.map(|(i, j)| pair(i, j, here.len()));
        let back = back.map(|(j, i)| pair(i, j, self.wanted.len()));
        Ok(there.chain(back).collect())
    }

    /// As many points of both clouds, spread evenly over their orders, one to one such that their mean squared distance is the least.
    fn transported(&self, here: &[[f32; 3]]) -> Result<Vec<Pair>, MetricError> {
        let count = TRANSPORTED.min(here.len()).min(self.wanted.len());
        let place = |k: usize, all: usize| k * all / count;
        let some = |cloud: &[[f32; 3]]| -> Vec<[f32; 3]> {
            (0..count).map(|k| cloud[place(k, cloud.len())]).collect()
        };
        let matched = emd_squared(&some(here), &some(self.wanted))?.matching;
        let pair = |(k, partner): (usize, usize)| Pair {
            i: place(k, here.len()),
            j: place(partner, self.wanted.len()),
            weight: 2.0 / count as f64,
        };
        Ok(matched.into_iter().enumerate().map(pair).collect())
    }

    /// Of matched points: sums of `J'J`, and of `-J'(w - p)`.
    fn normal_equations(
        &self,
        here: &[[f32; 3]],
        slopes: &[Matrix3xX<f64>],
        pairs: &[Pair],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let n = slopes.first().map_or(0, Matrix3xX::ncols);
        let (mut hessian, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for &Pair { i, j, weight } in pairs {
            let off = Vector3::from_fn(|axis, _| {
                f64::from(self.wanted[j][axis]) - f64::from(here[i][axis])
            });
            let slope = &slopes[i];
            hessian += slope.tr_mul(slope) * weight;
            gradient -= slope.tr_mul(&off) * weight;
        }
        (hessian, gradient)
    }
}
