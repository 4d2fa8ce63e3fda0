//! From bends and co-contractions to commands.

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_sim::chain::Configuration;
use tdcr_sim::dynamics::{Integrator, State};
use tdcr_sim::robot::{Command, CommandUnit, Robot};
use tdcr_sim::simulation::{MovingRobot, Simulation};
use thiserror::Error;

/// What is asked of a module.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bend {
    /// The angle from its first disc to its last (rad) times the direction that it bends to, in the plane across the
    /// backbone.
    pub toward: [f64; 2],
    /// Tension that its tendons share (N).
    pub tension: f64,
}

/// What is asked of a robot: a [`Bend`] for each module, from the base up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape(pub Vec<Bend>);

/// Where a robot is brought.
#[derive(Clone, Debug, PartialEq)]
pub enum Place {
    /// Into a shape.
    Shape(Shape),
    /// To where a command leads that somebody has given: its tendons need not agree on a shape.
    Command(Command),
}

impl From<Shape> for Place {
    fn from(shape: Shape) -> Self {
        Self::Shape(shape)
    }
}

impl From<&Shape> for Place {
    fn from(shape: &Shape) -> Self {
        Self::Shape(shape.clone())
    }
}

impl From<Command> for Place {
    fn from(command: Command) -> Self {
        Self::Command(command)
    }
}

impl Place {
    /// The shape; `None` for a command that somebody has given.
    pub fn shape(&self) -> Option<&Shape> {
        match self {
            Self::Shape(shape) => Some(shape),
            Self::Command(_) => None,
        }
    }
}

/// Why a robot has no shapes.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ShapeError {
    /// A tendon is driven by its tension.
    #[error("tendon {} is driven by its tension; expected tendons driven by lengths", .0 + 1)]
    TensionDrive(usize),
    /// A tendon is fastened to no disc.
    #[error("tendon {} ends at the base; expected tendons that end at discs", .0 + 1)]
    NoModule(usize),
    /// The robot cannot be placed.
    #[error("{0}")]
    Robot(String),
}

/// Turns shapes into commands.
#[derive(Clone, Debug)]
pub struct Shaper {
    robot: MovingRobot,
    /// Module whose tension each tendon has: the one that it ends at.
    modules: Vec<usize>,
}

impl Bend {
    /// By `angle` (rad) to `direction` (rad from x), with a tension (N).
    pub fn new(direction: f64, angle: f64, tension: f64) -> Self {
        let (sin, cos) = direction.sin_cos();
        Self {
            toward: [angle * cos, angle * sin],
            tension,
        }
    }
}

impl Shape {
    /// What lies between `self` (`part` 0) and `other` (1), on the straight line of bends and tensions.
    pub fn toward(&self, other: &Self, part: f64) -> Self {
        let mix = |a: f64, b: f64| a + part * (b - a);
        let bends = self.0.iter().zip(&other.0);
        Self(
            bends
                .map(|(a, b)| Bend {
                    toward: [mix(a.toward[0], b.toward[0]), mix(a.toward[1], b.toward[1])],
                    tension: mix(a.tension, b.tension),
                })
                .collect(),
        )
    }
}

impl Shaper {
    /// For `robot`.
    ///
    /// # Errors
    /// [`ShapeError`].
    pub fn new(robot: &Robot) -> Result<Self, ShapeError> {
        let spec = robot.spec();
        let module = |(index, tendon): (usize, &tdcr_sim::robot::Tendon)| {
            if tendon.unit() == CommandUnit::Newton {
                return Err(ShapeError::TensionDrive(index));
            }
            let end = tendon.route.last().map(|waypoint| waypoint.0);
            let module = match end {
                Some(tdcr_sim::robot::Body::Disc(disc)) => spec.module_of(disc),
                _ => None,
            };
            module.ok_or(ShapeError::NoModule(index))
        };
        let modules = robot
            .tendons()
            .iter()
            .enumerate()
            .map(module)
            .collect::<Result<_, _>>()?;
        // Placed, never stepped: any time step will do.
        let robot = MovingRobot::new(robot, 1e-3, Integrator::default(), 1)
            .map_err(|error| ShapeError::Robot(error.to_string()))?;
        Ok(Self { robot, modules })
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        self.robot.robot()
    }

