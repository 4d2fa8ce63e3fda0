//! Why there is no plan.

use tdcr_sim::inverse::shape::ShapeControlError;
use tdcr_sim::robot::{CommandError, LoadsError};
use thiserror::Error;

use super::search::Halts;

/// Why there is no plan.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PlanError {
    /// A setting that makes no sense.
    #[error("{field} is {found}; expected {expected}")]
    Setting {
        /// Its name.
        field: &'static str,
        /// Its value.
        found: String,
        /// What would be right.
        expected: &'static str,
    },
    /// A command of another robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// Loads of another robot.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// A target that makes no sense.
    #[error(transparent)]
    Target(#[from] ShapeControlError),
    /// The robot may not be where the plan would start.
    #[error("at the start {0}")]
    Start(Refusal),
    /// The robot may not be where the plan would end.
    #[error("at the goal {0}")]
    Goal(Refusal),
    /// No command brings the tip to its target where the robot may be.
    #[error(
        "no command was found that brings the tip to {target:?} m: of {tried} searches {reached} came there{}",
        last.as_ref().map_or_else(String::new, |refusal| format!(", where {refusal}"))
    )]
    NoGoal {
        /// Where the tip was to be (m).
        target: [f64; 3],
        /// Searches.
        tried: usize,
        /// Those that came there.
        reached: usize,
        /// Why the robot may not be there, in the last of these.
        last: Option<Refusal>,
    },
    /// The search ended without a plan. There may be one.
    #[error(
        "no motion was found with {nodes} nodes in {seconds:.1} s ({limit}); {}",
        in_words(halts)
    )]
    NotFound {
        /// What ended the search.
        limit: Limit,
        /// Places that were reached.
        nodes: usize,
        /// Time taken (s).
        seconds: f64,
        /// What was in the way.
        halts: Halts,
    },
    /// It was asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// What ends a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The largest number of nodes.
    Nodes,
    /// The time allowed.
    Seconds,
}

impl std::fmt::Display for Limit {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Self::Nodes => "as many nodes as are allowed",
            Self::Seconds => "all the time allowed",
        })
    }
}

/// Why a robot may not be somewhere.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Refusal {
    /// It does not settle.
    #[error("the robot does not settle stably")]
    Unsettled,
    /// It is too near to an obstacle.
    #[error(
        "disc {disc} is {:.2} mm from obstacle \"{obstacle}\"; expected {:.2} mm at least",
        1e3 * distance,
        1e3 * clearance
    )]
    Obstacle {
        /// The disc, from 0.
        disc: usize,
        /// Name of the obstacle.
        obstacle: String,
        /// The distance at least (m), below 0 of a disc that may be in the obstacle.
        distance: f64,
        /// The clearance asked for (m).
        clearance: f64,
    },
    /// It touches itself.
    #[error("discs {} and {} touch each other", discs[0], discs[1])]
    Touching {
        /// The discs, from 0.
        discs: [usize; 2],
    },
    /// A tendon pulls too much or too little.
    #[error("tendon {} has a tension of {tension:.2} N; expected {least} to {most} N", tendon + 1)]
    Tension {
        /// Which, from 0; people read it from 1.
        tendon: usize,
        /// Its tension (N).
        tension: f64,
        /// Least tension (N).
        least: f64,
        /// Largest tension (N).
        most: f64,
    },
}

/// What was in the way, the most frequent first.
fn in_words(halts: &Halts) -> String {
    let mut all = [
        (halts.near, "came too near to an obstacle or a disc"),
        (halts.unsettled, "led to no stable equilibrium"),
        (
            halts.jump,
            "would have jumped to another branch of equilibria",
        ),
        (halts.tension, "went beyond the limits of tension"),
        (
            halts.other_branch,
            "met the goal's command on another branch of equilibria",
        ),
    ];
    all.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    let told: Vec<String> = (all.iter())
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    match told.is_empty() {
        true => "nothing was in the way".to_owned(),
        false => format!("of the motions tried {}", told.join(", ")),
    }
}
