//! Why a robot is not led somewhere.

use tdcr_sim::robot::CommandError;
use thiserror::Error;

use super::shape::ShapeError;

/// Most steps of a way: hours of motion, and some tens of megabytes.
pub(super) const LONGEST: usize = 500_000;

/// Why there is no way.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PlanError {
    /// The robot has no shapes.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// A command lies beyond the robot's ranges.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// A command lies beyond the limits of its servo.
    #[error(
        "tendon {} would have the command {command:.4} m; its servo allows {low:.4} to {high:.4} m",
        tendon + 1
    )]
    Limit {
        /// Which tendon, from 0; people read it from 1.
        tendon: usize,
        /// Its command (m).
        command: f64,
        /// Smallest command (m).
        low: f64,
        /// Largest command (m).
        high: f64,
    },
    /// A tendon would go slack, or be overloaded.
    #[error("tendon {} would have a tension of {tension:.2} N, {} of the way; expected {low} to {high} N", tendon + 1, percent(*.part))]
    Tension {
        /// Which tendon, from 0; people read it from 1.
        tendon: usize,
        /// Its tension (N).
        tension: f64,
        /// Where on the way, from 0 to 1.
        part: f64,
        /// Smallest tension (N).
        low: f64,
        /// Largest tension (N).
        high: f64,
    },
    /// A disc would come too near to an obstacle.
    #[error(
        "disc {disc} would be {:.1} mm from the obstacle `{obstacle}`, {} of the way; expected {:.1} mm or more",
        1e3 * distance, percent(*.part), 1e3 * least
    )]
    Near {
        /// Name of the obstacle.
        obstacle: String,
        /// Which disc, from 0.
        disc: usize,
        /// Its distance (m), below 0 where they overlap.
        distance: f64,
        /// Where on the way, from 0 to 1.
        part: f64,
        /// What it has to be (m): the clearance asked for, and what a disc may come nearer between two looks.
        least: f64,
    },
    /// A disc moves too far at once to say what it comes near to.
    #[error("a disc of the simulated robot jumps, {} of the way, past obstacles or not", percent(*.part))]
    Jump {
        /// Where on the way, from 0 to 1.
        part: f64,
    },
    /// The simulator finds no equilibrium.
    #[error("the simulated robot does not settle, {} of the way", percent(*.part))]
    NotSettled {
        /// Where on the way, from 0 to 1.
        part: f64,
    },
    /// The way has more steps than anybody waits for.
    #[error(
        "the way has {steps:.1e} steps of {step:.1e} m, more than {LONGEST}: allow a larger motion.slew, or a longer motion.period"
    )]
    TooLong {
        /// Its steps.
        steps: f64,
        /// A step (m).
        step: f64,
    },
    /// Chance has found no command.
    #[error(
        "none of {draws} draws is a command that the robot survives: {last}; allow less bend or other tensions"
    )]
    NoCommand {
        /// How many were drawn.
        draws: usize,
        /// What was wrong with the last.
        last: Box<PlanError>,
    },
}

fn percent(part: f64) -> String {
    format!("{:.0} %", 100.0 * part)
}
