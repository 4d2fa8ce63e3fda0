//! A robot in motion, driven by commands that it holds for some steps.

use nalgebra::UnitQuaternion;

use super::{Simulation, SimulationError, check, settled};
use crate::contact::{Contact, ContactSettler, ContactStepper};
use crate::dynamics::{DynamicsError, Integrator, Servos, State, Stepper};
use crate::objects::ObjectState;
use crate::pose::Pose;
use crate::robot::{Command, Loads, Robot};
use crate::scene::Scene;
use crate::tendon::Posture;
use crate::tendon_friction::TendonProfile;

/// How far a motion has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// There was no reset.
    New,
    /// In a state that was given, from which the time step was not checked yet.
    Started,
    /// Small motions about the start do not grow by the time step.
    Checked,
}

/// A robot in motion, also among obstacles: a [`ContactStepper`] with the state that it moves.
///
/// A time step by which small motions about the start grow is refused, as [`Stepper::check_stable`] does: by
/// [`Simulation::reset`], and after [`MovingRobot::start_at`] by the first advance.
#[derive(Clone, Debug)]
pub struct MovingRobot {
    stepper: ContactStepper,
    settler: ContactSettler,
    /// Time steps of one advance.
    steps: usize,
    state: State,
    servos: Servos,
    /// Time since the last reset (s), in steps.
    taken: u64,
    phase: Phase,
    posture: Posture,
    orientations: Vec<UnitQuaternion<f64>>,
    tensions: Vec<f64>,
}

impl MovingRobot {
    /// A robot that moves by `steps` (at least 1) time steps of `timestep` (s) at each advance.
    ///
    /// # Errors
    /// As [`Stepper::new`].
    pub fn new(
        robot: &Robot,
        timestep: f64,
        integrator: Integrator,
        steps: usize,
    ) -> Result<Self, DynamicsError> {
        let stepper = Stepper::new(robot, timestep, integrator)?;
        let stepper = ContactStepper::new(stepper, &Scene::default())?;
        Ok(Self::among(stepper, steps))
    }

    /// A robot that moves among obstacles, by `steps` (at least 1) time steps of `stepper` at each advance.
    pub fn among(stepper: ContactStepper, steps: usize) -> Self {
        let robot = stepper.robot().clone();
        let beads = stepper.beads().clone();
        let mut moving = Self {
            settler: ContactSettler::with_beads(&robot, stepper.scene(), beads),
            stepper,
            steps: steps.max(1),
            state: State::straight(&robot),
            servos: Servos::at(&robot, &robot.mean_command()),
            taken: 0,
            phase: Phase::New,
            posture: Posture::new(&robot),
            orientations: vec![UnitQuaternion::identity(); robot.discs().len()],
            tensions: vec![0.0; robot.tendons().len()],
        };
        moving.place();
        moving
    }

    /// What the robot touched in the last time step: [`ContactStepper::contacts`]. After a reset, what it touches at rest.
    pub fn contacts(&self) -> &[Contact] {
        match (self.taken, self.phase) {
            (0, Phase::Checked) => &self.settler.found().contacts,
            (0, _) => &[],
            _ => self.stepper.contacts(),
        }
    }

    /// Where the scene's objects are and how they move, in the order of [`Scene::objects`].
    pub fn objects(&self) -> &[ObjectState] {
        self.stepper.objects()
    }

    /// Places the objects in states, one for each in the order of [`Scene::objects`]; the robot stays as it is, inside of one or not
    /// ([`check_outside`](Self::check_outside)).
    ///
    /// # Errors
    /// [`SimulationError::Dynamics`] for states of other objects, or with numbers that none can have.
    pub fn place_objects(&mut self, states: &[ObjectState]) -> Result<(), SimulationError> {
        Ok(self.stepper.place_objects(Some(states))?)
    }

