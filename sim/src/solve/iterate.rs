//! The iterate of a solve: a configuration on SO(3)^n, and a step from it.

use nalgebra::Vector3;

use crate::chain::Configuration;
use crate::robot::Robot;
use crate::tendon::Posture;

/// A configuration with its poses, and a step from it.
#[derive(Clone, Debug)]
pub(crate) struct Iterate {
    robot: Robot,
    pub configuration: Configuration,
    pub posture: Posture,
    /// The step: the turn of each joint, world axes (rad).
    pub step: Vec<Vector3<f64>>,
    /// Where the step starts.
    from: Configuration,
    /// The step in the joints' coordinates there (rad).
    turns: Vec<Vector3<f64>>,
    straight: Configuration,
}

impl Iterate {
    /// The straight pose of `robot`.
    pub fn new(robot: &Robot) -> Self {
        let configuration = Configuration::straight(robot);
        let mut posture = Posture::new(robot);
        posture.place(robot, &configuration);
        let zero = vec![Vector3::zeros(); robot.discs().len()];
        Self {
            robot: robot.clone(),
            from: configuration.clone(),
            straight: configuration.clone(),
            configuration,
            posture,
            step: zero.clone(),
            turns: zero,
        }
    }

    /// Moves to the straight pose.
    pub fn set_straight(&mut self) {
        self.configuration.0.copy_from_slice(&self.straight.0);
        self.place();
    }

    /// Moves to `q`; joints of hinges to a rotation near theirs that they can have.
    pub fn set(&mut self, q: &Configuration) {
        self.configuration.0.copy_from_slice(&q.0);
        for (q, disc) in self.configuration.0.iter_mut().zip(self.robot.discs()) {
            if let Some(hinges) = &disc.hinges {
                *q = hinges.rotation(&hinges.angles(q));
            }
        }
        self.place();
    }

    /// Shortens the step such that no joint turns by more than `most` (rad); returns the factor.
    pub fn limit_step(&mut self, most: f64) -> f64 {
        let factor = f64::min(1.0, most / largest_turn(&self.step));
        if factor < 1.0 {
            self.step.iter_mut().for_each(|turn| *turn *= factor);
        }
        factor
    }

    /// Starts the step here.
    pub fn start_step(&mut self) {
        self.from.0.copy_from_slice(&self.configuration.0);
        for (joint, (turn, step)) in self.turns.iter_mut().zip(&self.step).enumerate() {
            *turn = self.posture.chain.dual(joint).tr_mul(step);
        }
    }

    /// Moves to where a share of the step leads from its start.
    pub fn move_by(&mut self, share: f64) {
        let joints = self.from.0.iter().zip(&self.turns).zip(self.robot.discs());
        for (to, ((from, turn), disc)) in self.configuration.0.iter_mut().zip(joints) {
            *to = disc.moved(from, &(turn * share));
        }
        self.place();
    }

    /// Moves to the start of the step.
    pub fn move_back(&mut self) {
        self.configuration.0.copy_from_slice(&self.from.0);
        self.place();
    }

    /// Places the robot in a configuration that was changed.
    pub fn place(&mut self) {
        self.posture.place(&self.robot, &self.configuration);
    }
}

/// Largest turn of a joint (rad).
pub(crate) fn largest_turn(step: &[Vector3<f64>]) -> f64 {
    let squared = step.iter().fold(0.0, |largest: f64, turn| {
        let squared = turn.norm_squared();
        // Not `max`: a NaN must not get lost.
        if squared > largest || squared.is_nan() {
            squared
        } else {
            largest
        }
    });
    squared.sqrt()
}

/// Largest angle by which a joint differs between two configurations (rad).
pub(crate) fn turn_between(a: &Configuration, b: &Configuration) -> f64 {
    let joints = a.0.iter().zip(&b.0);
    joints.map(|(a, b)| a.angle_to(b)).fold(0.0, f64::max)
}
