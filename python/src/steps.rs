//! How motions are computed: time step, integrator, frame skip.

use pyo3::prelude::*;
use tdcr::sim::contact::ContactStepper;
use tdcr::sim::dynamics::{DynamicsError, Integrator, Stepper};
use tdcr::sim::robot::Robot;
use tdcr::sim::scene::Scene;
use tdcr::sim::simulation::MovingRobot;

use crate::errors::{Failure, Outcome};

/// The integrators, by their names on the command line.
const INTEGRATORS: [(&str, Integrator); 4] = [
    ("semi-implicit-euler", Integrator::SemiImplicitEuler),
    ("runge-kutta4", Integrator::RungeKutta4),
    ("implicit-euler", Integrator::ImplicitEuler),
    ("implicit-midpoint", Integrator::ImplicitMidpoint),
];

fn integrator(name: &str) -> Outcome<Integrator> {
    let found = INTEGRATORS.iter().find(|(known, _)| *known == name);
    found.map(|(_, integrator)| *integrator).ok_or_else(|| {
        let known = INTEGRATORS.map(|(known, _)| known).join(", ");
        Failure::input(format!("integrator is {name:?}; expected one of {known}"))
    })
}

/// How rows of motions are computed, the same for all.
#[pyclass(frozen, module = "tdcr._tdcr")]
#[derive(Clone, Copy)]
pub struct Steps {
    pub timestep: f64,
    pub integrator: Integrator,
    /// Time steps for each command.
    pub skip: usize,
}

#[pymethods]
impl Steps {
    #[new]
    fn new(timestep: f64, integrator: &str, skip: usize) -> Outcome<Self> {
        if skip == 0 {
            return Err(Failure::input("frame_skip is 0; expected at least 1"));
        }
        Ok(Self {
            timestep,
            integrator: self::integrator(integrator)?,
            skip,
        })
    }
}

impl Steps {
    /// A robot that moves in such steps among the obstacles of a scene.
    pub fn moving(self, robot: &Robot, scene: &Scene) -> Result<MovingRobot, DynamicsError> {
        let stepper = Stepper::new(robot, self.timestep, self.integrator)?;
        let stepper = ContactStepper::new(stepper, scene)?;
        Ok(MovingRobot::among(stepper, self.skip))
    }

    /// Refuses steps that have no adjoint.
    pub fn check_differentiable(self) -> Outcome<()> {
        let (differentiable, name) = (INTEGRATORS[0].1, INTEGRATORS[0].0);
        if self.integrator == differentiable {
            return Ok(());
        }
        let message = format!("gradients are of steps by another integrator; expected {name}");
        Err(Failure::input(message))
    }
}
