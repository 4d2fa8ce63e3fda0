//! Integration of a velocity field from prior to data.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::error::{FlowError, require};
use super::multistep::{Extended, Multistep};
use super::time_grid::TimeGrid;
use crate::channels::{Channels, DIM};

/// A velocity field `u(X, t | c)` over whole clouds.
pub trait VelocityField {
    /// What the `C` numbers of a point are.
    fn channels(&self) -> Channels;

    /// Velocities `(N, C)` of `points` `(N, C)`, row-major, at flow time `t` in [0, 1] under `condition`; all in
    /// normalised units.
    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]);

    /// The same for the last denoising, whose points are the ends of the flow ([`Sampler::denoise`]): another field where one
    /// was learned for it.
    fn last_velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        self.velocity(t, condition, points, velocities);
    }
}

/// Integration method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// Heun's method (improved Euler, second order; paper, Alg. tdcr-sampling): two evaluations of the field per step.
    #[default]
    Heun,
    /// Euler's method: first order, one evaluation per step.
    Euler,
    /// Second-order Adams-Bashforth method: one evaluation per step.
    AdamsBashforth,
    /// Second-order exponential multistep method, one evaluation per step (as DPM-Solver++ 2M: Lu et al., 2022). The data
    /// prediction `D = X + (1 - t) u` is extrapolated linearly in `t` from the last two evaluations, and
    /// `dX/dt = (D - X) / (1 - t)` is solved exactly. For clouds `D` changes much less than the velocity near the data.
    Exponential,
    /// The same of third order: `D` is extrapolated quadratically from the last three evaluations.
    Exponential3,
}

/// Whether colours are clamped along the flow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorSteps {
    /// They go wherever the flow takes them.
    #[default]
    Free,
    /// They are clamped to [0, 1] after every step (the paper's authors).
    Clamped,
}

/// How a velocity field is integrated from prior to data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sampler {
    /// Integration method.
    #[serde(default)]
    pub method: Method,
    /// Number of steps.
    pub steps: usize,
    /// Time grid of the steps.
    pub grid: TimeGrid,
    /// Flow time of a last evaluation that takes the integrated points to the data predicted there, `X + (1 - t) u(X, t)`;
    /// `None`, and older files: no such evaluation.
    ///
    /// It takes away much of what the integration leaves beside the surface: at this noise the network knows where the surface
    /// is, and the points have less of it. Later times move less, earlier ones round edges off.
    #[serde(default)]
    pub denoise: Option<f32>,
    /// Points that a prediction draws beyond those asked for, as a share of these; isolated and crowded points are left out of the
    /// cloud, and the others evened out ([`select`](crate::predict::select)). 0 in older files.
    #[serde(default)]
    pub spare: f32,
    /// Whether colours are clamped between steps. Older files: they are not.
    #[serde(default)]
    pub colors: ColorSteps,
}

impl Default for Sampler {
    /// [`Sampler::DEFAULT`].
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 5] = [
        Self::Heun,
        Self::Euler,
        Self::AdamsBashforth,
        Self::Exponential,
        Self::Exponential3,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Heun => "heun",
            Self::Euler => "euler",
            Self::AdamsBashforth => "adams-bashforth",
            Self::Exponential => "exponential",
            Self::Exponential3 => "exponential3",
        }
    }

    /// State of the multistep method; `None` for Heun's, which is a one-step method.
    fn multistep(self, len: usize) -> Option<Multistep> {
        let (extended, order) = match self {
            Self::Heun => return None,
            Self::Euler => (Extended::Velocity, 1),
            Self::AdamsBashforth => (Extended::Velocity, 2),
            Self::Exponential => (Extended::Data, 2),
            Self::Exponential3 => (Extended::Data, 3),
        };
        Some(Multistep::new(extended, order, len))
    }
}

impl Sampler {
    /// 16 steps of the exponential method on the quadratic grid, as good as 100 evaluations by Heun's, and a last denoising; of
    /// three points that are drawn two are kept.
    pub const DEFAULT: Self = Self {
        method: Method::Exponential,
        steps: 16,
        grid: TimeGrid::Power(2.0),
        denoise: Some(0.995),
        spare: 0.5,
        colors: ColorSteps::Free,
    };

    /// The paper's sampler: 100 equal steps of Heun's method, colours clamped after each.
    pub const PAPER: Self = Self {
        method: Method::Heun,
        steps: 100,
        grid: TimeGrid::Uniform,
        denoise: None,
        spare: 0.0,
        colors: ColorSteps::Clamped,
    };

    /// Returns an error for values that do not describe a sampler.
    pub fn check(&self) -> Result<(), FlowError> {
        require(
            (1..=100_000).contains(&self.steps),
            "sampler steps",
            self.steps,
            "1 to 100000",
        )?;
        self.grid.check()?;
        if let Some(t) = self.denoise {
            let within = (0.0..1.0).contains(&t);
            require(within, "sampler denoising time", t, "0 to below 1")?;
        }
        require(
            (0.0..=1.0).contains(&self.spare),
            "sampler spare points",
            self.spare,
            "a share, 0 to 1",
        )?;
        match (self.grid, self.method) {
            (TimeGrid::Adaptive(tolerance), Method::Heun | Method::Euler) => require(
                false,
                "sampler tolerance",
                tolerance,
                "none with heun and euler, which do not keep how the flow changes",
            ),
            _ => Ok(()),
        }
    }

    /// Evaluations of the field per integration. Fewer are taken where steps are adaptive, or shorter than f32 resolves.
    pub fn evaluations(&self) -> usize {
        let integration = match self.method {
            Method::Heun => 2 * self.steps,
            _ => self.steps,
        };
        integration + usize::from(self.denoise.is_some())
    }

