//! Model-predictive control over a horizon of the robot's motion.

use std::collections::VecDeque;

use nalgebra::{DMatrix, Isometry3, Vector3};
use tdcr_sim::dynamics::{Integrator, Lineariser, State, Stepper};
use tdcr_sim::pose::ToolFrame;
use tdcr_sim::robot::{Command, Drive, Loads, Robot};

use super::horizon::{Horizon, Prediction, Stage, moved_on};
use super::{ControlError, Controller, Moment, StepWeights};
use crate::belief::Belief;
use crate::lag::DelayChoice;

/// How [`MovingPredictive`] looks ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingPredictiveSettings {
    /// Commands of the horizon, one a period; 1 at least.
    pub horizon: usize,
    /// The longest time step of the model (s).
    pub timestep: f64,
    /// Bandwidth of the observer of the tip's offset from the model (1/s).
    pub bandwidth: f64,
    /// How the parts of a step are weighed.
    pub weights: StepWeights,
    /// Weight of the change of the tip's error from period to period, beside that of the error: the larger, the less overshoot.
    pub error_rate: f64,
}

impl Default for MovingPredictiveSettings {
    fn default() -> Self {
        Self {
            horizon: 8,
            timestep: 0.002,
            bandwidth: 10.0,
            weights: StepWeights {
                damping: 3e-3,
                ..StepWeights::default()
            },
            error_rate: 1.0,
        }
    }
}

/// The commands of a horizon that keep the tip of the moving model nearest to the coming targets, of which the first is given.
///
/// The model moves beside the robot under the same commands, once for each delay that it may have, of which the one is believed whose tip
/// moves like the robot's; where the measured tip is off from its tip, slowly, the targets are
/// shifted (offset-free control; Pannocchia and Rawlings, AIChE J. 49, 2003). Each period its motion under the last horizon's commands is linearised, step by step
/// ([`Lineariser`]), and one quadratic program improves the commands within the bounds of commands, rates and tensions (the real-time
/// iteration; Diehl, Bock and Schloeder, SIAM J. Control Optim. 43, 2005). So it foresees how the robot swings, and damps it.
///
/// The model is the robot as it was given: payloads and offsets of servos that were estimated at rest are not in it. Friction of its tendons is in
/// its motion, not in the derivatives, which are of the robot without it: the program improves on them from period to period.
#[derive(Clone, Debug, Default)]
pub struct MovingPredictive {
    /// How it looks ahead.
    pub settings: MovingPredictiveSettings,
    /// The last horizon's commands.
    plan: Vec<Vec<f64>>,
    model: Option<Model>,
    /// Offset of the tip from the model's (m).
    offset: Option<Vector3<f64>>,
}

impl MovingPredictive {
    /// One that looks ahead as `settings` say.
    pub fn new(settings: MovingPredictiveSettings) -> Self {
        Self {
            settings,
            ..Self::default()
        }
    }
}

impl Controller for MovingPredictive {
    fn name(&self) -> &'static str {
        "moving-mpc"
    }

    fn delay(&self) -> Option<usize> {
        self.model.as_ref().map(|model| model.delay.periods())
    }

    fn propose(&mut self, moment: &mut Moment<'_>) -> Result<Vec<f64>, ControlError> {
        let model = match &mut self.model {
            Some(model) => {
                model.move_on(moment)?;
                model
            }
            none => none.insert(Model::at_rest(moment, self.settings.timestep)?),
        };
        let fading = (-moment.period * self.settings.bandwidth).exp();
        let found = moment.tip - model.tip();
        let offset = (self.offset).map_or(found, |before| before.lerp(&found, 1.0 - fading));
        self.offset = Some(offset);
        let plan = moved_on(&self.plan, moment.command, self.settings.horizon);
        let horizon = Horizon {
            prediction: model.predict(&plan, moment, offset)?,
            plan: &plan,
            weights: self.settings.weights,
            error_rate: self.settings.error_rate,
        };
        self.plan = horizon.improve(moment)?;
        Ok(self.plan[0].clone())
    }
}

/// The robot without friction of its tendons: single steps are not linearised with it.
fn smooth(robot: &Robot) -> Robot {
    let mut spec = robot.spec().clone();
    for tendon in spec.tendon_specs_mut() {
        tendon.friction = None;
    }
    Robot::new(spec).expect("a robot is valid without friction")
}

