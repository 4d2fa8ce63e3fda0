//! A disc that follows the hand.
//!
//! A damped least-squares step (Wampler 1986; Nakamura and Hanafusa 1986) on the Jacobian of the disc's origin by the command, in
//! shares of the tendons' ranges, and a settle along it; tendons at an end of their range that would have to go on are left out.
//! A step that does not bring the disc nearer is damped more (Levenberg 1944; Marquardt 1963), and the steps of the next frame begin
//! with about the damping that did. What a frame has no time for is left to the next one.

use std::time::{Duration, Instant};

use nalgebra::{DMatrix, DVector, Vector3};
use tdcr_sim::contact::{ContactError, ContactSettler};
use tdcr_sim::robot::{Command, Loads, Robot};

/// Steps in one frame at most.
const STEPS: usize = 6;
/// Dampings that are tried in one step at most: the next frame goes on with the others.
const TRIALS: usize = 2;
/// Time of a frame after which no settle is begun any more: half of what 60 Hz leave.
const TIME: Duration = Duration::from_millis(8);
/// A disc that comes nearer by less than this in a frame (m) is left where it is.
const PROGRESS: f64 = 1e-4;
/// Distance (m) that counts as arrived.
const ARRIVED: f64 = 1e-6;
/// The farthest that a disc is led in one step, as a share of the robot's length: equilibria are followed.
const STRIDE: f64 = 0.04;
/// Damping of the least squares, as a share of the largest diagonal entry.
const DAMPING: [f64; 6] = [1e-4, 1e-2, 0.1, 1.0, 10.0, 100.0];

/// A hand that leads a disc.
#[derive(Default)]
pub(super) struct Hand {
    /// Where it leads which disc (m), as long as that comes nearer.
    chased: Option<(usize, Vector3<f64>)>,
    /// Place of the damping to begin with.
    damping: usize,
}

/// What a step came to.
enum Step {
    /// The disc is nearer, under this command.
    Nearer(Command),
    /// No command was found under which it is.
    Stuck,
    /// Others are still to be tried.
    Late,
}

impl Hand {
    /// Takes a disc to a place (m).
    pub fn take(&mut self, disc: usize, to: Vector3<f64>) {
        self.chased = Some((disc, to));
    }

    /// Lets go.
    pub fn let_go(&mut self) {
        self.chased = None;
    }

    /// Whether a disc is on its way.
    pub fn leads(&self) -> bool {
        self.chased.is_some()
    }

    /// Leads the disc towards its place for a frame, from the settler's equilibrium of `command`; returns the command that it ends
    /// with.
    pub fn lead(
        &mut self,
        settler: &mut ContactSettler,
        mut command: Command,
        loads: &Loads,
    ) -> Result<Command, ContactError> {
        let Some((disc, to)) = self.chased else {
            return Ok(command);
        };
        let until = Instant::now() + TIME;
        let robot = settler.robot().clone();
        let stride = STRIDE * robot.arc_lengths().last().copied().unwrap_or(1.0);
        let apart = |settler: &ContactSettler| to - settler.found().equilibrium.positions[disc];
        let before = apart(settler).norm();
        for number in 0..STEPS {
            let error = apart(settler);
            if error.norm() < ARRIVED {
                self.let_go();
                break;
            }
            if number > 0 && Instant::now() >= until {
                break;
            }
            let Ok(sensitivity) = settler.sensitivity(&command, loads) else {
                self.let_go();
                break;
            };
            let jacobian = sensitivity.parameters().command_jacobian();
            let rows = jacobian.rows(6 * disc, 3);
            let slope = DMatrix::from_fn(3, rows.ncols(), |row, tendon| {
                rows[(row, tendon)] * width(&robot, tendon)
            });
            let wanted = error * (stride / error.norm()).min(1.0);
            match self.step(
                settler,
                (&command, loads),
                (disc, to),
                &slope,
                wanted,
                until,
            )? {
                Step::Nearer(next) => command = next,
                Step::Stuck => {
                    self.let_go();
                    break;
                }
                // The next frame tries on with more damping.
                Step::Late => return Ok(command),
            }
        }
        if before - apart(settler).norm() < PROGRESS {
            self.let_go();
        }
        Ok(command)
    }

    /// Brings the disc nearer to its place, followed; where that fails, the equilibrium of the command stays.
    fn step(
        &mut self,
        settler: &mut ContactSettler,
        (command, loads): (&Command, &Loads),
        (disc, to): (usize, Vector3<f64>),
        slope: &DMatrix<f64>,
        wanted: Vector3<f64>,
        until: Instant,
    ) -> Result<Step, ContactError> {
        let robot = settler.robot().clone();
        let before = settler.found().equilibrium.clone();
        let distance = (to - before.positions[disc]).norm();
        let first = self.damping;
        for (place, &damping) in DAMPING.iter().enumerate().skip(first) {
            self.damping = place;
            if place > first && (place == first + TRIALS || Instant::now() >= until) {
                return Ok(Step::Late);
            }
            let step = step(&robot, command, slope, wanted, damping);
            let values = command.as_slice().iter().zip(step.iter()).enumerate();
            let values: Vec<f64> = values
                .map(|(tendon, (value, step))| {
                    let [low, high] = robot.tendons()[tendon].range;
                    (value + step * width(&robot, tendon)).clamp(low, high)
                })
                .collect();
            let Ok(next) = robot.command(&values) else {
                break;
            };
            let found = &settler.follow(&next, loads)?.equilibrium;
            if found.converged && (to - found.positions[disc]).norm() < distance {
                self.damping = place.saturating_sub(1);
                return Ok(Step::Nearer(next));
            }
            settler.settle_from(&before.configuration, command, loads)?;
        }
        self.damping = 0;
        Ok(Step::Stuck)
    }
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

    use super::{Hand, STEPS};

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
        let mut hand = Hand::default();
        hand.take(tip, to);
        let mut frames = 0;
        while hand.leads() {
            command = hand.lead(&mut settler, command, &loads).unwrap();
            frames += 1;
        }
        assert!(frames > 1, "{STEPS} steps are too few for the whole way");
        let reached = settler.found().equilibrium.positions[tip];
        assert!((reached - to).norm() < 1e-4, "{reached} m, not {to}");

        let far = Vector3::new(2.0, 0.0, 0.0);
        hand.take(tip, far);
        while hand.leads() {
            command = hand.lead(&mut settler, command, &loads).unwrap();
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
