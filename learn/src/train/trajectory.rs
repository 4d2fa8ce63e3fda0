//! One trajectory of a distillation: the inputs of the student's evaluations, and their targets.

use super::refined::Refined;
use crate::flow::{Sampler, VelocityField};
use crate::net::Network;

/// What a trajectory is made by. Its clouds are `(n, N C)`, one for each of the student's `n` evaluations: `points` are the inputs,
/// of which the first is given, a sample of the prior, and `targets` the velocities that are learned.
pub(super) struct Trajectory<'a> {
    pub teacher: Refined<'a>,
    /// The teacher's sampler, of which as many steps lie in each of the student's.
    pub fine: &'a Sampler,
    pub student: &'a Network,
    /// Of both networks.
    pub condition: &'a [f32],
    /// The times between which the student's steps lie.
    pub times: &'a [f32],
    /// Time of the student's last denoising, if it has one.
    pub denoise: Option<f32>,
}

impl Trajectory<'_> {
    /// The teacher trajectory.
    pub fn of_teacher(&self, points: &mut [f32], targets: &mut [f32]) {
        let cloud = self.cloud(points);
        let mut now = points[..cloud].to_vec();
        let Self {
            teacher, condition, ..
        } = *self;
        (self.fine).integrate_observed(&teacher, condition, &mut now, |taken, reached| {
            if !taken.is_multiple_of(self.every()) {
                return;
            }
            let end = taken / self.every();
            let (before, after) = points.split_at_mut(end * cloud);
            let start = &before[(end - 1) * cloud..];
            self.mean_velocity(end - 1, start, reached, &mut targets[(end - 1) * cloud..]);
            if end < self.steps() {
                after[..cloud].copy_from_slice(reached);
            }
        });
        self.denoising(points, targets);
    }

    /// The student's trajectory: each step starts where the student's previous step ends, and the teacher continues from there.
    pub fn of_student(&self, points: &mut [f32], targets: &mut [f32]) {
        let cloud = self.cloud(points);
        let mut reached = vec![0.0; cloud];
        for k in 0..self.steps() {
            reached.copy_from_slice(&points[k * cloud..(k + 1) * cloud]);
            let part = k * self.every()..(k + 1) * self.every();
            let Self {
                teacher, condition, ..
            } = self;
            (self.fine).integrate_part(teacher, condition, part, &mut reached, |_, _| {});
            let start = &points[k * cloud..(k + 1) * cloud];
            self.mean_velocity(k, start, &reached, &mut targets[k * cloud..]);
            if k + 1 < self.steps() {
                self.student_step(k, points);
            }
        }
        self.denoising(points, targets);
    }

    /// The last denoising. It starts where the student's last step ends; its target is the data predicted by the teacher there, and
    /// from these once more by the teacher's own denoising.
    fn denoising(&self, points: &mut [f32], targets: &mut [f32]) {
        let Some(t) = self.denoise else { return };
        let cloud = self.cloud(points);
        self.student_step(self.steps() - 1, points);
        let start = &points[self.steps() * cloud..];
        let mut clean = start.to_vec();
        self.denoise_by_teacher(t, &mut clean);
        match (self.fine.denoise, self.teacher.last) {
            (Some(t), Some(_)) => self.refine_by_teacher(t, &mut clean),
            (Some(t), None) => self.denoise_by_teacher(t, &mut clean),
            (None, _) => {}
        }
        let target = &mut targets[self.steps() * cloud..];
        for ((v, from), to) in target.iter_mut().zip(start).zip(&clean) {
            *v = (to - from) / (1.0 - t);
        }
    }

    /// Takes points to the data `t X + (1 - t) u(t X, t)` predicted by the teacher: at time `t`, the mean of points whose data
    /// are `X` is `t X`.
    fn denoise_by_teacher(&self, t: f32, points: &mut [f32]) {
        points.iter_mut().for_each(|x| *x *= t);
        let mut velocity = vec![0.0; points.len()];
        (self.teacher).velocity(t, self.condition, points, &mut velocity);
        add(points, &velocity, 1.0 - t);
    }

    /// Takes points to where the network of the teacher's denoising does: it knows the ends of a flow as they are.
    fn refine_by_teacher(&self, t: f32, points: &mut [f32]) {
        let mut velocity = vec![0.0; points.len()];
        (self.teacher).last_velocity(t, self.condition, points, &mut velocity);
        add(points, &velocity, 1.0 - t);
    }

    /// Takes the student's step `k`: from the points of its evaluation to those of the next one.
    fn student_step(&self, k: usize, points: &mut [f32]) {
        let cloud = self.cloud(points);
        let (before, after) = points.split_at_mut((k + 1) * cloud);
        let (start, next) = (&before[k * cloud..], &mut after[..cloud]);
        let mut velocity = vec![0.0; cloud];
        (self.student).velocity(self.times[k], self.condition, start, &mut velocity);
        next.copy_from_slice(start);
        add(next, &velocity, self.times[k + 1] - self.times[k]);
    }

    /// Steps of the student.
    fn steps(&self) -> usize {
        self.times.len() - 1
    }

    /// Numbers of one cloud.
    fn cloud(&self, points: &[f32]) -> usize {
        points.len() / (self.steps() + usize::from(self.denoise.is_some()))
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

/// `x += h v`.
fn add(x: &mut [f32], v: &[f32], h: f32) {
    x.iter_mut().zip(v).for_each(|(x, v)| *x += h * v);
}