/// The robot in motion, as the controller believes it: once for every delay that it may have.
#[derive(Clone, Debug)]
struct Model {
    robot: Robot,
    loads: Loads,
    lineariser: Lineariser,
    /// Time steps of a period.
    steps: usize,
    /// When it is (s).
    time: f64,
    /// Its state under each delay, none at first, what moves it and knows how its tendons rub, and where the tip is measured from there (m).
    states: Vec<State>,
    steppers: Vec<Stepper>,
    offsets: Vec<Vector3<f64>>,
    /// Which of them is true.
    delay: DelayChoice,
    /// The last commands given, the newest first.
    given: VecDeque<Vec<f64>>,
}

impl Model {
    /// At rest under the command that acts.
    fn at_rest(moment: &mut Moment<'_>, timestep: f64) -> Result<Self, ControlError> {
        let given: &mut Belief = moment.given;
        let (robot, loads) = (given.robot().clone(), given.loads().clone());
        let steps = (moment.period / timestep).ceil().max(1.0);
        let step = moment.period / steps;
        let state = State {
            configuration: given.settle(moment.acting)?.configuration.clone(),
            velocity: vec![0.0; robot.dof()],
        };
        let stepper = Stepper::new(&robot, step, Integrator::SemiImplicitEuler)?;
        stepper.check_stable(&state, &robot.command(moment.acting)?, &loads)?;
        let delays = moment.delay.most() + 1;
        let offset = moment.tip - tip(&robot, &state);
        Ok(Self {
            lineariser: Lineariser::new(&smooth(&robot), step)?,
            steppers: vec![stepper; delays],
            steps: steps as usize,
            time: moment.time,
            states: vec![state; delays],
            offsets: vec![offset; delays],
            delay: DelayChoice::new(moment.delay),
            given: vec![moment.command.to_vec(); delays].into(),
            robot,
            loads,
        })
    }

    /// Moves on to the moment, under the commands given since, and takes in where the tip is.
    fn move_on(&mut self, moment: &Moment<'_>) -> Result<(), ControlError> {
        let periods = ((moment.time - self.time) / moment.period).round();
        self.time = moment.time;
        for _ in 0..periods as usize {
            self.given.push_front(moment.command.to_vec());
            self.given.pop_back();
            let moving = self.states.iter_mut().zip(&mut self.steppers);
            for ((state, stepper), command) in moving.zip(&self.given) {
                let command = self.robot.command(command)?;
                for _ in 0..self.steps {
                    stepper.step(state, &command, &self.loads)?;
                }
            }
        }
        let offsets = (self.states.iter()).map(|state| moment.tip - tip(&self.robot, state));
        let offsets: Vec<_> = offsets.collect();
        let changes = (offsets.iter().zip(&self.offsets)).map(|(now, last)| now - last);
        self.delay
            .weigh(changes.map(|change| change.norm_squared()));
        self.offsets = offsets;
        Ok(())
    }

    /// What tip and tensions are after each command of the plan, once those on their way have acted.
    fn predict(
        &mut self,
        plan: &[Vec<f64>],
        moment: &Moment<'_>,
        offset: Vector3<f64>,
    ) -> Result<Prediction, ControlError> {
        let delay = self.delay.periods();
        let (mut state, mut stepper) = (self.states[delay].clone(), self.steppers[delay].clone());
        for command in self.given.iter().take(delay).rev() {
            let command = self.robot.command(command)?;
            for _ in 0..self.steps {
                stepper.step(&mut state, &command, &self.loads)?;
            }
        }
        let (dof, tendons) = (self.robot.dof(), self.robot.tendons().len());
        let mut prediction = Prediction::new(plan.len(), tendons);
        // Of the state by each command so far.
        let mut by_commands = DMatrix::zeros(2 * dof, 0);
        for (i, command) in plan.iter().enumerate() {
            let command = self.robot.command(command)?;
            by_commands = by_commands.resize_horizontally((i + 1) * tendons, 0.0);
            for _ in 0..self.steps {
                let step = (self.lineariser).linearise(&state, &command, &self.loads)?;
                by_commands = step.a * by_commands;
                let mut own = by_commands.columns_mut(i * tendons, tendons);
                own += step.b;
                stepper.step(&mut state, &command, &self.loads)?;
            }
            let target = (moment.target)(delay + 1 + i) - offset;
            let stage = prediction.stage(i);
            write_stage(
                stage,
                i,
                &self.robot,
                &state,
                &command,
                &by_commands,
                target,
            );
        }
        Ok(prediction)
    }
    /// Where the tip is as far as is known of the delay (m).
    fn tip(&self) -> Vector3<f64> {
        tip(&self.robot, &self.states[self.delay.periods()])
    }
}

