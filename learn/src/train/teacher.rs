//! Distillation of a trained network: its many small steps, learned as a few large ones.
//!
//! A prediction in few evaluations is learned from a network, not from data. In an MLP a point moves alone, so its trajectory is a
//! map from three numbers to three, which a second network of the same size makes in a few steps. The Hybrid's points see one
//! another, and this does not hold for it.

use rand::RngExt;
use rayon::prelude::*;

use super::error::SettingsError;
use super::model::Model;
use super::samples::Samples;
use super::settings::{Target, TrainSettings};
use crate::data::Normalisation;
use crate::flow::{FlowPath, Method, Sampler, Stream, rng};
use crate::net::{Network, NetworkShape};
use crate::symmetry::Reduction;

/// Fewest steps of a teacher trajectory: more do not make the teacher's own predictions better.
const TEACHER_STEPS: usize = 16;

/// A trained network whose trajectories a student learns to follow in a few steps.
///
/// At the points `X(t_k)` of a teacher trajectory, the student learns the mean velocity
/// `(X(t_{k+1}) - X(t_k)) / (t_{k+1} - t_k)` over each step of its own sampler, Euler's method ([`TrainSettings::sampler`]):
/// with these velocities it follows the trajectory exactly. This is distillation as by Salimans and Ho (ICLR 2022), but to
/// the final number of steps at once. Conditions are uniform in the teacher's training range, reduced by the symmetries that it
/// was trained with; no data are needed.
#[derive(Clone, Debug)]
pub struct Teacher {
    network: Network,
    path: FlowPath,
    /// [`Sampler::denoise`] of its own predictions.
    denoise: Option<f32>,
    normalisation: Normalisation,
    reduction: Reduction,
}

impl Teacher {
    /// `model` as a teacher.
    ///
    /// # Errors
    /// [`SettingsError`] where `model` is a student itself, or starts from a simulated surface.
    pub fn new(model: &Model) -> Result<Self, SettingsError> {
        if !model.settings.prior.is_gaussian() {
            return Err(SettingsError::new(
                "the teacher's prior",
                "surface",
                "gaussian: a flow that starts from a simulated surface is not distilled",
            ));
        }
        match model.settings.target {
            Target::Velocity => Ok(Self {
                network: model.network.clone(),
                path: model.settings.path,
                denoise: model.settings.sampler.denoise,
                normalisation: model.provenance.normalisation.clone(),
                reduction: model.provenance.reduction.clone(),
            }),
            Target::Steps => Err(SettingsError::new(
                "the teacher's target",
                Target::Steps.name(),
                "velocity: a distilled network cannot teach",
            )),
        }
    }

    /// The teacher's network: the best start for a student.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Returns an error for a student of another shape, or settings that do not distil this teacher.
    pub(super) fn check(
        &self,
        shape: &NetworkShape,
        settings: &TrainSettings,
    ) -> Result<(), SettingsError> {
        let refuse = |field, found: String, expected: String| {
            Err(SettingsError::new(field, found, expected))
        };
        if *shape != self.network.shape() {
            let expected = "the teacher's".into();
            return refuse("the student's shape", format!("{shape:?}"), expected);
        }
        if settings.path != self.path {
            let expected = format!("the teacher's {:?}", self.path);
            return refuse(
                "the student's path",
                format!("{:?}", settings.path),
                expected,
            );
        }
        let Sampler { method, steps, .. } = settings.sampler;
        if method != Method::Euler {
            return refuse(
                "the student's sampler",
                method.name().into(),
                "euler".into(),
            );
        }
        if !settings.clouds.is_multiple_of(steps) {
            let expected = format!("a multiple of the student's {steps} steps");
            return refuse("clouds", settings.clouds.to_string(), expected);
        }
        Ok(())
    }

