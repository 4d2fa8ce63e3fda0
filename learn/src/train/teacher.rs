//! Distillation of a trained network: its many small steps, learned as a few large ones.
//!
//! A prediction in few evaluations is learned from a network, not from data. In an MLP a point moves alone, so its trajectory is a
//! map from three numbers to three, which a second network of the same size makes in a few steps. The Hybrid's points see one
//! another, and this does not hold for it.

use rand::RngExt;
use rayon::prelude::*;
use tdcr_base::hash::hash_all;

use super::error::SettingsError;
use super::model::Model;
use super::refined::Refined;
use super::samples::Samples;
use super::settings::{Target, TrainSettings};
use super::start;
use super::trajectory::Trajectory;
use crate::data::Normalisation;
use crate::flow::{FlowPath, Method, Reach, Sampler, Stream, rng};
use crate::net::{Network, NetworkShape};
use crate::symmetry::Reduction;

/// Fewest steps of a teacher trajectory: more do not make the teacher's own predictions better.
const TEACHER_STEPS: usize = 16;

/// A trained network whose trajectories a student learns to follow in a few steps.
///
/// At the points `X(t_k)` of a teacher trajectory, the student learns the mean velocity `(X(t_{k+1}) - X(t_k)) / (t_{k+1} -
/// t_k)` over each step of its own sampler, Euler's method ([`TrainSettings::sampler`]): with these velocities it follows the
/// trajectory exactly. Its own velocities differ, and what to do at the points where its own steps end would not be learned so:
/// every other trajectory is the student's, and from each of its points the teacher continues (DAgger: Ross, Gordon and
/// Bagnell, AISTATS 2011). Where the student's sampler denoises, its last evaluation learns the data that the teacher predicts
/// for the points where the student's steps end; a student that denoises at the time for which the teacher has a refined network takes
/// that network over, and its correction with it. This is distillation as by Salimans and Ho (ICLR 2022), but to the final
/// number of steps at once. Conditions are uniform in the teacher's training range, reduced by the symmetries that it was
/// trained with; no data are needed.
#[derive(Clone, Debug)]
pub struct Teacher {
    network: Network,
    path: FlowPath,
    /// [`Sampler::denoise`] of its own predictions.
    denoise: Option<f32>,
    /// The network of this denoising, where it has another.
    refinement: Option<Network>,
    reach: Option<Reach>,
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
                refinement: model.refinement.clone(),
                reach: model.reach,
                normalisation: model.provenance.normalisation.clone(),
                reduction: model.provenance.reduction.clone(),
            }),
            target @ (Target::Steps | Target::Refinement) => Err(SettingsError::new(
                "the teacher's target",
                target.name(),
                "velocity: a distilled network cannot teach",
            )),
        }
    }

    /// The teacher's network: the best start for a student.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The network of its last denoising, where it has another one for that and a student with `sampler` denoises at the same time: the
    /// student takes it over.
    pub(super) fn lent(&self, sampler: &Sampler) -> Option<&Network> {
        (self.refinement.as_ref()).filter(|_| sampler.denoise == self.denoise)
    }

    /// How many of the evaluations of a student with `sampler` are learned.
    fn learned(&self, sampler: &Sampler) -> usize {
        sampler.evaluations() - usize::from(self.lent(sampler).is_some())
    }

    /// A hash of its weights.
    pub(super) fn fingerprint(&self) -> u64 {
        let own = start::fingerprint(&self.network);
        match &self.refinement {
            None => own,
            Some(last) => hash_all(&[own, start::fingerprint(last)]),
        }
    }

    /// The velocities that its predictions follow.
    fn field(&self) -> Refined<'_> {
        Refined {
            flow: &self.network,
            last: self.denoise.zip(self.refinement.as_ref()),
            reach: self.reach,
        }
    }

    /// Returns an error for a student of another shape, or settings that do not distil this teacher.
    pub(super) fn check(
        &self,
        shape: &NetworkShape,
        settings: &TrainSettings,
    ) -> Result<(), SettingsError> {
        let own = self.network.shape();
        SettingsError::unless_equal("the student's shape", shape, &own, "the teacher's")?;
        let path = format!("the teacher's {:?}", self.path);
        SettingsError::unless_equal("the student's path", &settings.path, &self.path, path)?;
        let method = settings.sampler.method;
        if method != Method::Euler {
            let field = "the student's sampler";
            return Err(SettingsError::new(field, method.name(), "euler"));
        }
        let evaluations = self.learned(&settings.sampler);
        if !settings.clouds.is_multiple_of(evaluations) {
            let expected = format!("a multiple of the student's {evaluations} learned evaluations");
            return Err(SettingsError::new("clouds", settings.clouds, expected));
        }
        Ok(())
    }

    /// Draws the batch of step `step`: `settings.clouds / n` trajectories, each of which is a cloud for each of the `n`
    /// evaluations that the student learns.
    pub(super) fn draw_batch(
        &self,
        settings: &TrainSettings,
        student: &Network,
        step: u64,
        samples: &mut Samples,
    ) {
        let Sampler {
            steps,
            grid,
            denoise,
            ..
        } = settings.sampler;
        let denoise = denoise.filter(|_| self.lent(&settings.sampler).is_none());
        let evaluations = self.learned(&settings.sampler);
        let shape = self.network.shape();
        let (channels, dim) = (shape.channels(), shape.condition_dim());
        let cloud = settings.points * channels.count();
        let trajectories = settings.clouds / evaluations;
        let times = grid
            .times(steps)
            .expect("a checked sampler of Euler's method has a fixed grid");
        let starts: Vec<f32> = times[..steps].iter().copied().chain(denoise).collect();
        samples.times = starts.repeat(trajectories);
        samples.conditions.clear();
        samples.points.resize(settings.clouds * cloud, 0.0);
        samples.targets.resize(settings.clouds * cloud, 0.0);
        let mut rng = rng(settings.seed, Stream::Step(step));
        for points in samples.points.chunks_exact_mut(evaluations * cloud) {
            let values = dim - self.reduction.view_numbers();
            let condition = self.reduced((0..values).map(|_| rng.random()).collect());
            samples.conditions.extend(condition.repeat(evaluations));
            self.path
                .sample_prior(&mut rng, channels, &mut points[..cloud]);
        }
        let fine = self.sampler(settings.sampler);
        let conditions = samples.conditions.par_chunks_exact(evaluations * dim);
        let trajectories = samples.points.par_chunks_exact_mut(evaluations * cloud);
        let targets = samples.targets.par_chunks_exact_mut(evaluations * cloud);
        let batch = trajectories.zip(targets).zip(conditions).enumerate();
        batch.for_each(|(k, ((points, targets), condition))| {
            let trajectory = Trajectory {
                teacher: self.field(),
                fine: &fine,
                student,
                condition: &condition[..dim],
                times: &times,
                denoise,
            };
            match k % 2 {
                0 => trajectory.of_teacher(points, targets),
                _ => trajectory.of_student(points, targets),
            }
        });
    }

    /// The teacher's sampler for a student's: on its grid, through all the times at which its steps end; and a denoising, which
    /// the student's last step includes unless it has the teacher's network for that.
    fn sampler(&self, student: Sampler) -> Sampler {
        Sampler {
            method: Method::Exponential,
            steps: student.steps * TEACHER_STEPS.div_ceil(student.steps),
            denoise: self.denoise.filter(|_| self.lent(&student).is_none()),
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::{TimeGrid, VelocityField};
    use crate::net::{Channels, MlpShape, TimeFeatures};
    use tdcr_sim::symmetry::Symmetries;

    fn network(condition_dim: usize, seed: u64) -> Network {
        let shape = MlpShape {
            width: 16,
            depth: 2,
            embedding: 8,
            condition_dim,
            condition_blocks: 0,
            octaves: 0,
            time_features: TimeFeatures::Plain,
            channels: Channels::Xyz,
        };
        Network::new(shape, &mut rng(seed, Stream::Parameters)).expect("a shape")
    }

    const GRID: TimeGrid = TimeGrid::Power(2.0);

    /// A teacher of two numbers, and settings of two trajectories of five points in three steps.
    fn two_trajectories() -> (Teacher, TrainSettings) {
        let teacher = Teacher {
            network: network(2, 3),
            path: FlowPath::default(),
            denoise: Some(0.995),
            refinement: None,
            reach: None,
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

    /// Numbers of a cloud of [`two_trajectories`].
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
    fn the_steps_of_the_first_make_the_teacher_trajectory() {
        let (teacher, settings) = two_trajectories();
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
    fn the_second_follows_the_student() {
        let (teacher, settings) = two_trajectories();
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
                |_, _| {},
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

    /// The last evaluation of a student that denoises begins where its own steps end, whichever way is taught.
    #[test]
    fn a_denoising_learns_what_the_teacher_makes_of_the_students_end() {
        let (teacher, settings) = two_trajectories();
        let t = 0.9;
        let settings = TrainSettings {
            clouds: 8,
            sampler: Sampler {
                denoise: Some(t),
                ..settings.sampler
            },
            ..settings
        };
        let student = network(2, 4);
        let times = GRID.times(3).expect("a fixed grid");
        let mut samples = Samples::default();
        teacher.draw_batch(&settings, &student, 1, &mut samples);
        let condition = |k: usize| &samples.conditions[2 * k..2 * k + 2];
        let points: Vec<_> = samples.points.chunks_exact(CLOUD).collect();
        let targets: Vec<_> = samples.targets.chunks_exact(CLOUD).collect();
        for last in [3, 7] {
            assert_eq!(samples.times[last], t);
            let mut velocity = [0.0; CLOUD];
            student.velocity(times[2], condition(last), points[last - 1], &mut velocity);
            let mut reached = points[last - 1].to_vec();
            step(&mut reached, &velocity, times[3] - times[2]);
            assert_near(points[last], &reached);
            let mut clean = reached.clone();
            for t in [t, 0.995] {
                clean.iter_mut().for_each(|x| *x *= t);
                teacher
                    .network
                    .velocity(t, condition(last), &clean, &mut velocity);
                step(&mut clean, &velocity, 1.0 - t);
            }
            step(&mut reached, targets[last], 1.0 - t);
            assert_near(&reached, &clean);
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
            refinement: None,
            reach: None,
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