/// Where the tip is (m).
fn tip(robot: &Robot, state: &State) -> Vector3<f64> {
    let positions = state.positions(robot);
    positions.last().copied().unwrap_or_default()
}

/// Writes the stage after command `place`, by the derivatives of the state.
fn write_stage(
    mut stage: Stage<'_>,
    place: usize,
    robot: &Robot,
    state: &State,
    command: &Command,
    by_commands: &DMatrix<f64>,
    target: Vector3<f64>,
) {
    let tendons = robot.tendons().len();
    let by_joints = by_commands.rows(0, robot.dof());
    let frame = ToolFrame {
        disc: robot.discs().len() - 1,
        in_disc: Isometry3::identity(),
    };
    let tip_moves = frame.joint_jacobian(robot, &state.configuration).rows(0, 3) * by_joints;
    let (lengths, slopes) = robot.tendon_kinematics(&state.configuration);
    let tensions = robot.tendon_tensions(&lengths, command);
    let mut slopes = slopes * by_joints;
    for (t, [_, stiffness]) in tensions.iter().enumerate() {
        let mut row = slopes.row_mut(t);
        row *= *stiffness;
        row[place * tendons + t] += match robot.tendons()[t].drive {
            Drive::Tension => 1.0,
            Drive::Gain(_) | Drive::Length => -stiffness,
        };
    }
    let tensions: Vec<f64> = tensions.iter().map(|[tension, _]| *tension).collect();
    stage.wanted(target - tip(robot, state));
    stage.tensions(&tensions);
    for command in 0..=place {
        let first = command * tendons;
        stage.tip_by(command, tip_moves.columns(first, tendons));
        stage.tensions_by(command, slopes.columns(first, tendons));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::Limits;

    #[test]
    fn what_it_foresees_are_differences_of_the_motion() -> Result<(), Box<dyn std::error::Error>> {
        let robot = Robot::load("2m")?;
        let [mut given, mut estimated] =
            [(); 2].map(|()| Belief::new(&robot, &Loads::default(), &[]).expect("a model"));
        let limits = Limits::new(&robot, 0.02, None, [0.0, f64::INFINITY])?;
        let command = robot.mean_command().as_slice().to_vec();
        let mut moment = Moment {
            time: 0.0,
            period: 0.02,
            tip: Vector3::zeros(),
            target: &|_| Vector3::zeros(),
            lead: 1,
            delay: crate::lag::Delay::Known(1),
            estimated: &mut estimated,
            given: &mut given,
            jacobian_correction: &nalgebra::Matrix3xX::zeros(command.len()),
            command: &command,
            acting: &command,
            limits: &limits,
            tensions: None,
        };
        let model = Model::at_rest(&mut moment, 0.002)?;
        let plan = |change: f64| {
            let mut plan = vec![command.clone(); 3];
            plan[0][2] += 0.004;
            plan[1][4] += change;
            plan
        };
        let step = 1e-6;
        let [before, here, after] = [-step, 0.0, step].map(|change| {
            let found = (model.clone()).predict(&plan(change), &moment, Vector3::zeros());
            found.expect("a motion")
        });
        // Tendon 4 of the second command.
        let column = 6 + 4;
        let tips = (before.wanted - after.wanted) / (2.0 * step);
        assert!((tips - here.tip.column(column)).amax() < 1e-6);
        let tensions = (after.tensions - before.tensions) / (2.0 * step);
        assert!((tensions - here.slopes.column(column)).amax() < 1e-3);
        assert!(here.tip.column(column).rows(6, 3).amax() > 1e-3);
        Ok(())
    }
}
