//! What hangs on the horns: spools, tendons that stretch, and the robot that they pull.
//!
//! A tendon of stiffness `k` whose spool has wound up `w` since home has the rest length `c = c_home - w`, and pulls with
//! `T = max(0, k (L - c))`, `L` its length in the robot: it never pushes. Between two solves of the robot `L` is held and
//! `T` follows the spool. The robot is solved again where a tension would change by more than [`TENSION_STEP`] for it, and
//! before anybody looks. Among the obstacles of a scene it settles, or moves, in contact with them.

use tdcr_sim::contact::{ContactSettler, ContactStepper};
use tdcr_sim::dynamics::{DynamicsError, Integrator, Stepper};
use tdcr_sim::pose::Pose;
use tdcr_sim::render::{BaseVisibility, Visuals};
use tdcr_sim::robot::{Drive, Loads, LoadsError, Pull, Robot, RobotSpec, SpecError, TendonSpec};
use tdcr_sim::scene::Scene;
use tdcr_sim::simulation::{MovingRobot, Physics, Simulation, SimulationError};
use tdcr_sim::tendon_friction::ContactPath;
use thiserror::Error;

use super::spool::Spool;
use super::tendon::{Line, REACH, TendonFault, TendonTruth};

/// Change of a tension (N) beyond which the robot is solved anew.
const TENSION_STEP: f64 = 0.2;
/// Change of a rest length (m) that nobody sees.
const RESOLUTION: f64 = 1e-8;
/// Stiffness (N/m) of a tendon of which the robot's file gives none: nylon-coated steel of a few decimetres.
const STIFFNESS: f64 = 2e4;

/// What a plant is.
#[derive(Clone, Debug)]
pub struct PlantSetup {
    /// The robot. Its tendons' drives give their stiffness; how they are driven is the spools' matter.
    pub robot: RobotSpec,
    /// How it follows the spools.
    pub physics: Physics,
    /// Stiffness of every tendon (N/m); `None` for that of drive and tendon in the robot's file, or 20 kN/m where it has
    /// none.
    pub stiffness: Option<f64>,
    /// Tension of every tendon (N) where its horn is at home and the robot straight.
    pub tension_at_home: f64,
    /// What is around it, and whether it touches itself: [`Scene::default`] for empty space.
    pub scene: Scene,
    /// Whether cameras see the base.
    pub base: BaseVisibility,
}

/// Why a plant cannot be made.
#[derive(Debug, Error)]
pub enum PlantError {
    /// There is not one spool for each tendon.
    #[error("robot `{robot}` has {tendons} tendons, and there are {spools} spools")]
    Spools {
        /// Name of the robot.
        robot: String,
        /// Its tendons.
        tendons: usize,
        /// Spools given.
        spools: usize,
    },
    /// A quantity that no tendon has.
    #[error("the {what} is {value}; expected {low} to {high}")]
    OutOfRange {
        /// Which, with its unit.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The smallest that it may be.
        low: f64,
        /// The largest.
        high: f64,
    },
    /// The robot is not valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// It cannot be moved with this time step, or among these obstacles.
    #[error(transparent)]
    Dynamics(#[from] DynamicsError),
    /// It cannot stand at home.
    #[error("the robot does not settle at home: {0}")]
    Home(#[from] SimulationError),
}

/// Smallest and largest stiffness (N/m) that the tendons may be given: of a rubber band, and of a steel cable of 10 mm.
pub const STIFFNESSES: [f64; 2] = [1.0, 1e8];

/// Smallest and largest coefficient of friction of tendons in their holes.
pub const FRICTIONS: [f64; 2] = [0.0, 2.0];

/// Smallest and largest tension of tendons at home (N).
const HOME_TENSIONS: [f64; 2] = [0.0, 1e5];

fn within(what: &'static str, value: f64, [low, high]: [f64; 2]) -> Result<(), PlantError> {
    match (low..=high).contains(&value) {
        true => Ok(()),
        false => Err(PlantError::OutOfRange {
            what,
            value,
            low,
            high,
        }),
    }
}

/// A robot behind spools.
pub struct Plant {
    simulation: Box<dyn Simulation>,
    lines: Vec<Line>,
    loads: Loads,
    base: BaseVisibility,
    /// Time step of a robot in motion (s), and the time that it is behind.
    motion: Option<(f64, f64)>,
    /// Whether loads or faults have changed since the last solve.
    changed: bool,
    settled: bool,
}

impl std::fmt::Debug for Plant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Plant")
            .field("robot", &self.simulation.robot().spec().name)
            .field("lines", &self.lines)
            .finish_non_exhaustive()
    }
}

