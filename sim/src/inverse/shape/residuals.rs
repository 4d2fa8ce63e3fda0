//! What a search makes small, and its derivatives by the command.

use nalgebra::{DMatrix, DVector, Matrix3xX};

use super::Press;
use super::apart::Kept;
use super::gap::{gap_of, nearest_bead};
use super::problem::Problem;
use crate::contact::{ContactSensitivity, ContactSettler};
use crate::inverse::least_squares::Evaluation;
use crate::sensitivity::{PoseTangent, Sensitivity};
use crate::statics::Equilibrium;

/// Derivatives of an equilibrium among the obstacles that may be touched.
enum Derivatives {
    Alone(Box<Sensitivity>),
    Touching(Box<ContactSensitivity>),
}

impl Derivatives {
    fn by_command(&self) -> DMatrix<f64> {
        match self {
            Self::Alone(sensitivity) => sensitivity.command_jacobian(),
            Self::Touching(sensitivity) => sensitivity.parameters().command_jacobian(),
        }
    }

    /// As [`ContactSensitivity::normal_force_gradient`].
    fn of_force(&self, obstacle: usize, disc: Option<usize>) -> Vec<PoseTangent> {
        match self {
            Self::Alone(_) => Vec::new(),
            Self::Touching(sensitivity) => sensitivity.normal_force_gradient(obstacle, disc),
        }
    }
}

/// Residuals (m), and their Jacobian by the command, row by row.
struct Rows {
    /// Jacobian of the discs' poses, as [`Sensitivity::jacobian`] has them.
    poses: DMatrix<f64>,
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
}

impl Rows {
    fn new(poses: DMatrix<f64>, rows: usize) -> Self {
        Self {
            residuals: DVector::zeros(rows),
            jacobian: DMatrix::zeros(rows, poses.ncols()),
            poses,
        }
    }

    /// Adds to a row of the Jacobian what a disc's pose does to the residual.
    fn add(&mut self, row: usize, disc: usize, by_pose: &PoseTangent, scale: f64) {
        let rows = |part: usize| self.poses.fixed_rows::<3>(6 * disc + 3 * part);
        let by_command = rows(0).tr_mul(&by_pose.position) + rows(1).tr_mul(&by_pose.rotation);
        let mut row = self.jacobian.row_mut(row);
        row += by_command.transpose() * scale;
    }
}

