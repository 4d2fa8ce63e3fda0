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
use crate::flow::{FlowPath, Method, Sampler, Stream, VelocityField, rng};
use crate::net::{Network, NetworkShape};
use crate::symmetry::Reduction;

/// Fewest steps of a teacher trajectory: more do not make the teacher's own predictions better.
const TEACHER_STEPS: usize = 16;

/// A trained network whose trajectories a student learns to follow in a few steps.
///
/// At the points `X(t_k)` of a teacher trajectory, the student learns the mean velocity
/// `(X(t_{k+1}) - X(t_k)) / (t_{k+1} - t_k)` over each step of its own sampler, Euler's method ([`TrainSettings::sampler`]):
/// with these velocities it follows the trajectory exactly. Its velocities are not these to the last digit, and what it does from
/// where its own steps lead it would not be learned so. So in every other trajectory its steps begin there (as DAgger does: Ross,
/// Gordon and Bagnell, AISTATS 2011), and the teacher says how to go on. This is distillation as by Salimans and Ho (ICLR 2022), but to
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
    pub(super) fn draw_batch(
        &self,
        settings: &TrainSettings,
        student: &Network,
        step: u64,
        samples: &mut Samples,
    ) {
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
        let lessons = trajectories.zip(conditions).enumerate();
        lessons.for_each(|(k, ((points, targets), condition))| {
            let lesson = Lesson {
                fine: &fine,
                condition: &condition[..dim],
                times: &times,
            };
            match k % 2 {
                0 => self.lead(&lesson, points, targets),
                _ => self.accompany(&lesson, student, points, targets),
            }
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

    /// The teacher's own trajectory. `points` `(n, N C)` begins with samples of the prior and receives the points at which the
    /// student's steps begin; `targets` receives the mean velocities over these steps.
    fn lead(&self, lesson: &Lesson, points: &mut [f32], targets: &mut [f32]) {
        let cloud = points.len() / lesson.steps();
        let mut now = points[..cloud].to_vec();
        let Lesson {
            fine, condition, ..
        } = lesson;
        fine.integrate_observed(&self.network, condition, &mut now, |taken, reached| {
            if !taken.is_multiple_of(lesson.every()) {
                return;
            }
            let end = taken / lesson.every();
            let (before, after) = points.split_at_mut(end * cloud);
            let start = &before[(end - 1) * cloud..];
            lesson.mean_velocity(end - 1, start, reached, &mut targets[(end - 1) * cloud..]);
            if let Some(next) = after.get_mut(..cloud) {
                next.copy_from_slice(reached);
            }
        });
    }

    /// The student's trajectory: as [`Teacher::lead`], but each step begins where the student's step before ends.
    fn accompany(
        &self,
        lesson: &Lesson,
        student: &Network,
        points: &mut [f32],
        targets: &mut [f32],
    ) {
        let cloud = points.len() / lesson.steps();
        let Lesson {
            fine,
            condition,
            times,
        } = *lesson;
        let mut reached = vec![0.0; cloud];
        for (k, target) in targets.chunks_exact_mut(cloud).enumerate() {
            let (before, after) = points.split_at_mut((k + 1) * cloud);
            let start = &before[k * cloud..];
            reached.copy_from_slice(start);
            let part = k * lesson.every()..(k + 1) * lesson.every();
            fine.integrate_part(&self.network, condition, part, &mut reached);
            lesson.mean_velocity(k, start, &reached, target);
            if let Some(next) = after.get_mut(..cloud) {
                student.velocity(times[k], condition, start, next);
                let h = times[k + 1] - times[k];
                next.iter_mut()
                    .zip(start)
                    .for_each(|(v, x)| *v = x + h * *v);
            }
        }
    }
}

/// What a trajectory is taught by.
struct Lesson<'a> {
    /// The teacher's sampler.
    fine: &'a Sampler,
    condition: &'a [f32],
    /// The times `(n + 1)` between which the student's steps lie.
    times: &'a [f32],
}

impl Lesson<'_> {
    /// Steps of the student.
    fn steps(&self) -> usize {
        self.times.len() - 1
    }

    /// Steps of the teacher in one of the student's.
    fn every(&self) -> usize {
        self.fine.steps / self.steps()
    }

    /// The mean velocity of the student's step `k` from `start` to `end`.
    fn mean_velocity(&self, k: usize, start: &[f32], end: &[f32], velocity: &mut [f32]) {
        let h = self.times[k + 1] - self.times[k];
        for ((v, from), to) in velocity.iter_mut().zip(start).zip(end) {
            *v = (to - from) / h;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::TimeGrid;
    use crate::net::{Channels, MlpShape, TimeFeatures};
    use tdcr_sim::symmetry::Symmetries;

    fn network(condition_dim: usize, seed: u64) -> Network {
        let shape = MlpShape {
            width: 16,
            depth: 2,
            embedding: 8,
            condition_dim,
            octaves: 0,
            time_features: TimeFeatures::Plain,
            channels: Channels::Xyz,
        };
        Network::new(shape, &mut rng(seed, Stream::Parameters)).expect("a shape")
    }

    const GRID: TimeGrid = TimeGrid::Power(2.0);

    /// A teacher of two numbers, and settings of two trajectories of five points in three steps.
    fn two_lessons() -> (Teacher, TrainSettings) {
        let teacher = Teacher {
            network: network(2, 3),
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
                grid: GRID,
                ..Sampler::PAPER
            },
            ..TrainSettings::default()
        };
        (teacher, settings)
    }

    /// Numbers of a cloud of [`two_lessons`].
    const CLOUD: usize = 5 * 3;

    fn assert_near(x: &[f32], expected: &[f32]) {
        let error = x.iter().zip(expected).map(|(a, b)| (a - b).abs());
        assert!(
            error.fold(0.0, f32::max) < 1e-5,
            "{x:?}, expected {expected:?}"
        );
    }

    /// From the beginning of any step, the remaining steps lead to the end of the teacher trajectory.
    #[test]
    fn the_steps_of_a_lesson_make_the_teachers_way() {
        let (teacher, settings) = two_lessons();
        let times = GRID.times(3).expect("a fixed grid");
        let mut samples = Samples::default();
        teacher.draw_batch(&settings, &network(2, 4), 1, &mut samples);
        let condition = &samples.conditions[..2];
        let points: Vec<_> = samples.points.chunks_exact(CLOUD).collect();
        let mut end = points[0].to_vec();
        let fine = teacher.sampler(settings.sampler);
        fine.integrate(&teacher.network, condition, &mut end);
        for (start, points) in points.iter().enumerate().take(3) {
            let mut x = points.to_vec();
            let targets = samples.targets.chunks_exact(CLOUD).enumerate();
            for (k, velocity) in targets.take(3).skip(start) {
                step(&mut x, velocity, times[k + 1] - samples.times[k]);
            }
            assert_near(&x, &end);
        }
    }

    /// The second trajectory is the student's, and from each of its points the teacher says how to go on.
    #[test]
    fn every_other_lesson_is_about_the_students_own_way() {
        let (teacher, settings) = two_lessons();
        let student = network(2, 4);
        let times = GRID.times(3).expect("a fixed grid");
        let mut samples = Samples::default();
        teacher.draw_batch(&settings, &student, 1, &mut samples);
        let condition = &samples.conditions[6..8];
        let own: Vec<_> = samples.points.chunks_exact(CLOUD).skip(3).collect();
        let targets: Vec<_> = samples.targets.chunks_exact(CLOUD).skip(3).collect();
        let fine = teacher.sampler(settings.sampler);
        let every = fine.steps / 3;
        for k in 0..3 {
            let h = times[k + 1] - times[k];
            let mut taught = own[k].to_vec();
            step(&mut taught, targets[k], h);
            let mut expected = own[k].to_vec();
            fine.integrate_part(
                &teacher.network,
                condition,
                k * every..(k + 1) * every,
                &mut expected,
            );
            assert_near(&taught, &expected);
            if let Some(next) = own.get(k + 1) {
                let mut velocity = [0.0; CLOUD];
                student.velocity(times[k], condition, own[k], &mut velocity);
                let mut reached = own[k].to_vec();
                step(&mut reached, &velocity, h);
                assert_near(&reached, next);
            }
        }
    }

    /// `x += h v`.
    fn step(x: &mut [f32], v: &[f32], h: f32) {
        x.iter_mut().zip(v).for_each(|(x, v)| *x += h * v);
    }

    /// The teacher knows representatives alone.
    #[test]
    fn conditions_are_representatives_where_the_teacher_has_symmetries() {
        let swap = serde_json::json!([
            {"tendons": [0, 1], "matrix": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "translation": [0.0, 0.0, 0.0]},
            {"tendons": [1, 0], "matrix": [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "translation": [0.0, 0.0, 0.0]},
        ]);
        let symmetries: Symmetries = serde_json::from_value(swap).expect("symmetries");
        let teacher = Teacher {
            network: network(4, 3),
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
        teacher.draw_batch(&settings, &teacher.network, 1, &mut samples);
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
