//! Small motions about a pose, and the time steps that are stable for them.

use faer::linalg::solvers::Llt;
use faer::{Mat, Side};

use super::acceleration::EquationsOfMotion;
use super::composite::compose;
use super::implicit::{in_coordinates, mass_matrix};
use super::links::Link;
use super::{DynamicsError, Integrator, State, Stepper};
use crate::energy::Expansion;
use crate::robot::{Command, Loads, Robot};

/// `M dv/dt + D v + K q = 0`: a robot at rest in some pose, moved a little. The coordinates are the
/// turns of the joints in their discs' frames, or their hinges' angles.
#[derive(Clone, Debug)]
pub(crate) struct SmallMotions {
    /// Mass matrix with the armatures (kg m²).
    pub mass: Mat<f64>,
    /// Diagonal of the damping matrix (N m s/rad).
    pub damping: Vec<f64>,
    /// The part of it that a semi-implicit step takes at its start: what of a rod's differs about the axes.
    pub explicit: Vec<f64>,
    /// Hessian of the potential (N m/rad).
    pub stiffness: Mat<f64>,
}

/// Radius of the largest half disc left of the imaginary axis in which the classical Runge-Kutta
/// method is stable: its region ends at 2.62 in its narrowest direction, at -2.79 on the real axis and
/// at 2.83 on the imaginary one (Hairer and Wanner, Solving Ordinary Differential Equations II, IV.2).
const RUNGE_KUTTA_RADIUS: f64 = 2.6;
/// Halvings of an interval of time steps: to a thousandth of the longest.
const HALVINGS: usize = 10;