    /// Draws the batch of step `step`: `settings.clouds / n` trajectories, each divided into the student's `n` steps.
    pub(super) fn draw_batch(&self, settings: &TrainSettings, step: u64, samples: &mut Samples) {
        let Sampler { steps, grid, .. } = settings.sampler;
        let shape = self.network.shape();
        let (channels, dim) = (shape.channels(), shape.condition_dim());
        let cloud = settings.points * channels.count();
        let trajectories = settings.clouds / steps;
        let times = grid
            .times(steps)
            .expect("a checked sampler of Euler's method has a fixed grid");
        samples.times = times[..steps].repeat(trajectories);
        samples.conditions.clear();
        samples.points.resize(settings.clouds * cloud, 0.0);
        samples.targets.resize(settings.clouds * cloud, 0.0);
        let mut rng = rng(settings.seed, Stream::Step(step));
        for points in samples.points.chunks_exact_mut(steps * cloud) {
            let values = dim - self.reduction.view_numbers();
            let condition = self.reduced((0..values).map(|_| rng.random()).collect());
            samples.conditions.extend(condition.repeat(steps));
            self.path
                .sample_prior(&mut rng, channels, &mut points[..cloud]);
        }
        let fine = self.sampler(settings.sampler);
        let conditions = samples.conditions.par_chunks_exact(steps * dim);
        let trajectories = samples.points.par_chunks_exact_mut(steps * cloud);
        let trajectories = trajectories.zip(samples.targets.par_chunks_exact_mut(steps * cloud));
        trajectories
            .zip(conditions)
            .for_each(|((points, targets), condition)| {
                self.walk(&fine, &condition[..dim], &times, points, targets);
            });
    }

    /// The teacher's sampler for a student's: on its grid, through all the times at which its steps end; and a denoising, which
    /// the student's last step includes.
    fn sampler(&self, student: Sampler) -> Sampler {
        Sampler {
            method: Method::Exponential,
            steps: student.steps * TEACHER_STEPS.div_ceil(student.steps),
            denoise: self.denoise,
            ..student
        }
    }

    /// What the teacher is told of a dimensionless condition.
    fn reduced(&self, condition: Vec<f32>) -> Vec<f32> {
        if self.reduction.is_trivial() {
            return condition;
        }
        let command = self.normalisation.command(&condition);
        let reduced = self.reduction.reduce(&command, &self.normalisation);
        let reduced = reduced.expect("a condition of the teacher's dimension");
        reduced.condition
    }

