//! Paths with friction of tendons among obstacles.

use super::{FrictionPath, FrictionState};
use crate::contact::{Contact, ContactError, Touching};
use crate::energy::following::follows;
use crate::robot::{Command, Loads, Robot};
use crate::scene::Scene;

/// Follows a robot along a sequence of commands among the obstacles of a scene, with friction in its tendons' holes, of the
/// obstacles and between its discs: a [`FrictionPath`] that touches what is around it, and itself.
///
/// Contacts are those of [`ContactSettler`](crate::contact::ContactSettler), their friction that of its
/// [`follow`](crate::contact::ContactSettler::follow). As long as the robot touches nothing steps are those of the path without a scene; in one without
/// obstacles, where it does not touch itself, this is that path, and takes all loads.
///
/// ```
/// use tdcr_sim::robot::{Loads, Robot, RobotSpec};
/// use tdcr_sim::scene::{Obstacle, Scene};
/// use tdcr_sim::tendon_friction::ContactPath;
///
/// let mut spec = RobotSpec::standard("2m").expect("a standard robot");
/// for tendon in spec.tendon_specs_mut() {
///     tendon.set_friction(0.1);
/// }
/// let robot = Robot::new(spec)?;
/// let post = Obstacle::cylinder("post", 0.01, 0.4)?.at([-0.06, 0.0, 0.25]);
/// let scene = Scene::new(vec![post.with_friction(0.3)?])?;
/// let mut path = ContactPath::new(&robot, &scene);
/// path.start(&robot.mean_command(), &Loads::default())?;
/// let bent = robot.command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])?;
/// let state = path.advance(&bent, &Loads::default())?;
/// assert!(state.equilibrium.converged && state.dissipated > 0.0);
/// assert!(!path.contacts().is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ContactPath {
    pub(super) path: FrictionPath,
    scene: Scene,
}

impl ContactPath {
    /// Prepares to follow `robot` in `scene`.
    pub fn new(robot: &Robot, scene: &Scene) -> Self {
        let mut path = FrictionPath::new(robot);
        if !scene.is_empty() {
            path.touching = Some(Box::new(Touching::new(robot, scene)));
        }
        Self {
            path,
            scene: scene.clone(),
        }
    }

    /// As [`FrictionPath::with_resolution`].
    ///
    /// # Panics
    /// If `turn` is not positive.
    pub fn with_resolution(mut self, turn: f64) -> Self {
        self.path = self.path.with_resolution(turn);
        self
    }

    /// Starts a path from the equilibrium without any friction, found from the straight pose. Look at whether it converged.
    ///
    /// # Errors
    /// [`ContactError`] for a straight robot inside an obstacle, and for loads without a potential.
    ///
    /// # Panics
    /// As [`ContactSettler::settle`](crate::contact::ContactSettler::settle).
    pub fn start(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&FrictionState, ContactError> {
        let Some(touching) = &mut self.path.touching else {
            return Ok(self.path.start(command, loads));
        };
        check(loads)?;
        let found = touching.settle(command, loads)?;
        self.path.state.equilibrium.clone_from(&found.equilibrium);
        self.path.arrive(command, loads);
        self.path.begin(command, loads);
        Ok(&self.path.state)
    }

    /// Leads the robot along the straight line from the last command and loads to these: as [`FrictionPath::advance`]. The first call on a
    /// new path starts it.
    ///
    /// # Errors
    /// As [`start`](Self::start); of a path that has started, for loads without a potential alone.
    ///
    /// # Panics
    /// As [`start`](Self::start).
    pub fn advance(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&FrictionState, ContactError> {
        if self.path.touching.is_none() {
            return Ok(self.path.advance(command, loads));
        }
        check(loads)?;
        match self.path.reached.take() {
            None => self.start(command, loads),
            Some(from) => Ok(self.path.follow(from, command, loads)),
        }
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        self.path.robot()
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Where the path has come to.
    pub fn state(&self) -> &FrictionState {
        self.path.state()
    }

    /// What the robot touches there.
    pub fn contacts(&self) -> &[Contact] {
        self.path
            .touching
            .as_ref()
            .map_or(&[], |own| own.contacts())
    }

    /// How well the contacts there are solved, as of a [`ContactEquilibrium`](crate::contact::ContactEquilibrium): their `complementarity` (J)
    /// and `penetration` (m). `None` in a scene in which nothing can be touched.
    pub fn contact_errors(&self) -> Option<[f64; 2]> {
        let report = self.path.touching.as_ref()?.report();
        Some([report.complementarity, report.penetration])
    }
}

/// Refuses loads without a potential.
fn check(loads: &Loads) -> Result<(), ContactError> {
    match loads.wrenches().iter().find(|wrench| follows(wrench)) {
        Some(wrench) => Err(ContactError::Loads { disc: wrench.disc }),
        None => Ok(()),
    }
}

impl FrictionPath {
    /// Solves the step from the last equilibrium among what there is to touch: as if it were not there where the step leads past it.
    /// Whether that is solved, and the Newton steps taken.
    pub(super) fn solve_among(&mut self, command: &[f64]) -> (bool, usize) {
        let from = &self.state.equilibrium.configuration;
        let (balance, before) = (&mut self.balance, &self.state.tendons);
        let Some(touching) = &mut self.touching else {
            return balance.solve(command, before);
        };
        let mut iterations = 0;
        if !touching.is_pressed() {
            balance.pressing.clear();
            let (solved, steps) = balance.solve(command, before);
            if solved && touching.is_clear(from, &balance.iterate.configuration) {
                return (true, steps);
            }
            iterations += steps;
            balance.guess_rest(command, before);
        }
        balance.tolerance = balance.tolerance.max(touching.rounding());
        balance.start_at(from);
        let (solved, steps) = balance.solve_pressed(touching, command, before);
        (solved, iterations + steps)
    }
}
