//! Derivatives of motions among obstacles.
//!
//! A contact's impulse is `p = k s (g - F |g| d)` with the gap's gradient `g`, `s = -gap / T - g . u` above 0, the coefficient of friction `F`
//! and `d` the direction of the sliding velocity `t`, or `t / STICK` as it sticks ([`super::touch`]). The bound of friction is that of the
//! normal impulse, and so are derivatives: where it slides they are those of sliding, where it sticks of creeping. Where a contact begins
//! or ends, or begins to slide, they are of the side at hand.

use nalgebra::{Matrix3, Vector3};

use super::super::law::by_compliance;
use super::ContactStepper;
use super::touch::{Name, STICK, Touch};
use crate::dynamics::{
    DynamicsError, Integrator, Lineariser, OppositePush, Push, PushingObstacle, Rollout,
    RolloutDirection, RolloutGradient, State, StateCotangent, StateTangent, StepAdjoint, Stepper,
    Surroundings, gradient_by, tangent_by,
};
use crate::robot::{Command, Loads, Parameter};
use crate::scene::ContactLaw;

impl ContactStepper {
    /// The gradient of a cost of a motion among obstacles: as [`rollout_gradient`](crate::dynamics::rollout_gradient) has it, whose arguments
    /// these are, with the contacts in it. `states` are those that steps of this stepper lead to. The normal forces, whether contacts stick
    /// or slide, and where they are, all change with the motion; where contacts begin or end derivatives are one-sided. Those by obstacles
    /// are as of [`ContactSensitivity::vjp`](crate::contact::ContactSensitivity::vjp), the start staying as it is.
    ///
    /// # Errors
    /// As [`rollout_gradient`](crate::dynamics::rollout_gradient); [`DynamicsError::Underivable`] for objects that move, friction between discs,
    /// [`ContactLaw::Impedance`], integrators but [`Integrator::SemiImplicitEuler`], and the pitch of a module with a rod, whose beads
    /// it moves.
    pub fn rollout_gradient(
        &self,
        rollout: &Rollout,
        states: &[State],
        parameters: &[Parameter],
        cost: impl FnMut(usize, &State, &mut StateCotangent),
    ) -> Result<RolloutGradient, DynamicsError> {
        self.check_parameters(parameters.iter())?;
        gradient_by(&mut self.adjoint()?, (rollout, states), parameters, cost)
    }

    /// The tangent of a motion among obstacles: as [`rollout_tangent`](crate::dynamics::rollout_tangent) has it, along changes of the
    /// obstacles too.
    ///
    /// # Errors
    /// As [`rollout_gradient`](Self::rollout_gradient).
    pub fn rollout_tangent(
        &self,
        rollout: &Rollout,
        states: &[State],
        direction: &RolloutDirection,
    ) -> Result<Vec<StateTangent>, DynamicsError> {
        self.check_parameters(direction.parameters.iter().map(|(parameter, _)| parameter))?;
        tangent_by(&mut self.adjoint()?, (rollout, states), direction)
    }

    /// Linearises steps among obstacles.
    ///
    /// # Errors
    /// As [`rollout_gradient`](Self::rollout_gradient); [`DynamicsError::LateServo`] as of [`Lineariser::new`].
    pub fn lineariser(&self) -> Result<Lineariser, DynamicsError> {
        Lineariser::by(self.adjoint()?)
    }

    fn adjoint(&self) -> Result<StepAdjoint, DynamicsError> {
        self.check_differentiable()?;
        StepAdjoint::among(self.robot(), self.stepper.timestep(), Some(self.boxed()))
    }

    fn check_differentiable(&self) -> Result<(), DynamicsError> {
        let refused = |what, expected| Err(DynamicsError::Underivable { what, expected });
        if self.stepper.integrator() != Integrator::SemiImplicitEuler {
            return refused(
                "steps of other integrators",
                "`Integrator::SemiImplicitEuler`",
            );
        }
        if !self.objects.are_none() {
            return refused("motions of objects", "obstacles without a mass");
        }
        if self.own.as_ref().is_some_and(|own| own.friction > 0.0) {
            return refused(
                "motions with friction between discs",
                "a scene whose `self_contact` has no friction",
            );
        }
        match self.scene.contact_law() {
            ContactLaw::Compliant { .. } => Ok(()),
            ContactLaw::Impedance(_) => refused(
                "contacts under MuJoCo's law",
                "a scene whose contact law is compliant",
            ),
        }
    }