    /// Refuses obstacles and objects that have a part of the robot inside: steps would push it out the nearest way, however far.
    ///
    /// # Errors
    /// [`SimulationError`] that names them.
    pub fn check_outside(&self) -> Result<(), SimulationError> {
        Ok(self.stepper.check_start(&self.state)?)
    }

    /// The obstacles around the robot, objects where they are now.
    pub fn scene(&self) -> &Scene {
        self.stepper.scene()
    }

    /// How far a plane that touches a disc may be from one that touches its beads (m):
    /// [`Beads::shape_error`](crate::geometry::Beads::shape_error).
    pub fn shape_error(&self) -> f64 {
        self.stepper.beads().shape_error()
    }

    /// Configuration and velocities.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The command that acts on the tendons: the last one given, unless servos follow it late
    /// ([`ServoSpec`](crate::robot::ServoSpec)).
    pub fn acting(&self) -> &Command {
        self.servos.acting()
    }

    /// Time since the last reset (s).
    pub fn time(&self) -> f64 {
        self.taken as f64 * self.stepper().timestep()
    }

    /// Starts anew in `state`, the tendons under `command`, to which servos have come, objects as the scene has them.
    ///
    /// # Errors
    /// [`SimulationError`] where they are not of this robot, or the state is inside an obstacle.
    pub fn start_at(&mut self, state: &State, command: &Command) -> Result<(), SimulationError> {
        self.take(state, command)?;
        self.stepper.place_objects(None)?;
        self.stepper.check_start(state)?;
        (self.taken, self.phase) = (0, Phase::Started);
        self.set_deflections(&[])
    }

    /// Each tendon along its route after the last time step, with the contacts in its holes; none of a robot whose tendons have no friction.
    pub fn tendon_profiles(&self) -> &[TendonProfile] {
        self.stepper().tendon_profiles()
    }

    /// Energy that tendons have turned into heat in their holes since the start (J), or since [`set_deflections`](Self::set_deflections).
    pub fn dissipated(&self) -> f64 {
        self.stepper().dissipated()
    }

    /// Loads the contacts of the tendons in their holes with the deflections (m) that [`tendon_profiles`](Self::tendon_profiles) had in this
    /// state, or with none where the list is empty.
    ///
    /// # Errors
    /// [`SimulationError::Dynamics`] for deflections of other tendons, or not finite.
    pub fn set_deflections(&mut self, deflections: &[Vec<f64>]) -> Result<(), SimulationError> {
        let (q, acting) = (&self.state.configuration, self.servos.acting());
        Ok(self.stepper.set_deflections(q, acting, deflections)?)
    }

    /// Goes on with a motion that was left in `state` while `command` was [`acting`](Self::acting), where [`MovingRobot::taken`]
    /// was `taken`: as if it had not been left, to the last bit. Objects stay where they are, and no contact of the tendons in
    /// their holes is loaded: [`MovingRobot::place_objects`] and [`MovingRobot::set_deflections`] do that.
    ///
    /// # Errors
    /// As [`MovingRobot::start_at`].
    pub fn resume_at(
        &mut self,
        state: &State,
        command: &Command,
        taken: Option<u64>,
    ) -> Result<(), SimulationError> {
        self.take(state, command)?;
        self.taken = taken.unwrap_or(0);
        self.phase = match taken {
            None => Phase::New,
            Some(0) => Phase::Started,
            Some(_) => Phase::Checked,
        };
        self.set_deflections(&[])
    }

    /// Time steps since the last start; `None` before the first.
    pub fn taken(&self) -> Option<u64> {
        (self.phase != Phase::New).then_some(self.taken)
    }

    /// Takes over a state, the tendons under `command`.
    fn take(&mut self, state: &State, command: &Command) -> Result<(), SimulationError> {
        let robot = self.stepper.robot();
        robot.check_command(command.as_slice())?;
        let size =
            |what, found, expected| DynamicsError::check_size(robot, what, [expected, found]);
        let (joints, dof) = (robot.discs().len(), robot.dof());
        size("configuration", state.configuration.0.len(), joints)?;
        size("velocity", state.velocity.len(), dof)?;
        self.state.clone_from(state);
        self.servos = Servos::at(robot, command);
        self.tensions.fill(0.0);
        self.place();
        Ok(())
    }

