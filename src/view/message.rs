//! What pages and sessions say to each other.
//!
//! A page sends JSON. A session answers with JSON, seldom, and with frames of numbers, often.

use serde::{Deserialize, Serialize};

use super::drawing::Layout;

/// What a page asks for, with a number that the frame which answers it has, too.
#[derive(Debug, Deserialize)]
pub(super) struct Letter {
    pub stamp: f64,
    #[serde(flatten)]
    pub request: Request,
}

/// What a page asks for.
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(super) enum Request {
    /// Another command, followed from the equilibrium before it: one value for each tendon (m, or N for a tension drive).
    Command {
        /// The values.
        command: Vec<f64>,
    },
    /// The same, settled from the straight pose.
    Settle {
        /// The values.
        command: Vec<f64>,
    },
    /// Whatever command brings a disc nearer to a place.
    Drag {
        /// The disc, from 0.
        disc: usize,
        /// World frame (m).
        to: [f64; 3],
    },
    /// A force on a disc's origin; none ends it.
    Push {
        /// The disc, from 0.
        disc: usize,
        /// World frame (N).
        force: [f64; 3],
    },
    /// Another payload.
    Payload {
        /// Mass (kg).
        mass: f64,
    },
    /// Another robot.
    Robot {
        /// What its file says.
        toml: String,
    },
}

impl Request {
    /// Whether `later` makes this one needless.
    pub fn is_overtaken_by(&self, later: &Self) -> bool {
        use Request::{Command, Drag, Payload, Push, Robot, Settle};
        match (self, later) {
            (Command { .. }, Command { .. } | Settle { .. })
            | (Settle { .. }, Settle { .. })
            | (Payload { .. }, Payload { .. })
            | (Robot { .. }, Robot { .. }) => true,
            (Drag { disc, .. }, Drag { disc: other, .. })
            | (Push { disc, .. }, Push { disc: other, .. }) => disc == other,
            _ => false,
        }
    }
}

/// What a session says in words.
#[derive(Debug, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(super) enum Reply {
    /// Another robot is shown; frames are of it from now on.
    Robot(Box<Layout>),
    /// A request was refused, and nothing has changed.
    Refused {
        /// What was asked for.
        of: Refused,
        /// Why.
        reason: String,
    },
}

/// What was asked for, of what is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Refused {
    /// A letter that says nothing.
    Letter,
    /// A command, a load or a place.
    Request,
    /// A robot.
    Robot,
}
