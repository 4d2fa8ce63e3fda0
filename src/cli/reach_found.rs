//! One command that `tdcr reach` found.

use serde::Serialize;
use tdcr::sim::inverse::shape::{Arrival, Bound, ContactGoals, Outcome, PathPoint, ShapeSolution};
use tdcr::sim::robot::Robot;
use tdcr::sim::scene::Scene;

use super::reach_contact::{NearestJson, PressJson};
use super::settle_contacts::ContactJson;

/// The command for one point, or for forces.
#[derive(Serialize)]
pub(super) struct Found {
    /// The point (m); `None` where only forces are asked for.
    pub target: Option<[f64; 3]>,
    /// The command that comes nearest.
    pub command: Vec<f64>,
    /// Where it brings the tip (m).
    pub tip_position: [f64; 3],
    /// Distance of that from the point (m).
    pub error: Option<f64>,
    pub reached: bool,
    /// The forces asked for, and those that the robot presses with.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub presses: Vec<PressJson>,
    /// Distance from the obstacles that the robot keeps clear of (m), below 0 where it is pressed into one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clearance: Option<f64>,
    /// The nearest of these obstacles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nearest: Option<NearestJson>,
    /// What the robot touches; `None` without obstacles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contacts: Option<Vec<ContactJson>>,
    /// Why not; `None` where it is reached.
    pub reason: Option<String>,
    /// How the robot comes here from the point before; `None` for a single point.
    pub arrival: Option<&'static str>,
    /// Commands to go through before this one, so that it comes here without a jump.
    pub via: Vec<Vec<f64>>,
    /// How far the disc that moves most comes since the point before (m).
    pub disc_change: f64,
}

impl Found {
    pub fn new(
        (robot, scene): (&Robot, &Scene),
        target: Option<[f64; 3]>,
        goals: &ContactGoals,
        solution: &ShapeSolution,
    ) -> Self {
        let contacts = solution.among.as_ref().map(|among| {
            let contacts = among.contacts.iter();
            contacts
                .map(|contact| ContactJson::of(contact, scene))
                .collect()
        });
        let tip = solution.equilibrium.positions[robot.discs().len() - 1];
        Self {
            target,
            command: solution.command.as_slice().to_vec(),
            tip_position: tip.into(),
            error: solution.errors.first().copied(),
            reached: solution.outcome == Outcome::Reached,
            presses: PressJson::all_of(goals, scene, solution),
            clearance: solution.nearest.map(|nearest| nearest.gap),
            nearest: NearestJson::of(scene, solution),
            contacts,
            reason: reason(&solution.outcome, scene),
            arrival: None,
            via: Vec::new(),
            disc_change: 0.0,
        }
    }

    pub fn on_path(robot: &Robot, scene: &Scene, target: [f64; 3], point: &PathPoint) -> Self {
        let arrival = match point.arrival {
            Arrival::First => "first",
            Arrival::Followed => "followed",
            Arrival::Switched => SWITCHED,
        };
        let via = point.via.iter().map(|command| command.as_slice().to_vec());
        Self {
            arrival: Some(arrival),
            via: via.collect(),
            disc_change: point.disc_change,
            ..Self::new(
                (robot, scene),
                Some(target),
                &ContactGoals::default(),
                &point.solution,
            )
        }
    }

    /// What is not reached, and why.
    pub fn missed(&self) -> String {
        let tip = (self.error)
            .map(|error| format!("the point is not reached, the tip stays {error:.3e} m off"));
        let presses = self.presses.iter().map(PressJson::missed);
        let missed: Vec<String> = tip.into_iter().chain(presses).collect();
        format!(
            "{}: {}",
            missed.join(", "),
            self.reason.as_deref().unwrap_or_default()
        )
    }

    pub fn switched(&self) -> bool {
        self.arrival == Some(SWITCHED)
    }
}

/// The robot jumps to another branch of solutions.
const SWITCHED: &str = "switched";

/// Why a search ended short of its target.
fn reason(outcome: &Outcome, scene: &Scene) -> Option<String> {
    let name = |obstacle: usize| &scene.obstacles()[obstacle].name;
    match outcome {
        Outcome::Reached => None,
        Outcome::Unreachable {
            active, obstacles, ..
        } => {
            let end = |bound| match bound {
                Bound::Low => "low",
                Bound::High => "high",
            };
            let bounds = (active.iter()).map(|a| format!("{} ({})", a.tendon, end(a.bound)));
            let discs = (obstacles.iter())
                .map(|one| format!("{:?} (disc {})", name(one.obstacle), one.disc));
            let [bounds, discs] =
                [bounds.collect(), discs.collect()].map(|all: Vec<_>| all.join(", "));
            let why = match (bounds.as_str(), discs.as_str()) {
                ("", "") => "no command near it comes nearer".to_owned(),
                (bounds, "") => format!("tendons are at an end of their range: {bounds}"),
                ("", discs) => format!("the robot keeps clear of {discs}"),
                (bounds, discs) => format!(
                    "the robot keeps clear of {discs}, and tendons are at an end of their range: {bounds}"
                ),
            };
            Some(format!("out of reach: {why}"))
        }
        Outcome::TooNear { nearest } => Some(format!(
            "no command was found that keeps clear: disc {} is {:.6} m from {:?}",
            nearest.disc,
            nearest.gap,
            name(nearest.obstacle)
        )),
        Outcome::Stalled { .. } => Some("the search came to a halt".to_owned()),
    }
}
