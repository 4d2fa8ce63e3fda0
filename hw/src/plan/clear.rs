//! Keeping clear of obstacles.

use tdcr_sim::geometry::Beads;
use tdcr_sim::pose::Pose;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;

use super::error::PlanError;

/// Farthest (m) that a disc may move between two equilibria that are looked at. Between them it may come nearer to an obstacle by
/// half of that.
pub(super) const LOOK_EVERY: f64 = 2e-3;

/// Obstacles that a robot's discs keep a distance from.
#[derive(Clone, Debug)]
pub(super) struct KeptClear {
    scene: Scene,
    beads: Beads,
    /// m.
    clearance: f64,
}

impl KeptClear {
    /// For `robot`; the distance is `clearance` (m).
    pub fn new(robot: &Robot, scene: Scene, clearance: f64) -> Self {
        Self {
            scene,
            beads: Beads::new(robot),
            clearance,
        }
    }

    /// Refuses an equilibrium with a disc that is too near to an obstacle, or may have been on the way of at most
    /// [`LOOK_EVERY`] from or to another one. `part` is where it stands on its way.
    pub fn check(&self, pose: Pose<'_>, part: f64) -> Result<(), PlanError> {
        let discs = (0..pose.positions.len()).map(|disc| pose.disc(disc));
        let Some(nearest) = self.scene.nearest(&self.beads, discs) else {
            return Ok(());
        };
        let distance = nearest.gap - self.beads.shape_error();
        let least = self.clearance + 0.5 * LOOK_EVERY;
        if distance >= least {
            return Ok(());
        }
        Err(PlanError::Near {
            obstacle: self.scene.obstacles()[nearest.obstacle].name.clone(),
            disc: nearest.disc,
            distance,
            part,
            least,
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::path::Path;

    use nalgebra::Vector3;
    use tdcr_sim::robot::{Command, Loads};
    use tdcr_sim::statics::Settler;

    use super::*;
    use crate::capture::Program;
    use crate::rig::{RigError, RigFile};

    const CLEARANCE: f64 = 0.004;

    /// The example's rig beside a wall, so far from its axis (m).
    fn beside_a_wall(away: f64, clearance: f64) -> Result<RigFile, RigError> {
        let shape = "box = { size = [0.02, 2.0, 2.0] }";
        beside(shape, [away + 0.01, 0.0, 0.0], clearance, 0.02)
    }

    /// The example's rig beside a wall of some shape and place (m), with a slew (m/s).
    fn beside(
        shape: &str,
        position: [f64; 3],
        clearance: f64,
        slew: f64,
    ) -> Result<RigFile, RigError> {
        let folder = tempfile::tempdir().unwrap();
        let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples");
        std::fs::copy(
            examples.join("paper-robot.toml"),
            folder.path().join("paper-robot.toml"),
        )
        .unwrap();
        let wall = format!("[[obstacle]]\nname = \"wall\"\n{shape}\nposition = {position:?}\n");
        std::fs::write(folder.path().join("wall.toml"), wall).unwrap();
        let rig = std::fs::read_to_string(examples.join("rig-sim.toml")).unwrap();
        let scene = format!("[scene]\nfile = \"wall.toml\"\nclearance = {clearance}\n\n[motion]");
        let rig = rig.replacen("[motion]", &scene, 1);
        let rig = rig.replace("slew = 0.02", &format!("slew = {slew}"));
        RigFile::parse(&rig, &folder.path().join("rig.toml"))
    }

    /// Smallest distance (m) of a robot from a scene on the straight lines between commands, at ten places on each.
    fn nearest_on(file: &RigFile, scene: &Scene, from: &[f64], way: &[Command]) -> f64 {
        let robot = file.compile().unwrap();
        let beads = Beads::new(&robot);
        let mut settler = Settler::new(&robot);
        settler.settle(&robot.command(from).unwrap(), &Loads::default());
        let (mut last, mut least) = (from.to_vec(), f64::INFINITY);
        for command in way {
            for part in 1..=10 {
                let share = f64::from(part) / 10.0;
                let values = last.iter().zip(command.as_slice());
                let values: Vec<f64> = values.map(|(a, b)| a + share * (b - a)).collect();
                let settled = settler.follow(&robot.command(&values).unwrap(), &Loads::default());
                let pose = settled.pose();
                let discs = (0..pose.positions.len()).map(|disc| pose.disc(disc));
                let nearest = scene.nearest(&beads, discs).unwrap();
                least = least.min(nearest.gap - beads.shape_error());
            }
            last = command.as_slice().to_vec();
        }
        least
    }

    #[test]
    fn ways_by_chance_keep_clear_of_a_wall_between_looks_too() {
        let file = beside_a_wall(0.03, CLEARANCE).unwrap();
        let mut free = file.clone();
        free.scene = None;
        let scene = file.scene.clone().unwrap();
        let nearest = |file: &RigFile| -> Vec<f64> {
            let mut program = Program::new(file, 3).unwrap();
            let rest = program.rest().clone();
            let from = program.command_at(&(&rest).into()).unwrap();
            let each = (0..12).map(|index| {
                let drawn = program.draw(index).unwrap();
                let way = program.path(&rest, &drawn.shape).unwrap();
                nearest_on(file, &scene, from.as_slice(), &way)
            });
            each.collect()
        };
        let kept = nearest(&file);
        assert!(kept.iter().all(|&gap| gap >= CLEARANCE), "{kept:?}");
        let without = nearest(&free);
        let near = without.iter().filter(|&&gap| gap < CLEARANCE).count();
        assert!(near >= 2, "{without:?}");
    }

    #[test]
    fn a_command_or_a_home_that_is_too_near_is_told_with_disc_and_obstacle() {
        let file = beside_a_wall(0.03, CLEARANCE).unwrap();
        let mut free = file.clone();
        free.scene = None;
        let mut program = Program::new(&file, 3).unwrap();
        let mut unbounded = Program::new(&free, 3).unwrap();
        let refused = (0..12).find_map(|index| {
            let drawn = unbounded.draw(index).unwrap();
            program.given(drawn.command.as_slice()).err()
        });
        let refused = refused.unwrap();
        assert!(matches!(refused, PlanError::Near { .. }), "{refused}");
        let told = refused.to_string();
        assert!(told.contains("mm from the obstacle `wall`"), "{told}");
        let home = Program::new(&beside_a_wall(0.02, CLEARANCE).unwrap(), 3);
        let told = home.unwrap_err().to_string();
        assert!(told.contains("`wall`, 0 % of the way"), "{told}");
        for clearance in [-0.001, f64::INFINITY] {
            let told = beside_a_wall(0.03, clearance).unwrap_err().to_string();
            assert!(told.contains("scene.clearance is"), "{told}");
            assert!(told.contains("a distance of 0 or more"), "{told}");
        }
    }

    /// A ball beside the tip's way, which is too near to it between the last two commands of quick servos, and at none of them.
    #[test]
    fn what_lies_between_the_commands_of_a_way_is_seen() {
        const SLEW: f64 = 0.06;
        let ball = |at: Vector3<f64>| {
            let shape = "sphere = { radius = 0.002 }";
            beside(shape, at.into(), CLEARANCE, SLEW).unwrap()
        };
        let mut free = ball(Vector3::new(1.0, 1.0, 1.0));
        free.scene = None;
        let robot = free.compile().unwrap();
        let beads = Beads::new(&robot);
        let gap = |file: &RigFile, values: &[f64]| {
            let settled = robot.settle(&robot.command(values).unwrap(), &Loads::default());
            let pose = settled.pose();
            let discs = (0..pose.positions.len()).map(|disc| pose.disc(disc));
            let scene = file.scene.as_ref().unwrap();
            scene.nearest(&beads, discs).unwrap().gap - beads.shape_error()
        };
        let tip = |values: &[f64]| {
            let settled = robot.settle(&robot.command(values).unwrap(), &Loads::default());
            let end = settled.positions.len() - 1;
            (
                settled.positions[end],
                settled.positions[end] - settled.positions[end - 1],
            )
        };
        let mut program = Program::new(&free, 3).unwrap();
        let home = program.command_at(&program.rest().into()).unwrap();
        let mut seen = 0;
        for index in 0..12 {
            let to = program.draw(index).unwrap().command;
            let mut way = program.path(home.clone(), to.clone()).unwrap();
            way.insert(0, home.clone());
            let [.., before, last] = way.as_slice() else {
                panic!("a way of no step")
            };
            let values = before.as_slice().iter().zip(last.as_slice());
            let between: Vec<f64> = values.map(|(a, b)| 0.5 * (a + b)).collect();
            // Across the way, a little too near to where the tip is half-way.
            let motion = (tip(last.as_slice()).0 - tip(before.as_slice()).0).normalize();
            let (at, axis) = tip(&between);
            let across = (axis - axis.dot(&motion) * motion).normalize();
            let far = 0.1;
            let away = far - gap(&ball(at + far * across), &between);
            let file = ball(at + (away + CLEARANCE + 0.4 * LOOK_EVERY) * across);
            let least = CLEARANCE + 0.5 * LOOK_EVERY;
            let clear_at_each = way.iter().all(|at| gap(&file, at.as_slice()) >= least);
            if gap(&file, &between) >= least || !clear_at_each {
                continue;
            }
            let refused = Program::new(&file, 3).unwrap().given(to.as_slice());
            assert!(
                matches!(refused, Err(PlanError::Near { .. })),
                "{refused:?}"
            );
            seen += 1;
        }
        assert!(seen > 0, "no step is long enough");
    }
}
