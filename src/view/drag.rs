//! A disc that follows the hand.
//!
//! A damped least-squares step (Wampler 1986; Nakamura and Hanafusa 1986) on the Jacobian of the disc's origin by the command, in
//! shares of the tendons' ranges, and a settle along it; tendons at an end of their range that would have to go on are left out.

use nalgebra::{DMatrix, DVector, Vector3};
use tdcr_sim::contact::{ContactError, ContactSettler};
use tdcr_sim::robot::{Command, Loads, Robot};

/// Steps for one place of the hand at most: the solver answers within a frame.
const STEPS: usize = 6;
/// Distance (m) that counts as arrived.
const ARRIVED: f64 = 1e-6;
/// The farthest that a disc is led in one step, as a share of the robot's length: equilibria are followed.
const STRIDE: f64 = 0.04;
/// Damping of the least squares, as a share of the largest diagonal entry.
const DAMPING: [f64; 4] = [1e-4, 1e-2, 0.1, 1.0];

/// Leads disc `disc` towards `to` (m) from the settler's equilibrium of `command`; returns the command that it ends with.
pub(super) fn lead(
    settler: &mut ContactSettler,
    mut command: Command,
    loads: &Loads,
    disc: usize,
    to: Vector3<f64>,
) -> Result<Command, ContactError> {
    let robot = settler.robot().clone();
    let stride = STRIDE * robot.arc_lengths().last().copied().unwrap_or(1.0);
    for _ in 0..STEPS {
        let error = to - settler.found().equilibrium.positions[disc];
        if error.norm() < ARRIVED {
            break;
        }
        let Ok(sensitivity) = settler.sensitivity(&command, loads) else {
            break;
        };
        let jacobian = sensitivity.parameters().command_jacobian();
        let rows = jacobian.rows(6 * disc, 3);
        let slope = DMatrix::from_fn(3, rows.ncols(), |row, tendon| {
            rows[(row, tendon)] * width(&robot, tendon)
        });
        let wanted = error * (stride / error.norm()).min(1.0);
        match nearer(settler, &robot, &command, loads, (disc, to), &slope, wanted)? {
            Some(next) => command = next,
            None => break,
        }
    }
    Ok(command)
}

/// A command under which the disc is nearer to the place, followed; `None`, and the equilibrium of `command`, where none is found.
fn nearer(
    settler: &mut ContactSettler,
    robot: &Robot,
    command: &Command,
    loads: &Loads,
    (disc, to): (usize, Vector3<f64>),
    slope: &DMatrix<f64>,
    wanted: Vector3<f64>,
) -> Result<Option<Command>, ContactError> {
    let before = settler.found().equilibrium.clone();
    let distance = (to - before.positions[disc]).norm();
    for damping in DAMPING {
        let step = step(robot, command, slope, wanted, damping);
        let values = command.as_slice().iter().zip(step.iter()).enumerate();
        let values: Vec<f64> = values
            .map(|(tendon, (value, step))| {
                let [low, high] = robot.tendons()[tendon].range;
                (value + step * width(robot, tendon)).clamp(low, high)
            })
            .collect();
        let Ok(next) = robot.command(&values) else {
            break;
        };
        let found = &settler.follow(&next, loads)?.equilibrium;
        if found.converged && (to - found.positions[disc]).norm() < distance {
            return Ok(Some(next));
        }
        settler.settle_from(&before.configuration, command, loads)?;
    }
    Ok(None)
}

/// The change of the command, in shares of the tendons' ranges, that moves the disc by `wanted` (m) as far as damping lets it.
fn step(
    robot: &Robot,
    command: &Command,
    slope: &DMatrix<f64>,
    wanted: Vector3<f64>,
    damping: f64,
) -> DVector<f64> {
    let tendons = slope.ncols();
    let mut is_free = vec![true; tendons];
    loop {
        let mut normal = slope.transpose() * slope;
        let mut side = slope.transpose() * wanted;
        let most = normal.diagonal().max().max(f64::MIN_POSITIVE);
        for tendon in 0..tendons {
            if is_free[tendon] {
                normal[(tendon, tendon)] += damping * most;
            } else {
                normal.row_mut(tendon).fill(0.0);
                normal.column_mut(tendon).fill(0.0);
                normal[(tendon, tendon)] = 1.0;
                side[tendon] = 0.0;
            }
        }
        let Some(factor) = normal.cholesky() else {
            return DVector::zeros(tendons);
        };
        let step = factor.solve(&side);
        let mut is_bound = false;
        for tendon in 0..tendons {
            let [low, high] = robot.tendons()[tendon].range;
            let value = command.as_slice()[tendon];
            let leaves =
                (value <= low && step[tendon] < 0.0) || (value >= high && step[tendon] > 0.0);
            if is_free[tendon] && leaves {
                is_free[tendon] = false;
                is_bound = true;
            }
        }
        if !is_bound {
            return step;
        }
    }
}

fn width(robot: &Robot, tendon: usize) -> f64 {
    let [low, high] = robot.tendons()[tendon].range;
    high - low
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use nalgebra::Vector3;
    use tdcr_sim::contact::ContactSettler;
    use tdcr_sim::robot::{Loads, Robot};
    use tdcr_sim::scene::Scene;

    use super::lead;

    #[test]
    fn a_dragged_tip_arrives_where_another_command_brings_it_and_stops_short_out_of_reach() {
        let robot = Robot::load("2m").unwrap();
        let loads = Loads::default();
        let start = robot
            .command(&[0.020, 0.010, 0.010, 0.015, 0.012, 0.010])
            .unwrap();
        let goal = robot
            .command(&[0.012, 0.021, 0.006, 0.010, 0.020, 0.008])
            .unwrap();
        let tip = robot.discs().len() - 1;
        let to = robot.settle(&goal, &loads).positions[tip];
        let mut settler = ContactSettler::new(&robot, &Scene::default());
        let mut command = start;
        settler.settle(&command, &loads).unwrap();
        for _ in 0..30 {
            command = lead(&mut settler, command, &loads, tip, to).unwrap();
        }
        let reached = settler.found().equilibrium.positions[tip];
        assert!((reached - to).norm() < 1e-4, "{reached} m, not {to}");

        let far = Vector3::new(2.0, 0.0, 0.0);
        for _ in 0..30 {
            command = lead(&mut settler, command, &loads, tip, far).unwrap();
        }
        let found = &settler.found().equilibrium;
        assert!(
            found.converged && found.positions[tip].x > reached.x,
            "{}",
            found.positions[tip]
        );
        assert!(robot.command(command.as_slice()).is_ok());
    }
}