impl Plant {
    /// The robot at home, with one spool for each tendon.
    ///
    /// # Errors
    /// [`PlantError`].
    pub fn new(setup: &PlantSetup, spools: &[Spool]) -> Result<Self, PlantError> {
        let robot = driven_by_spools(setup)?;
        if spools.len() != robot.tendons().len() {
            return Err(PlantError::Spools {
                robot: robot.spec().name.clone(),
                tendons: robot.tendons().len(),
                spools: spools.len(),
            });
        }
        within("tension at home (N)", setup.tension_at_home, HOME_TENSIONS)?;
        let scene = &setup.scene;
        let (mut simulation, motion): (Box<dyn Simulation>, _) = match setup.physics {
            Physics::AtRest => (Box::new(ContactSettler::new(&robot, scene)), None),
            Physics::WithFriction { .. } => (Box::new(ContactPath::new(&robot, scene)), None),
            Physics::InMotion { timestep, .. } => {
                let stepper = Stepper::new(&robot, timestep, Integrator::ImplicitEuler)?;
                let stepper = ContactStepper::new(stepper, scene)?;
                let moving = MovingRobot::among(stepper, 1);
                (Box::new(moving), Some((timestep, 0.0)))
            }
        };
        let straight = straight_lengths(&robot)?;
        let lines: Vec<Line> = (robot.tendons().iter().zip(spools).zip(straight))
            .map(|((tendon, spool), length)| {
                let home = length - setup.tension_at_home / tendon.stiffness;
                Line::new(*spool, tendon.stiffness, home, length)
            })
            .collect();
        let rest: Vec<f64> = lines.iter().map(Line::rest_at_robot).collect();
        let command = robot.command(&rest).map_err(SimulationError::from)?;
        simulation.reset(&command, &Loads::default())?;
        let mut plant = Self {
            simulation,
            lines,
            loads: Loads::default(),
            base: setup.base,
            motion,
            changed: false,
            settled: true,
        };
        plant.take_over();
        Ok(plant)
    }

    /// The robot, its tendons driven by rest lengths (m).
    pub fn robot(&self) -> &Robot {
        self.simulation.robot()
    }

    /// Goes on by `duration` (s), at whose end the horns are at `horns` (rad).
    pub fn advance(&mut self, duration: f64, horns: impl Iterator<Item = f64>) {
        for (line, horn) in self.lines.iter_mut().zip(horns) {
            line.spool.follow(horn);
        }
        if let Some((timestep, behind)) = self.motion {
            let steps = ((behind + duration) / timestep).floor();
            self.motion = Some((timestep, behind + duration - steps * timestep));
            for _ in 0..steps as usize {
                self.solve();
            }
        } else if self
            .lines
            .iter()
            .any(|line| line.stiffness * (line.rest_at_robot() - line.solved).abs() > TENSION_STEP)
        {
            self.solve();
        }
    }

    /// Brings the robot to where the spools are now; one in motion is there already.
    pub fn refresh(&mut self) {
        let moved = |line: &Line| (line.rest_at_robot() - line.solved).abs() > RESOLUTION;
        if self.motion.is_none() && (self.changed || self.lines.iter().any(moved)) {
            self.solve();
        }
    }

    /// Torque about horn `index` (N m, positive counter-clockwise); 0 for a horn without a tendon.
    pub fn torque(&self, index: usize) -> f64 {
        let line = self.lines.get(index);
        line.map_or(0.0, |line| line.spool.torque(line.tension()))
    }