impl Problem<'_> {
    /// Residuals and Jacobian at an equilibrium, the last of `settler` where there are obstacles; `None` where it is not
    /// stable. Three rows for each target, one for each press, and one for each pair that is kept apart.
    pub fn evaluate(
        &self,
        settler: &ContactSettler,
        x: &DVector<f64>,
        settled: Equilibrium,
        kept: &Kept,
    ) -> Option<Evaluation<Equilibrium>> {
        let derivatives = self.derivatives(settler, x, &settled)?;
        let (targets, presses) = (3 * self.targets.len(), self.presses.len());
        let mut rows = Rows::new(derivatives.by_command(), targets + presses + kept.len());
        self.add_targets(&mut rows, &settled);
        for (press, row) in self.presses.iter().zip(targets..) {
            self.add_press(&mut rows, (row, press), settler, (&settled, &derivatives))?;
        }
        if let Some(apart) = &self.apart {
            let pairs = apart.residuals(kept, &settled);
            for ((residual, disc, by_pose), row) in pairs.zip(targets + presses..) {
                rows.residuals[row] = residual;
                rows.add(row, disc, &by_pose, 1.0);
            }
        }
        let Rows {
            residuals,
            mut jacobian,
            ..
        } = rows;
        for (mut column, tendon) in jacobian.column_iter_mut().zip(self.robot.tendons()) {
            column *= tendon.range[1] - tendon.range[0];
        }
        let finite = jacobian.iter().all(|x| x.is_finite());
        finite.then_some(Evaluation {
            residuals,
            jacobian,
            memory: settled,
        })
    }

    fn derivatives(
        &self,
        settler: &ContactSettler,
        x: &DVector<f64>,
        settled: &Equilibrium,
    ) -> Option<Derivatives> {
        let command = self.command(x);
        if self.touched.is_empty() {
            let sensitivity = self.robot.sensitivity(&command, self.loads, settled);
            return Some(Derivatives::Alone(Box::new(sensitivity.ok()?)));
        }
        let sensitivity = settler.sensitivity(&command, self.loads);
        Some(Derivatives::Touching(Box::new(sensitivity.ok()?)))
    }

    fn add_targets(&self, rows: &mut Rows, settled: &Equilibrium) {
        for (i, target) in self.targets.iter().enumerate() {
            let of_disc = |part: usize| -> Matrix3xX<f64> {
                let first = 6 * target.disc + 3 * part;
                rows.poses.fixed_rows::<3>(first).into()
            };
            let scale = target.weight.sqrt();
            let slope = target.error_jacobian(settled, [of_disc(0), of_disc(1)]) * scale;
            let error = target.error(settled) * scale;
            rows.residuals.fixed_rows_mut::<3>(3 * i).copy_from(&error);
            rows.jacobian.fixed_rows_mut::<3>(3 * i).copy_from(&slope);
        }
    }

    fn add_press(
        &self,
        rows: &mut Rows,
        (row, press): (usize, &Press),
        settler: &ContactSettler,
        (settled, derivatives): (&Equilibrium, &Derivatives),
    ) -> Option<()> {
        let scale = press.weight.sqrt();
        let number = self.numbers.iter().position(|&n| n == press.obstacle)?;
        let force = settler.found().normal_force(number, press.disc);
        let by_poses = derivatives.of_force(number, press.disc);
        for (disc, by_pose) in by_poses.iter().enumerate() {
            rows.add(row, disc, by_pose, scale * press.lever);
        }
        let ends = (press.obstacle, press.disc);
        let (bead, gap) = nearest_bead(&self.beads, self.scene, settled, ends)?;
        if gap > 0.0 {
            let ends = [bead, press.obstacle];
            let (_, by_pose) = gap_of(&self.beads, self.scene, settled, ends);
            rows.add(row, self.beads.as_slice()[bead].disc, &by_pose, -scale);
        }
        rows.residuals[row] = press.error(force, gap) * scale;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use crate::inverse::shape::problem::shares;
    use crate::inverse::shape::{ContactGoals, Search, ShapeController, Target};
    use crate::robot::{Loads, Robot};
    use crate::scene::{Obstacle, Scene};

    /// Largest difference of the Jacobian from differences of the residuals, as a share of its largest entry, at a command; and how many
    /// residuals of presses and of pairs are not 0.
    fn off(
        controller: &ShapeController,
        goals: &ContactGoals,
        command: &[f64],
    ) -> (f64, [usize; 2]) {
        let (robot, tip) = (controller.robot(), [0.02, 0.03, 0.3].into());
        let targets = [Target::tip(robot, tip)];
        let problem = Problem::new(controller, &targets, goals);
        let mut settler = ContactSettler::new(robot, &problem.touched);
        let x = shares(robot, &robot.command(command).unwrap());
        let settled = settler.settle(&problem.command(&x), problem.loads).unwrap();
        let settled = settled.equilibrium.clone();
        let mut kept = Kept::default();
        if let Some(apart) = &problem.apart {
            apart.join(&mut kept, &settled);
        }
        let mut at = |x: &DVector<f64>| {
            let found = problem.evaluate_from(&mut settler, x, &settled, &kept);
            let found = found.unwrap();
            (found.residuals, found.jacobian)
        };
        let (residuals, jacobian) = at(&x);
        let step = 1e-5;
        let differences = (0..x.len()).map(|tendon| {
            let moved = |way: f64| {
                let mut x = x.clone();
                x[tendon] += way;
                x
            };
            (at(&moved(step)).0 - at(&moved(-step)).0) / (2.0 * step)
        });
        let differences = DMatrix::from_columns(&differences.collect::<Vec<_>>());
        let others = residuals
            .as_slice()
            .split_at(3)
            .1
            .split_at(goals.presses.len());
        let counts = [others.0, others.1].map(|of| of.iter().filter(|r| **r != 0.0).count());
        (
            (jacobian.clone() - differences).amax() / jacobian.amax(),
            counts,
        )
    }

    /// Bent against a wall, near a ball.
    #[test]
    fn derivatives_of_forces_gaps_and_clearances_are_those_of_differences() {
        let robot = Robot::load("2m").unwrap();
        let wall = |compliance: f64| {
            let turned = nalgebra::UnitQuaternion::rotation_between(
                &nalgebra::Vector3::z(),
                &nalgebra::Vector3::x(),
            );
            let pose = nalgebra::Isometry3::from_parts([-0.06, 0.0, 0.0].into(), turned.unwrap());
            let wall = Obstacle::half_space("wall").with_pose(pose);
            wall.with_compliance(compliance).unwrap()
        };
        let ball = Obstacle::sphere("ball", 0.03)
            .unwrap()
            .at([0.06, 0.0, 0.25]);
        let bent = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
        let freely = [0.02, 0.018, 0.017, 0.02, 0.019, 0.018];
        // Differences feel how positions are rounded the more, the stiffer the wall.
        for (compliance, allowed) in [(1e-3, 1e-5), (1e-6, 1e-5), (0.0, 1e-3)] {
            let scene = Scene::new(vec![wall(compliance), ball.clone()]).unwrap();
            let search = Search {
                samples: 0,
                ..Search::default()
            };
            let loads = Loads::default();
            let controller = ShapeController::among(&robot, &scene, &loads, search).unwrap();
            let press = Press::new(0, 0.1);
            for (presses, clearance, command, counts) in [
                (vec![press], None, bent, [1, 0]),
                (
                    vec![Press {
                        disc: Some(9),
                        ..press
                    }],
                    Some(0.06),
                    bent,
                    [1, 1],
                ),
                (vec![press, Press::new(1, 0.1)], None, freely, [2, 0]),
                (Vec::new(), Some(0.05), freely, [0, 1]),
            ] {
                let goals = ContactGoals { presses, clearance };
                let (off, found) = off(&controller, &goals, &command);
                assert!(off < allowed, "{compliance} {goals:?}: {off:e}");
                assert!(found[0] == counts[0] && found[1] >= counts[1], "{found:?}");
            }
        }
    }
}