    /// One trajectory by the sampler `fine`. `points` `(n, N C)` begins with samples of the prior and receives the points at
    /// which the student's steps begin; the steps lie between the `times` `(n + 1)`; `targets` receives their mean velocities.
    fn walk(
        &self,
        fine: &Sampler,
        condition: &[f32],
        times: &[f32],
        points: &mut [f32],
        targets: &mut [f32],
    ) {
        let steps = times.len() - 1;
        let cloud = points.len() / steps;
        let every = fine.steps / steps;
        let mut now = points[..cloud].to_vec();
        fine.integrate_observed(&self.network, condition, &mut now, |taken, reached| {
            if !taken.is_multiple_of(every) {
                return;
            }
            let end = taken / every;
            let h = times[end] - times[end - 1];
            let start = (end - 1) * cloud..end * cloud;
            let moves = points[start.clone()].iter().zip(reached);
            for (target, (from, to)) in targets[start].iter_mut().zip(moves) {
                *target = (to - from) / h;
            }
            if end < steps {
                points[end * cloud..(end + 1) * cloud].copy_from_slice(reached);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::TimeGrid;
    use crate::net::{Channels, MlpShape, TimeFeatures};
    use tdcr_sim::symmetry::Symmetries;

    /// From the beginning of any step, the remaining steps lead to the end of the teacher trajectory.
    #[test]
    fn the_steps_of_a_lesson_make_the_teachers_way() {
        let shape = MlpShape {
            width: 16,
            depth: 2,
            embedding: 8,
            condition_dim: 2,
            octaves: 0,
            time_features: TimeFeatures::Plain,
            channels: Channels::Xyz,
        };
        let network = Network::new(shape, &mut rng(3, Stream::Parameters)).expect("a shape");
        let grid = TimeGrid::Power(2.0);
        let teacher = Teacher {
            network,
            path: FlowPath::default(),
            denoise: Some(0.995),
            normalisation: Normalisation {
                motor_min: vec![0.0; 2],
                motor_max: vec![1.0; 2],
                scale: 1.0,
            },
            reduction: Reduction::default(),
        };
        let settings = TrainSettings {
            clouds: 6,
            points: 5,
            sampler: Sampler {
                method: Method::Euler,
                steps: 3,
                grid,
                ..Sampler::PAPER
            },
            ..TrainSettings::default()
        };
        let times = grid.times(3).expect("a fixed grid");
        let mut samples = Samples::default();
        teacher.draw_batch(&settings, 1, &mut samples);
        let cloud = 5 * 3;
        for way in 0..2 {
            let first = 3 * way;
            let condition = &samples.conditions[2 * first..2 * first + 2];
            let mut end = samples.points[first * cloud..(first + 1) * cloud].to_vec();
            let fine = teacher.sampler(settings.sampler);
            fine.integrate(&teacher.network, condition, &mut end);
            for start in 0..3 {
                let place = first + start;
                let mut x = samples.points[place * cloud..(place + 1) * cloud].to_vec();
                for k in start..3 {
                    let h = times[k + 1] - samples.times[first + k];
                    let velocity = &samples.targets[(first + k) * cloud..(first + k + 1) * cloud];
                    x.iter_mut().zip(velocity).for_each(|(x, v)| *x += h * v);
                }
                let error = x.iter().zip(&end).map(|(a, b)| (a - b).abs());
                assert!(error.fold(0.0, f32::max) < 1e-5, "way {way} from {start}");
            }
        }
    }

    /// The teacher knows representatives alone.
    #[test]
    fn conditions_are_representatives_where_the_teacher_has_symmetries() {
        let shape = MlpShape {
            width: 16,
            depth: 2,
            embedding: 8,
            condition_dim: 4,
            octaves: 0,
            time_features: TimeFeatures::Plain,
            channels: Channels::Xyz,
        };
        let swap = serde_json::json!([
            {"tendons": [0, 1], "matrix": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "translation": [0.0, 0.0, 0.0]},
            {"tendons": [1, 0], "matrix": [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "translation": [0.0, 0.0, 0.0]},
        ]);
        let symmetries: Symmetries = serde_json::from_value(swap).expect("symmetries");
        let teacher = Teacher {
            network: Network::new(shape, &mut rng(3, Stream::Parameters)).expect("a shape"),
            path: FlowPath::default(),
            denoise: None,
            normalisation: Normalisation {
                motor_min: vec![0.01, 0.0],
                motor_max: vec![0.03, 0.04],
                scale: 0.4,
            },
            reduction: Reduction::new(symmetries, &Symmetries::default()),
        };
        let settings = TrainSettings {
            clouds: 64,
            points: 2,
            sampler: Sampler {
                method: Method::Euler,
                steps: 1,
                ..Sampler::PAPER
            },
            ..TrainSettings::default()
        };
        let mut samples = Samples::default();
        teacher.draw_batch(&settings, 1, &mut samples);
        let mut seen = [0; 2];
        for condition in samples.conditions.as_chunks::<4>().0 {
            let command = teacher.normalisation.command(&condition[..2]);
            assert!(command[0] <= command[1] + 1e-9, "{command:?}");
            let view = [[1.0, 0.0], [0.0, 1.0]]
                .iter()
                .position(|one| condition[2..] == *one);
            seen[view.expect("one view")] += 1;
        }
        assert!(seen.iter().all(|&count| count > 10), "{seen:?}");
    }
}