    /// Where the robot is, as of the last solve.
    pub fn pose(&self) -> Pose<'_> {
        self.simulation.pose()
    }

    /// Whether the last solve found where the robot rests, or how it moves. Otherwise it stays where it was, and
    /// spools and tendons go on.
    pub fn settled(&self) -> bool {
        self.settled
    }

    /// The tendons, in truth.
    pub fn tendons(&self) -> Vec<TendonTruth> {
        self.lines.iter().map(Line::truth).collect()
    }

    /// Breaks tendon `index`, or makes it whole; nothing for one that is not there.
    pub fn set_fault(&mut self, index: usize, fault: TendonFault) {
        self.refresh();
        if let Some(line) = self.lines.get_mut(index) {
            line.set_fault(fault);
            self.changed = true;
        }
    }

    /// Shortens tendon `index` by this (m) beside its spool; nothing for one that is not there.
    pub fn shorten(&mut self, index: usize, length: f64) {
        if let Some(line) = self.lines.get_mut(index) {
            line.shorten(length);
            self.changed = true;
        }
    }

    /// Loads the robot.
    ///
    /// # Errors
    /// [`LoadsError`] for loads of another robot.
    pub fn set_loads(&mut self, loads: Loads) -> Result<(), LoadsError> {
        loads.check(self.robot())?;
        self.loads = loads;
        self.changed = true;
        Ok(())
    }

    /// What cameras see: the robot, and what is around it.
    pub fn visuals(&self) -> Visuals {
        let mut visuals = Visuals::of_robot(self.robot(), self.pose(), self.base);
        if let Some(scene) = self.simulation.scene() {
            visuals.add_scene(scene);
        }
        visuals
    }

    /// Solves the robot for the rest lengths of now.
    fn solve(&mut self) {
        let rest: Vec<f64> = self.lines.iter().map(Line::rest_at_robot).collect();
        // The range of commands is that of the rest lengths, so only the solve itself can fail.
        let advanced = (self.simulation.robot().command(&rest))
            .map_err(SimulationError::from)
            .and_then(|command| self.simulation.advance(&command, &self.loads));
        self.settled = advanced.is_ok();
        if let Err(error) = advanced {
            tracing::debug!("the simulated robot stays where it was: {error}");
        }
        for (line, rest) in self.lines.iter_mut().zip(rest) {
            line.solved = rest;
        }
        self.changed = false;
        self.take_over();
    }

    fn take_over(&mut self) {
        let lengths = self.simulation.pose().tendon_lengths;
        for (line, &length) in self.lines.iter_mut().zip(lengths) {
            if length.is_finite() {
                line.length = length;
            }
        }
    }
}

/// The robot with tendons that only pull, driven by rest lengths.
fn driven_by_spools(setup: &PlantSetup) -> Result<Robot, PlantError> {
    if let Some(stiffness) = setup.stiffness {
        within("tendons' stiffness (N/m)", stiffness, STIFFNESSES)?;
    }
    if let Some(coefficient) = setup.physics.friction() {
        within("coefficient of friction", coefficient, FRICTIONS)?;
    }
    let mut spec = setup.robot.clone();
    for tendon in spec.tendon_specs_mut() {
        let stiffness = setup.stiffness.unwrap_or_else(|| own_stiffness(tendon));
        tendon.drive = Drive::Gain(stiffness);
        tendon.axial_stiffness = None;
        // The lines at the spools are springs.
        tendon.stiffening = 0.0;
        // The simulated servos have a motion and limits of their own.
        tendon.servo = None;
        tendon.range = REACH;
        tendon.pull = Pull::TensionOnly;
        if let Some(coefficient) = setup.physics.friction() {
            tendon.set_friction(coefficient);
        }
    }
    Ok(Robot::new(spec)?)
}

/// Stiffness of drive and tendon in series (N/m).
fn own_stiffness(tendon: &TendonSpec) -> f64 {
    match (tendon.drive, tendon.axial_stiffness) {
        (Drive::Gain(gain), Some(axial)) => 1.0 / (1.0 / gain + 1.0 / axial),
        (Drive::Gain(gain), None) => gain,
        (Drive::Length | Drive::Tension, axial) => axial.unwrap_or(STIFFNESS),
    }
}