    /// Points that are integrated for a cloud of `points`.
    pub fn drawn(&self, points: usize) -> usize {
        points + (f64::from(self.spare) * points as f64).ceil() as usize
    }

    /// Moves `points` `(N, C)` from `t = 0` to `t = 1`, in place; returns the number of evaluations of the field.
    ///
    /// # Panics
    /// Where [`Sampler::check`] returns an error.
    pub fn integrate(
        &self,
        field: &impl VelocityField,
        condition: &[f32],
        points: &mut [f32],
    ) -> usize {
        self.integrate_observed(field, condition, points, |_, _| {})
    }

    /// [`Sampler::integrate`], calling `observe` after every step with the number of steps taken and the points; after the
    /// denoising with the same number as after the last step.
    pub(crate) fn integrate_observed(
        &self,
        field: &impl VelocityField,
        condition: &[f32],
        points: &mut [f32],
        observe: impl FnMut(usize, &[f32]),
    ) -> usize {
        self.integrate_part(field, condition, 0..self.steps, points, observe)
    }

    /// The steps `part` of [`Sampler::integrate_observed`], from the points at the time at which the first of them begins; the
    /// denoising belongs to the last step of all. A multistep method begins anew.
    ///
    /// # Panics
    /// Where [`Sampler::check`] returns an error, and for a part of an adaptive grid, which has no times before it is walked.
    pub(crate) fn integrate_part(
        &self,
        field: &impl VelocityField,
        condition: &[f32],
        part: Range<usize>,
        points: &mut [f32],
        mut observe: impl FnMut(usize, &[f32]),
    ) -> usize {
        let velocity = |t: f64, points: &[f32], velocity: &mut [f32]| {
            field.velocity(t as f32, condition, points, velocity);
        };
        let denoise = self.denoise.filter(|_| part.end == self.steps);
        let mut steps = part.start;
        let evaluations = self.integrate_path(velocity, part, points, |taken, points| {
            steps = taken;
            self.bound(field.channels(), points);
            observe(taken, points);
        });
        let Some(t) = denoise else {
            return evaluations;
        };
        let mut last = vec![0.0; points.len()];
        field.last_velocity(t, condition, points, &mut last);
        step(points, &last, 1.0 - t);
        self.bound(field.channels(), points);
        observe(steps, points);
        evaluations + 1
    }

    /// Clamps the colours of `points`, where they are to be clamped.
    fn bound(&self, channels: Channels, points: &mut [f32]) {
        if self.colors == ColorSteps::Clamped {
            for point in points.chunks_exact_mut(channels.count()) {
                point[DIM..].iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
            }
        }
    }

    fn integrate_path(
        &self,
        field: impl Fn(f64, &[f32], &mut [f32]),
        part: Range<usize>,
        points: &mut [f32],
        observe: impl FnMut(usize, &mut [f32]),
    ) -> usize {
        match self.method.multistep(points.len()) {
            None => self.heun(field, part, points, observe),
            Some(multistep) => self.steps_of(multistep, field, part, points, observe),
        }
    }

    fn heun(
        &self,
        field: impl Fn(f64, &[f32], &mut [f32]),
        part: Range<usize>,
        points: &mut [f32],
        mut observe: impl FnMut(usize, &mut [f32]),
    ) -> usize {
        let times = self.grid.times(self.steps).expect(FIXED);
        let evaluations = 2 * part.len();
        let [mut velocity, mut ahead, mut velocity_ahead] =
            [(); 3].map(|()| vec![0.0; points.len()]);
        for k in part {
            let [start, end] = [times[k], times[k + 1]];
            let (start, end, h) = (start.into(), end.into(), end - start);
            field(start, points, &mut velocity);
            ahead.copy_from_slice(points);
            step(&mut ahead, &velocity, h);
            field(end, &ahead, &mut velocity_ahead);
            step(points, &velocity, 0.5 * h);
            step(points, &velocity_ahead, 0.5 * h);
            observe(k + 1, points);
        }
        evaluations
    }

    fn steps_of(
        &self,
        mut multistep: Multistep,
        field: impl Fn(f64, &[f32], &mut [f32]),
        part: Range<usize>,
        points: &mut [f32],
        mut observe: impl FnMut(usize, &mut [f32]),
    ) -> usize {
        let times = self.grid.times(self.steps);
        let time = |k: usize| times.as_ref().map(|times| f64::from(times[k]));
        assert!(
            times.is_some() || part == (0..self.steps),
            "all of an adaptive grid"
        );
        let mut velocity = vec![0.0; points.len()];
        let (mut t, mut evaluations) = (time(part.start).unwrap_or(0.0), 0);
        for k in part.start + 1..=part.end {
            let fixed = time(k);
            // Steps shorter than f32 resolves have no length.
            if fixed != Some(t) {
                field(t, points, &mut velocity);
                multistep.evaluate(t, points, &velocity);
                evaluations += 1;
                t = match (fixed, self.grid) {
                    (Some(end), _) => end,
                    (None, TimeGrid::Adaptive(tolerance)) if k < self.steps => {
                        multistep.longest_step(tolerance.into())
                    }
                    _ => 1.0,
                };
                multistep.step(t, points);
            }
            observe(k, points);
            if fixed.is_none() && t == 1.0 {
                break;
            }
        }
        evaluations
    }
}

/// Why Heun's grid has times.
const FIXED: &str = "a checked sampler of Heun's method has a fixed grid";

/// `x += h v`.
fn step(points: &mut [f32], velocity: &[f32], h: f32) {
    for (x, v) in points.iter_mut().zip(velocity) {
        *x += h * v;
    }
}

#[cfg(test)]
mod tests;