    /// Module whose tension each tendon has.
    pub fn modules(&self) -> &[usize] {
        &self.modules
    }

    /// The commands (m) of the straight robot with one tension (N) for each tendon.
    pub fn straight(&mut self, tensions: &[f64]) -> Vec<f64> {
        self.place(Configuration::straight(self.robot.robot()), |tendon| {
            tensions[tendon]
        })
    }

    /// The commands (m) of a shape: lengths of the tendons where each module is an arc of its bend, less what their tensions
    /// stretch them by. They may lie beyond the robot's ranges.
    pub fn commands(&mut self, shape: &Shape) -> Vec<f64> {
        let bend = |module: usize| shape.0.get(module).copied().unwrap_or_default();
        let spec = self.robot.robot().spec();
        let joints = spec.modules.iter().enumerate().flat_map(|(module, spec)| {
            let [x, y] = bend(module).toward.map(|part| part / spec.discs as f64);
            // A turn about the axis across the direction leans the disc above towards it.
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(-y, x, 0.0));
            std::iter::repeat_n(turn, spec.discs)
        });
        let configuration = Configuration(joints.collect());
        let modules = self.modules.clone();
        self.place(configuration, |tendon| bend(modules[tendon]).tension)
    }

    /// Commands of the tendons in a configuration under tensions.
    fn place(&mut self, configuration: Configuration, tension: impl Fn(usize) -> f64) -> Vec<f64> {
        let state = State::at_rest(configuration);
        let command = self.robot.robot().mean_command();
        self.robot
            .start_at(&state, &command)
            .expect("a state and a command of this robot");
        let lengths = self.robot.pose().tendon_lengths;
        let tendons = self.robot.robot().tendons().iter().zip(lengths).enumerate();
        tendons
            .map(|(index, (tendon, length))| length - tendon.stretch_under(tension(index)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use tdcr_sim::robot::{Loads, RobotSpec};

    #[test]
    fn a_bend_shortens_the_tendons_on_its_inside() {
        let robot = Robot::load("2m").unwrap();
        let mut shaper = Shaper::new(&robot).unwrap();
        let still = Bend::new(0.0, 0.0, 30.0);
        let straight = shaper.commands(&Shape(vec![still, still]));
        assert_eq!(straight, shaper.straight(&[30.0; 6]));
        // Towards the first tendon, which lies at x.
        let bent = shaper.commands(&Shape(vec![still, Bend::new(0.0, 0.5, 30.0)]));
        let change: Vec<f64> = bent.iter().zip(&straight).map(|(a, b)| a - b).collect();
        assert_eq!(change[..3], [0.0; 3]);
        assert!((change[3] + 0.0125 * 0.5).abs() < 2e-4, "{change:?}");
        assert!((change[4] - 0.00625 * 0.5).abs() < 2e-4 && (change[4] - change[5]).abs() < 1e-9);
    }

    /// A robot with a stiff backbone is where its tendons are bent to, so their tensions are those asked for.
    #[test]
    fn a_command_settles_near_its_shape() {
        let mut spec = RobotSpec::standard("2m").unwrap();
        for module in &mut spec.modules {
            let tendons = module.tendons.as_mut().unwrap();
            tendons.drive = tdcr_sim::robot::Drive::Gain(2e4);
            tendons.range = [0.0, 0.2];
        }
        let robot = Robot::new(spec).unwrap();
        let mut shaper = Shaper::new(&robot).unwrap();
        let shape = Shape(vec![Bend::new(1.0, 0.3, 10.0), Bend::new(-2.0, 0.4, 8.0)]);
        let command = robot.command(&shaper.commands(&shape)).unwrap();
        let settled = robot.settle(&command, &Loads::default());
        assert!(settled.converged);
        for (index, tension) in settled.tendon_tensions.iter().enumerate() {
            let asked = [10.0, 8.0][index / 3];
            assert!(
                (tension - asked).abs() < 0.35 * asked,
                "{:?}",
                settled.tendon_tensions
            );
        }
    }
}