impl SmallMotions {
    /// Those of `robot` about a pose at rest.
    ///
    /// # Errors
    /// [`DynamicsError`] when command or loads are not of this robot, or it cannot move.
    pub fn about(
        robot: &Robot,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<Self, DynamicsError> {
        let discs = robot.discs();
        let armatures = Link::armatures(robot, 0.0);
        let mut equations = EquationsOfMotion::new(robot, &armatures)?;
        equations.accept(state, command, loads)?;
        equations.posture.place(robot, &state.configuration);
        let still = vec![0.0; robot.dof()];
        let mut composites = Vec::new();
        compose(&equations, &still, &still, &mut composites);
        let mut expansion = Expansion::new(robot);
        let potential = equations.forces.potential(command.as_slice());
        potential.expand(&state.configuration, &equations.posture, &mut expansion);
        Ok(Self {
            mass: mass_matrix(&composites, &armatures),
            damping: (equations.links.iter())
                .flat_map(|link| link.damping().data.0[0])
                .collect(),
            explicit: (discs.iter())
                .flat_map(|disc| disc.extra_damping.data.0[0])
                .collect(),
            stiffness: in_coordinates(&expansion.dense(), &equations.posture.chain),
        })
    }

    /// Whether errors of steps by `timestep` (s) do not grow.
    ///
    /// A mode `x` of the scheme has the amplification `z` that solves the quadratic with the numbers
    /// `m = x'Mx`, `d = x'Dx`, `k = x'Kx`. For semi-implicit Euler it is
    /// `(m + h d) z² - (2 m + h d - h² k) z + m = 0`, whose roots leave the unit disc through -1, where
    /// `4 m + 2 h d - h² k = 0` (Jury's criterion); so `4 M + 2 h D - h² K` must be positive definite. Of damping that is
    /// explicit `-2 h d` takes the place of `2 h d`.
    /// For Runge-Kutta the rates `s` solve `m s² + d s + k = 0` and must stay within `|h s| < r`: by the
    /// same criterion `r² M - h² K` and `r² M + h² K - r h D` must be. A pose that is no minimum of the
    /// potential is left in any case; that is motion, not an error.
    pub fn is_stable(&self, integrator: Integrator, timestep: f64) -> bool {
        let h = timestep;
        let definite = |mass: f64, damping: f64, explicit: f64, stiffness: f64| {
            let mut matrix = &self.mass * faer::Scale(mass);
            matrix += &self.stiffness * faer::Scale(stiffness);
            for (index, d) in self.damping.iter().enumerate() {
                matrix[(index, index)] += damping * d + explicit * self.explicit[index];
            }
            Llt::new(matrix.as_ref(), Side::Lower).is_ok()
        };
        match integrator {
            Integrator::SemiImplicitEuler => definite(4.0, 2.0 * h, -4.0 * h, -h * h),
            Integrator::RungeKutta4 => {
                let r = RUNGE_KUTTA_RADIUS;
                definite(r * r, 0.0, 0.0, -h * h) && definite(r * r, -r * h, 0.0, h * h)
            }
            Integrator::ImplicitEuler | Integrator::ImplicitMidpoint => true,
        }
    }

    /// The longest stable time step below `timestep` (s), which is not; to a thousandth of it.
    pub fn longest_step(&self, integrator: Integrator, timestep: f64) -> f64 {
        // By decades first: the step may be shorter by many.
        let mut stable = timestep;
        while stable > 0.0 && !self.is_stable(integrator, stable) {
            stable /= 10.0;
        }
        let mut unstable = (10.0 * stable).min(timestep);
        for _ in 0..HALVINGS {
            let between = f64::midpoint(stable, unstable);
            if self.is_stable(integrator, between) {
                stable = between;
            } else {
                unstable = between;
            }
        }
        stable
    }
}

impl Stepper {
    /// Checks that small motions about the configuration of `state`, at rest, do not grow by the steps'
    /// own errors. It says nothing of other poses and of large motions. Takes O(n³) time; none of an implicit integrator,
    /// by whose steps they never grow.
    ///
    /// # Errors
    /// [`DynamicsError::Unstable`] with the longest stable step; as [`Stepper::step`] for a state, command or
    /// loads of another robot.
    pub fn check_stable(
        &self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        let (integrator, timestep) = (self.integrator(), self.timestep());
        // Commanded lengths leave fewer motions than these are of.
        if integrator.is_implicit() || self.first_held().is_some() {
            return Ok(());
        }
        let motions = SmallMotions::about(self.robot(), state, command, loads)?;
        match motions.is_stable(integrator, timestep) {
            true => Ok(()),
            false => Err(DynamicsError::Unstable {
                timestep,
                longest: motions.longest_step(integrator, timestep),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One joint alone: the limits are those of the textbooks.
    fn oscillator(mass: f64, damping: f64, stiffness: f64) -> SmallMotions {
        SmallMotions {
            mass: Mat::from_fn(1, 1, |_, _| mass),
            damping: vec![damping],
            explicit: vec![0.0],
            stiffness: Mat::from_fn(1, 1, |_, _| stiffness),
        }
    }

    #[test]
    fn the_limit_of_an_oscillator_is_the_known_one() {
        let frequency: f64 = 50.0;
        let motions = oscillator(1.0, 0.0, frequency * frequency);
        // Symplectic Euler: h omega = 2; Runge-Kutta: 2.83 on the imaginary axis.
        let euler = motions.longest_step(Integrator::SemiImplicitEuler, 1.0);
        assert!((euler * frequency / 2.0 - 1.0).abs() < 2e-3, "{euler}");
        let longest = motions.longest_step(Integrator::RungeKutta4, 1.0) * frequency;
        assert!((2.59..2.83).contains(&longest), "{longest}");
        // Damping alone: without limit where it is implicit, 2.79 over its rate where it is not.
        let damped = oscillator(1.0, frequency, 0.0);
        assert!(damped.is_stable(Integrator::SemiImplicitEuler, 10.0));
        let longest = damped.longest_step(Integrator::RungeKutta4, 1.0) * frequency;
        assert!((2.59..2.79).contains(&longest), "{longest}");
    }
}
