//! What `tdcr reach` asks of the robot and the obstacles around it, and what it finds of that.

use anyhow::bail;
use clap::Args;
use serde::Serialize;
use tdcr::sim::inverse::shape::{ContactGoals, Press, ShapeSolution};
use tdcr::sim::robot::Robot;
use tdcr::sim::scene::Scene;

/// A clearance and forces.
#[derive(Debug, Args)]
pub(super) struct ContactArgs {
    /// Least distance of the robot's beads from the obstacles (m), but from those of --press: at 0 it touches none. Without this, it may lean on them
    #[arg(
        long,
        value_parser = clearance,
        requires = "scene",
        conflicts_with = "path",
        value_name = "M"
    )]
    clearance: Option<f64>,
    /// Press on an obstacle, by its name, with a normal force (N), summed over the robot or that of one disc, from 0 at the base, or tip;
    /// may be repeated, and needs no --tip
    #[arg(
        long = "press",
        value_parser = press,
        requires = "scene",
        conflicts_with = "path",
        value_name = "OBSTACLE=FORCE[@DISC]"
    )]
    presses: Vec<PressArg>,
}

/// A force on an obstacle that has yet to be found in the scene.
#[derive(Clone, Debug)]
struct PressArg {
    obstacle: String,
    force: f64,
    presser: Presser,
}

/// What presses.
#[derive(Clone, Copy, Debug)]
enum Presser {
    Robot,
    Tip,
    Disc(usize),
}

/// A force that was asked for.
#[derive(Clone, Serialize)]
pub(super) struct PressJson {
    obstacle: String,
    /// The disc that presses, from 0; `None` for all.
    disc: Option<usize>,
    /// The force asked for (N).
    wanted: f64,
    /// That under the command (N).
    force: f64,
}

/// What is nearest of the obstacles that the robot keeps clear of.
#[derive(Serialize)]
pub(super) struct NearestJson {
    obstacle: String,
    /// From 0.
    disc: usize,
}

impl ContactArgs {
    /// The clearance asked for (m).
    pub fn clearance(&self) -> Option<f64> {
        self.clearance
    }

    /// What is asked for in a scene.
    pub fn on(&self, robot: &Robot, scene: &Scene) -> anyhow::Result<ContactGoals> {
        let on_obstacle = |press: &PressArg| {
            let Some(obstacle) = scene.find(&press.obstacle) else {
                let names = scene
                    .obstacles()
                    .iter()
                    .map(|one| format!("{:?}", one.name));
                bail!(
                    "--press: the scene has no obstacle {:?}; expected one of {}",
                    press.obstacle,
                    names.collect::<Vec<_>>().join(", ")
                );
            };
            let disc = match press.presser {
                Presser::Robot => None,
                Presser::Tip => Some(robot.discs().len() - 1),
                Presser::Disc(disc) => Some(disc),
            };
            Ok(Press {
                disc,
                ..Press::new(obstacle, press.force)
            })
        };
        Ok(ContactGoals {
            presses: self
                .presses
                .iter()
                .map(on_obstacle)
                .collect::<Result<_, _>>()?,
            clearance: self.clearance,
        })
    }
}

impl PressJson {
    /// The forces of a solution.
    pub fn all_of(goals: &ContactGoals, scene: &Scene, solution: &ShapeSolution) -> Vec<Self> {
        let presses = goals.presses.iter().zip(&solution.forces);
        presses
            .map(|(press, &force)| Self {
                obstacle: scene.obstacles()[press.obstacle].name.clone(),
                disc: press.disc,
                wanted: press.force,
                force,
            })
            .collect()
    }

    /// The force beside what was asked for.
    pub fn missed(&self) -> String {
        let Self {
            obstacle,
            force,
            wanted,
            ..
        } = self;
        format!("the robot presses on {obstacle:?} with {force:.6} of {wanted} N")
    }

    /// The force, as the end of a sentence.
    pub fn in_words(&self) -> String {
        format!("presses on {:?} with {:.6} N", self.obstacle, self.force)
    }
}

impl NearestJson {
    /// That of a solution.
    pub fn of(scene: &Scene, solution: &ShapeSolution) -> Option<Self> {
        solution.nearest.map(|nearest| Self {
            obstacle: scene.obstacles()[nearest.obstacle].name.clone(),
            disc: nearest.disc,
        })
    }
}

/// Parses a distance of at least 0.
fn clearance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if f64::is_finite(number) && number >= 0.0 => Ok(number),
        _ => Err("expected a finite number of at least 0".to_owned()),
    }
}

/// Parses `OBSTACLE=FORCE[@DISC]`; names may have any of these signs.
fn press(text: &str) -> Result<PressArg, String> {
    let (obstacle, rest) =
        (text.rsplit_once('=')).ok_or("expected OBSTACLE=FORCE, a name and a force in N")?;
    let (force, presser) = match rest.split_once('@') {
        None => (rest, Presser::Robot),
        Some((force, "tip")) => (force, Presser::Tip),
        Some((force, disc)) => {
            let number = disc.parse().map_err(|_| {
                format!("`{disc}` is no disc; expected its number, from 0 at the base, or tip")
            })?;
            (force, Presser::Disc(number))
        }
    };
    Ok(PressArg {
        obstacle: obstacle.to_owned(),
        force: super::positive(force).map_err(|wrong| format!("the force: {wrong}"))?,
        presser,
    })
}