    /// Goes on by `steps` time steps in place of the usual number.
    ///
    /// # Errors
    /// As [`Simulation::advance`].
    pub fn advance_by(
        &mut self,
        command: &Command,
        loads: &Loads,
        steps: usize,
    ) -> Result<(), SimulationError> {
        if self.phase == Phase::New {
            return self.reset(command, loads);
        }
        check(self.robot(), command, loads)?;
        self.check_stable(command, loads)?;
        let timestep = self.stepper().timestep();
        let mut moved = Ok(());
        for _ in 0..steps {
            let acting = self.servos.follow(command, timestep);
            moved = self.stepper.step(&mut self.state, acting, loads);
            if moved.is_err() {
                break;
            }
            self.taken += 1;
        }
        for (tendon, tension) in self.stepper.stepper().held_tensions() {
            self.tensions[tendon] = tension;
        }
        self.place();
        Ok(moved?)
    }

    /// What moves the robot among obstacles.
    pub fn contact_stepper(&self) -> &ContactStepper {
        &self.stepper
    }

    /// The time step and how steps are taken.
    pub fn stepper(&self) -> &Stepper {
        self.stepper.stepper()
    }

    /// Time steps of one advance.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Refuses, at the start of a motion, a time step by which small motions about it grow.
    fn check_stable(&mut self, command: &Command, loads: &Loads) -> Result<(), DynamicsError> {
        if self.phase == Phase::Started {
            // What acts in the first step.
            let mut servos = self.servos.clone();
            let acting = servos.follow(command, self.stepper().timestep());
            (self.stepper()).check_stable(&self.state, acting, loads)?;
            self.phase = Phase::Checked;
        }
        Ok(())
    }

    /// Computes the pose of the state under the command that acts. Tensions that hold lengths are as they were last found.
    fn place(&mut self) {
        let command = self.servos.acting();
        let robot = self.stepper.robot();
        self.posture.place(robot, &self.state.configuration);
        self.posture.chain.quaternions(&mut self.orientations);
        let lengths = self.posture.lengths.iter().zip(command.as_slice());
        for ((tension, tendon), (&length, &command)) in
            self.tensions.iter_mut().zip(robot.tendons()).zip(lengths)
        {
            if !tendon.holds_length() {
                *tension = tendon.state(length, command).tension;
            }
        }
    }
}

impl Simulation for MovingRobot {
    fn robot(&self) -> &Robot {
        self.stepper.robot()
    }

    /// At rest in the equilibrium among obstacles and objects where the scene has them at first, objects held there meanwhile.
    fn reset(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        self.stepper.place_objects(None)?;
        let equilibrium = &self.settler.settle(command, loads)?.equilibrium;
        let configuration = &equilibrium.configuration;
        self.state.configuration.0.copy_from_slice(&configuration.0);
        self.state.velocity.fill(0.0);
        self.tensions.copy_from_slice(&equilibrium.tendon_tensions);
        self.servos = Servos::at(self.stepper.robot(), command);
        (self.taken, self.phase) = (0, Phase::Started);
        self.set_deflections(&[])?;
        self.place();
        settled(self.robot(), command, &self.settler.found().equilibrium)?;
        Ok(self.check_stable(command, loads)?)
    }

    fn advance(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        self.advance_by(command, loads, self.steps)
    }

    fn pose(&self) -> Pose<'_> {
        Pose {
            configuration: &self.state.configuration,
            positions: &self.posture.chain.positions,
            orientations: &self.orientations,
            tendon_lengths: &self.posture.lengths,
            tendon_tensions: &self.tensions,
        }
    }

    fn scene(&self) -> Option<&Scene> {
        Some(self.stepper.scene())
    }
}