/// Length of each tendon in the straight pose (m).
fn straight_lengths(robot: &Robot) -> Result<Vec<f64>, DynamicsError> {
    // A settler has no lengths before it has settled; a robot in motion starts straight.
    let straight = MovingRobot::new(robot, 1e-3, Integrator::default(), 1)?;
    Ok(straight.pose().tendon_lengths.to_vec())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::spool::Winding;
    use super::*;

    const RADIUS: f64 = 0.005;

    fn plant(robot: &str, physics: Physics, backlash: f64) -> Plant {
        let setup = PlantSetup {
            robot: RobotSpec::standard(robot).expect("a standard robot"),
            physics,
            stiffness: None,
            tension_at_home: 2.0,
            scene: Scene::default(),
            base: BaseVisibility::Shown,
        };
        let spool = Spool::new(RADIUS, backlash, Winding::Counterclockwise, 0.0);
        let spools = vec![spool; setup.robot.tendon_count()];
        Plant::new(&setup, &spools).expect("a valid plant")
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

        #[test]
        fn no_tension_is_ever_negative(
            ways in prop::collection::vec(prop::collection::vec(-4.0..6.0, 6), 1..6),
            motion in any::<bool>(),
            broken in prop::option::of((0usize..6, prop_oneof![Just(TendonFault::Snapped), Just(TendonFault::Jammed)])),
        ) {
            let physics = match motion {
                true => Physics::InMotion {
                    timestep: 0.005,
                    friction: None,
                },
                false => Physics::AtRest,
            };
            let mut plant = plant("2m", physics, 0.01);
            let mut horns = [0.0; 6];
            for (step, goals) in ways.iter().enumerate() {
                if let (1, Some((index, fault))) = (step, broken) {
                    plant.set_fault(index, fault);
                }
                for _ in 0..10 {
                    for (horn, goal) in horns.iter_mut().zip(goals) {
                        *horn += 0.1 * (goal - *horn);
                    }
                    plant.advance(0.02, horns.iter().copied());
                    for tendon in plant.tendons() {
                        prop_assert!(tendon.tension >= 0.0 && tendon.tension.is_finite());
                        prop_assert!(tendon.tension_at_spool >= 0.0);
                        prop_assert!(tendon.tension == 0.0 || tendon.slack == 0.0);
                    }
                }
            }
        }
    }

    #[test]
    fn a_turn_shortens_a_tendon_by_the_circumference_less_its_stretch() {
        let mut plant = plant("3m", Physics::AtRest, 0.0);
        let before = plant.tendons()[0];
        for step in 1..=100 {
            let turn = std::f64::consts::TAU * f64::from(step) / 100.0;
            plant.advance(0.01, [turn].into_iter().chain([0.0; 8]));
        }
        plant.refresh();
        let after = plant.tendons()[0];
        let stretched = (after.tension - before.tension) / 500.0;
        let shortened = before.length - after.length;
        let circumference = std::f64::consts::TAU * RADIUS;
        assert!((shortened - (circumference - stretched)).abs() < 1e-9);
        assert!(stretched > 0.0 && shortened > 0.0);
        // The tensions are the solver's own.
        for (tendon, &tension) in plant.tendons().iter().zip(plant.pose().tendon_tensions) {
            assert!((tendon.tension - tension).abs() < 1e-9);
        }
    }

    #[test]
    fn tension_acts_before_the_robot_is_solved_anew() {
        let mut plant = plant("2m", Physics::AtRest, 0.0);
        let before = plant.torque(0);
        // 0.2 mm: a tenth of a newton.
        plant.advance(1e-3, [0.04].into_iter().chain([0.0; 5]));
        let change = plant.torque(0) - before;
        assert!((change + 500.0 * 0.04 * RADIUS * RADIUS).abs() < 1e-12);
    }

    #[test]
    fn wrong_setups_are_named() {
        let setup = PlantSetup {
            robot: RobotSpec::standard("2m").expect("a standard robot"),
            physics: Physics::AtRest,
            stiffness: Some(0.0),
            tension_at_home: 2.0,
            scene: Scene::default(),
            base: BaseVisibility::Shown,
        };
        let spool = Spool::new(RADIUS, 0.0, Winding::Counterclockwise, 0.0);
        let refused = |setup: &PlantSetup, spools: usize| {
            let plant = Plant::new(setup, &vec![spool; spools]);
            plant.expect_err("refused").to_string()
        };
        assert!(refused(&setup, 6).contains("stiffness (N/m) is 0; expected 1 to 100000000"));
        let setup = PlantSetup {
            stiffness: None,
            physics: Physics::WithFriction { coefficient: 2.5 },
            ..setup
        };
        assert!(refused(&setup, 6).contains("friction is 2.5; expected 0 to 2"));
        let setup = PlantSetup {
            physics: Physics::AtRest,
            ..setup
        };
        assert!(refused(&setup, 5).contains("6 tendons, and there are 5 spools"));
    }
}
