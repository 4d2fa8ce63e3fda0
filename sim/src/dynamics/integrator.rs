//! The integrators, and what a step resolves.

/// Largest turn of a joint in one step (rad). No integrator is accurate at half of it, and beyond half a
/// turn the next state is of no motion at all.
pub const LARGEST_TURN: f64 = 1.0;

/// How a step is taken.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Integrator {
    /// First order: `v+ = v + h (M + h D)^-1 (tau - D v - bias)`, then `q+ = q exp(h v+)`; the joint
    /// damping `D` is implicit. MuJoCo's Euler integrator, step for step.
    #[default]
    SemiImplicitEuler,
    /// Fourth order, explicit: the classical Runge-Kutta method on the rotation group (Munthe-Kaas,
    /// Applied Numerical Mathematics 29, 1999). MuJoCo's RK4, but for terms of higher order.
    RungeKutta4,
    /// First order, linearly implicit in the joint damping and in the stiffness `K`, following loads included:
    /// `(M + h D + h² K) (v+ - v) = h (tau - D v - bias - h K v)`. For stiff backbones and tendons; it damps what is faster
    /// than the time step, and what is slower by about `omega h / 2` of critical. Where the matrix is not positive
    /// definite, a [`Integrator::SemiImplicitEuler`] step takes its place: [`Stepper::fallbacks`](super::Stepper::fallbacks) counts those.
    ImplicitEuler,
    /// Second order, implicit in everything and without damping of its own: the midpoint rule on the rotation group,
    /// `M(q_m) (v+ - v) / h + bias(q_m, u) = tau(q_m) - D u` with the mean rates `u = (v + v+) / 2`, `q_m = q exp(h u / 2)`
    /// and `q+ = q exp(h u)` (Hairer, Lubich and Wanner, Geometric Numerical Integration, 2006, ch. IV.8), solved by
    /// Newton's method in O(n), following loads included. It is symmetric in time, so energy does not drift. A step
    /// that it cannot solve is taken in halves; [`Stepper::fallbacks`](super::Stepper::fallbacks) counts those.
    ImplicitMidpoint,
}

impl Integrator {
    /// Whether steps are implicit in the stiffness: then small motions do not grow, whatever the time step.
    pub(super) fn is_implicit(self) -> bool {
        matches!(self, Self::ImplicitEuler | Self::ImplicitMidpoint)
    }
}