    fn check_parameters<'a>(
        &self,
        mut parameters: impl Iterator<Item = &'a Parameter>,
    ) -> Result<(), DynamicsError> {
        let modules = &self.robot().spec().modules;
        let moves_beads = |parameter: &Parameter| match parameter {
            Parameter::Pitch(module) => modules.get(*module).is_some_and(|m| m.rod.is_some()),
            _ => false,
        };
        match parameters.any(moves_beads) {
            true => Err(DynamicsError::Underivable {
                what: "motions among obstacles, by the pitch of a module with a rod, whose beads it moves,",
                expected: "other parameters, or a motion without a scene",
            }),
            false => Ok(()),
        }
    }

    /// The contacts that act, as they are at the end of the step.
    ///
    /// # Errors
    /// [`DynamicsError::NotDifferentiable`] for one that nothing is near to.
    fn add_pushes(&self, pushes: &mut Vec<Push>) -> Result<(), DynamicsError> {
        let ContactLaw::Compliant { relaxation } = self.scene.contact_law() else {
            return Ok(());
        };
        let time = self.stepper.timestep() + relaxation;
        let touches = self.problem.touches.iter();
        for touch in touches.filter(|touch| touch.pressed(&touch.velocity) > 0.0) {
            match touch.name {
                Name::Bead(bead, obstacle) => {
                    let mut near = self.neighbourhood.near.iter();
                    let near = near.find(|near| {
                        near.bead == bead
                            && near.obstacle == obstacle
                            && near.gap == touch.gap
                            && near.normal == touch.gradient
                    });
                    let near = near.ok_or(DynamicsError::NotDifferentiable)?;
                    let arm = touch.arm - near.arm;
                    let mut push =
                        touch.push_of(bead.disc, near.centre, arm, &near.curvature, time);
                    let own = &self.scene.obstacles()[obstacle];
                    push.obstacle = Some(PushingObstacle {
                        number: obstacle,
                        origin: own.pose.translation.vector,
                        velocity: touch.velocity,
                        by_compliance: by_compliance(
                            own.compliance,
                            -touch.impulse / own.compliance,
                        ),
                    });
                    pushes.push(push);
                }
                Name::Discs(one, other) => {
                    let mut pairs = self.own.iter().flat_map(|own| &own.pairs.near);
                    let near = pairs.find(|near| near.beads == [one, other]);
                    let near = near.ok_or(DynamicsError::NotDifferentiable)?;
                    let [centre, carried] = near.centres;
                    let across = Matrix3::identity() - near.normal * near.normal.transpose();
                    let curvature = across / (centre - carried).norm();
                    let mut push =
                        touch.push_of(one.disc, centre, Vector3::zeros(), &curvature, time);
                    push.slides = Matrix3::zeros();
                    push.opposite = Some(OppositePush {
                        disc: other.disc,
                        carried,
                        inertance: touch.push.inertance,
                        normal: touch.normal,
                    });
                    pushes.push(push);
                }
                Name::Objects(..) => {}
            }
        }
        Ok(())
    }
}

impl Surroundings for ContactStepper {
    fn step(
        &mut self,
        before: &State,
        command: &Command,
        loads: &Loads,
        pushes: &mut Vec<Push>,
    ) -> Result<&[f64], DynamicsError> {
        Self::step(self, &mut before.clone(), command, loads)?;
        self.add_pushes(pushes)?;
        self.stepper.add_pushes(before, pushes);
        Ok(self.stepper.accelerations())
    }

    fn boxed(&self) -> Box<dyn Surroundings> {
        Box::new(self.clone())
    }

    fn stepper(&mut self) -> &mut Stepper {
        &mut self.stepper
    }

    fn obstacles(&self) -> Vec<Vector3<f64>> {
        let obstacles = self.scene.obstacles().iter();
        obstacles.map(|own| own.pose.translation.vector).collect()
    }
}

impl Touch {
    /// The derivatives of the impulse of a pressed contact on a `disc`, of a bead whose centre is at `carried` (m), with the `curvature` of
    /// the gap (1/m); `arm` is the point from there, and `time` the law's `T` (s).
    fn push_of(
        &self,
        disc: usize,
        carried: Vector3<f64>,
        arm: Vector3<f64>,
        curvature: &Matrix3<f64>,
        time: f64,
    ) -> Push {
        let (g, n, u) = (self.gradient, self.normal, self.velocity);
        let (stiff, steep) = (self.push.inertance, self.gradient.norm());
        let pressed = self.pressed(&u);
        let across = Matrix3::identity() - n * n.transpose();
        // Change of the normal by the place of the bead.
        let turning = across * curvature / steep;
        // The direction of friction, and its derivative by the sliding velocity.
        let sliding = u - n * n.dot(&u);
        let speed = sliding.norm();
        let along = sliding / speed.max(STICK);
        let straighten = match speed > STICK {
            true => (Matrix3::identity() - along * along.transpose()) / speed,
            false => Matrix3::identity() / STICK,
        };
        let rubbing = straighten * (pressed * self.friction * steep);
        let direction = g - along * (self.friction * steep);
        let turned = n * u.transpose() + Matrix3::identity() * n.dot(&u);
        Push {
            disc,
            carried,
            arm,
            slides: -n * g.transpose() + turning * n.dot(&arm),
            impulse: self.impulse,
            inertance: direction * g.transpose() * stiff + rubbing * across,
            by_place: (curvature - along * (curvature * n).transpose() * self.friction) * pressed
                + rubbing * turned * turning
                - direction * (g / time + curvature * u).transpose() * stiff,
            by_begin: Matrix3::zeros(),
            by_turn: Matrix3::zeros(),
            opposite: None,
            obstacle: None,
        }
    }
}
