//! What pages and sessions say to each other.
//!
//! A page sends JSON. A session answers with JSON, seldom, and with frames of numbers, often.

use serde::{Deserialize, Serialize};
use tdcr_hw::plan::{Bend, Shape};

use super::desk::{Order, PageId};
use super::drawing::Layout;
use super::overlays::OverlayList;
use super::recording::Servo;

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
    /// Another way to follow the tendons, begun at rest.
    Physics {
        /// Which.
        physics: PhysicsName,
        /// Coefficient of friction, where there is friction.
        #[serde(default)]
        coefficient: f64,
    },
    /// What the robot's cameras see: a picture of each.
    Pictures,
    /// A sample of the data set: its command, and its cloud.
    Sample {
        /// Name of its split.
        split: String,
        /// Its place in the split.
        index: usize,
    },
    /// Whether the network's clouds are wanted.
    Predict {
        /// Whether.
        on: bool,
    },
    /// A moment of the recording.
    Moment {
        /// s.
        time: f64,
    },
    /// A row of the study.
    Row {
        /// Its number in the table.
        row: usize,
    },
    /// The page wants to hold the rig.
    Arm,
    /// It does no longer.
    Disarm,
    /// It is there still.
    Here,
    /// It wants the rig's robot in a shape.
    Shape {
        /// What is asked of each module, from the base up.
        modules: Vec<ModuleShape>,
    },
}

/// What is asked of a module of a rig's robot.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(super) struct ModuleShape {
    /// The angle from its first disc to its last (rad) times the direction that it bends to.
    toward: [f64; 2],
    /// Tension that its tendons share (N).
    tension: f64,
}

impl Request {
    /// What is wanted of a rig, if it is that.
    pub fn order(&self, page: PageId) -> Option<Order> {
        match self {
            Self::Arm => Some(Order::Arm(page)),
            Self::Disarm => Some(Order::Disarm(page)),
            Self::Here => Some(Order::Here(page)),
            Self::Shape { modules } => {
                let bends = modules.iter().map(|module| Bend {
                    toward: module.toward,
                    tension: module.tension,
                });
                Some(Order::Shape(page, Shape(bends.collect())))
            }
            _ => None,
        }
    }
}

/// Ways to follow the tendons.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum PhysicsName {
    AtRest,
    WithFriction,
    InMotion,
}

impl Request {
    /// Whether `later` makes this one needless.
    pub fn is_overtaken_by(&self, later: &Self) -> bool {
        use Request::{
            Command, Drag, Moment, Payload, Physics, Pictures, Predict, Push, Robot, Row, Sample,
            Settle,
        };
        match (self, later) {
            (Command { .. }, Command { .. } | Settle { .. })
            | (Settle { .. }, Settle { .. })
            | (Payload { .. }, Payload { .. })
            | (Robot { .. }, Robot { .. })
            | (Physics { .. }, Physics { .. })
            | (Sample { .. }, Sample { .. })
            | (Predict { .. }, Predict { .. })
            | (Moment { .. }, Moment { .. })
            | (Row { .. }, Row { .. })
            | (Pictures, Pictures) => true,
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
    /// What can be shown over the robot.
    Overlays(Box<OverlayList>),
    /// What the recording has at the moment that was asked for.
    Moment {
        /// s.
        time: f64,
        /// What was asked of the tendons; none before the first command, and where the robot that is shown cannot take it.
        command: Option<Vec<f64>>,
        /// What servos did.
        servos: Vec<Servo>,
    },
    /// What the rig does.
    Rig {
        /// Who holds it.
        armed: Armed,
        /// Whether it moves.
        moving: bool,
        /// What its servos do.
        servos: Vec<Servo>,
        /// What was last said to this page, and its number.
        said: Option<(u64, String)>,
    },
    /// A request was refused, and nothing has changed.
    Refused {
        /// What was asked for.
        of: Refused,
        /// Why.
        reason: String,
    },
}

/// Who holds the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Armed {
    /// Nobody.
    No,
    /// This page.
    Here,
    /// Another page.
    Elsewhere,
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
    /// A network's cloud.
    Prediction,
}
