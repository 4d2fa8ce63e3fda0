//! The command and the base's pose for which a robot lies on a curve: least squares of its discs' distances from it, by Gauss and
//! Newton's method with Levenberg's damping, in the box of commands.

use nalgebra::{DMatrix, DVector, Isometry3, Translation3, UnitQuaternion, Vector3};
use tdcr_sim::chain::Configuration;
use tdcr_sim::contact::{Contact, ContactSettler};
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;
use tdcr_sim::statics::Equilibrium;

use super::BaseMotion;
use super::curve::Curve;

/// What a change of a command over its whole range counts as, as a share of the backbone's length: small, so that it decides only
/// between commands for which the robot lies on the curve equally well.
const CHOICE: f64 = 2e-3;
/// What one of the base's rotation by a radian counts as.
const TURN: f64 = 2e-3;
/// Steps at most, and improvement of the sum of squares that ends them.
const STEPS: usize = 30;
const IMPROVEMENT: f64 = 1e-4;
/// Weight of the tip's distance from where it should be, on a carriage, beside those of other discs.
const TIP: f64 = 10.0;
/// How often a robot that touches obstacles is moved until its tip is where it should be: as its base moves, it settles otherwise.
const MOVES: usize = 8;
/// Distance of the tip from there that ends that, as a share of the backbone's length.
const PLACED: f64 = 1e-7;

/// Where a robot and its base are.
#[derive(Clone, Debug)]
pub(super) struct Posed {
    pub command: Command,
    /// The base's pose in the world (m).
    pub base: Isometry3<f64>,
    /// With discs in the world.
    pub equilibrium: Equilibrium,
    /// What the robot touches.
    pub contacts: Vec<Contact>,
    settler: ContactSettler,
}

impl Posed {
    /// The robot with its base in its pose.
    pub fn at_base(&self, robot: &Robot) -> Robot {
        let mut spec = robot.spec().clone();
        spec.base.position = self.base.translation.vector.into();
        spec.base.orientation = self.settler.robot().spec().base.orientation;
        Robot::new(spec).unwrap_or_else(|_| self.settler.robot().clone())
    }
}

/// A robot that is laid on curves.
pub(super) struct Fitter<'a> {
    robot: &'a Robot,
    scene: &'a Scene,
    loads: &'a Loads,
    motion: BaseMotion,
    /// Arc length of each disc from the base (m); the last is that of the backbone.
    arcs: Vec<f64>,
}

/// Residuals and their derivatives.
struct Expansion {
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
}

impl<'a> Fitter<'a> {
    pub fn new(robot: &'a Robot, scene: &'a Scene, loads: &'a Loads, motion: BaseMotion) -> Self {
        Self {
            robot,
            scene,
            loads,
            motion,
            arcs: robot.arc_lengths(),
        }
    }

    /// Length of the backbone (m).
    pub fn length(&self) -> f64 {
        self.arcs[self.arcs.len() - 1]
    }

    /// Where the robot is under a command with its base in a pose, settled from a configuration near there or the straight pose; `None`
    /// where it does not settle, or starts inside an obstacle.
    pub fn settle(
        &self,
        command: &Command,
        base: Isometry3<f64>,
        near: Option<&Configuration>,
    ) -> Option<Posed> {
        let mut spec = self.robot.spec().clone();
        spec.base.position = base.translation.vector.into();
        let q = base.rotation;
        spec.base.orientation = [q.w, q.i, q.j, q.k];
        let robot = Robot::new(spec).ok()?;
        let mut settler = ContactSettler::new(&robot, self.scene);
        let settled = match near {
            Some(near) => settler.settle_from(near, command, self.loads),
            None => settler.settle(command, self.loads),
        };
        let settled = settled.ok()?;
        let equilibrium = (settled.equilibrium.converged).then(|| settled.equilibrium.clone())?;
        Some(Posed {
            command: command.clone(),
            base,
            contacts: settled.contacts.clone(),
            equilibrium,
            settler,
        })
    }

    /// Lays the robot on a curve so that its tip is at an arc length `end` (m) of it, and what is less than `on` (m) from the tip on the
    /// curve; else as near as can be to where it is.
    pub fn lay(&self, posed: &Posed, curve: &Curve, [end, on]: [f64; 2]) -> Option<Posed> {
        let before = posed;
        let mut posed = self.with_tip_at(posed.clone(), curve.at(end))?;
        let mut expansion = self.expand(&posed, before, curve, [end, on])?;
        let mut damping = 1e-6;
        for _ in 0..STEPS {
            let cost = expansion.residuals.norm_squared();
            let Some(step) = self.step(&posed, &expansion, damping) else {
                break;
            };
            let tried = self.moved(&posed, &step).and_then(|tried| {
                let tried = self.with_tip_at(tried, curve.at(end))?;
                let expansion = self.expand(&tried, before, curve, [end, on])?;
                Some((tried, expansion))
            });
            match tried {
                Some((better, there)) if there.residuals.norm_squared() < cost => {
                    let gained = 1.0 - there.residuals.norm_squared() / cost;
                    (posed, expansion) = (better, there);
                    damping = (damping / 10.0).max(1e-9);
                    if gained < IMPROVEMENT {
                        break;
                    }
                }
                _ if damping > 1e3 => break,
                _ => damping *= 10.0,
            }
        }
        Some(posed)
    }

    /// With a base that is free, the same moved so that its tip is at a point (m): all of it alike, or among obstacles its base, until
    /// it settles so. `None` where it does not settle.
    fn with_tip_at(&self, mut posed: Posed, tip: Vector3<f64>) -> Option<Posed> {
        if self.motion != BaseMotion::Free {
            return Some(posed);
        }
        for _ in 0..MOVES {
            let places = &mut posed.equilibrium.positions;
            let shift = tip - places[places.len() - 1];
            let base = Translation3::from(shift) * posed.base;
            if self.scene.obstacles().is_empty() {
                places.iter_mut().for_each(|place| *place += shift);
                posed.base = base;
                break;
            }
            if shift.norm() <= PLACED * self.length() {
                break;
            }
            let near = &posed.equilibrium.configuration;
            posed = self.settle(&posed.command, base, Some(near))?;
        }
        Some(posed)
    }

    /// Residuals (m) and their derivatives by the command's shares of its ranges and the base's motion.
    fn expand(
        &self,
        posed: &Posed,
        before: &Posed,
        curve: &Curve,
        [end, on]: [f64; 2],
    ) -> Option<Expansion> {
        let found = &posed.equilibrium;
        let sensitivity = posed.settler.sensitivity(&posed.command, self.loads).ok()?;
        let by_command = sensitivity.parameters().command_jacobian();
        let (discs, tendons) = (self.arcs.len(), by_command.ncols());
        let tip = discs - 1;
        let length = self.length();
        let scale = (length / discs as f64).sqrt();
        let laid: Vec<usize> = (0..discs)
            .filter(|&disc| length - self.arcs[disc] <= on)
            .collect();
        let base = self.base_unknowns();
        let unknowns = tendons + base;
        let rows = 3 * laid.len() + unknowns;
        let mut residuals = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, unknowns);
        let slope = |disc: usize, unknown: usize| -> Vector3<f64> {
            let places = &found.positions;
            if unknown < tendons {
                let [low, high] = self.robot.tendons()[unknown].range;
                let own = by_command
                    .fixed_view::<3, 1>(6 * disc, unknown)
                    .into_owned();
                let of_tip = by_command.fixed_view::<3, 1>(6 * tip, unknown).into_owned();
                return match self.motion {
                    BaseMotion::Free => (own - of_tip) * (high - low),
                    BaseMotion::Carriage => own * (high - low),
                };
            }
            match self.motion {
                // The sag's change with the base's rotation is small beside the rotation.
                BaseMotion::Free => {
                    Vector3::ith(unknown - tendons, 1.0).cross(&(places[disc] - places[tip]))
                }
                BaseMotion::Carriage => posed.base.rotation * Vector3::z(),
            }
        };
        for (row, &disc) in laid.iter().enumerate() {
            let place = found.positions[disc];
            let (target, along, weight) = match (self.motion, disc == tip) {
                (BaseMotion::Carriage, true) => (curve.at(end), None, TIP),
                _ => {
                    let (point, along) = curve.nearest(&place, end);
                    (point, along, 1.0)
                }
            };
            // Along the curve it may be anywhere.
            let across = |v: Vector3<f64>| weight * (along.map_or(v, |t| v - t * t.dot(&v)));
            residuals
                .fixed_rows_mut::<3>(3 * row)
                .copy_from(&(across(place - target) / scale));
            for unknown in 0..unknowns {
                let change = across(slope(disc, unknown)) / scale;
                jacobian
                    .fixed_view_mut::<3, 1>(3 * row, unknown)
                    .copy_from(&change);
            }
        }
        // Changes from before.
        let turned = (posed.base.rotation * before.base.rotation.inverse()).scaled_axis();
        let moved = posed.base.translation.vector - before.base.translation.vector;
        for unknown in 0..unknowns {
            let row = 3 * laid.len() + unknown;
            let (change, weight) = match unknown < tendons {
                true => {
                    let [low, high] = self.robot.tendons()[unknown].range;
                    let [a, b] = [posed, before].map(|one| one.command.as_slice()[unknown]);
                    let range = f64::max(high - low, f64::MIN_POSITIVE);
                    ((a - b) / range, CHOICE * length)
                }
                false => match self.motion {
                    BaseMotion::Free => (turned[unknown - tendons], TURN * length),
                    BaseMotion::Carriage => (moved.dot(&(posed.base.rotation * Vector3::z())), 0.0),
                },
            };
            residuals[row] = weight * change / scale;
            jacobian[(row, unknown)] = weight / scale;
        }
        Some(Expansion {
            residuals,
            jacobian,
        })
    }

    /// The step of Gauss and Newton, damped; commands at an end of their range stay there where they would go beyond.
    fn step(&self, posed: &Posed, at: &Expansion, damping: f64) -> Option<DVector<f64>> {
        let gradient = at.jacobian.tr_mul(&at.residuals);
        let mut normal = at.jacobian.tr_mul(&at.jacobian);
        let largest = normal.diagonal().max();
        for (k, tendon) in self.robot.tendons().iter().enumerate() {
            let (value, [low, high]) = (posed.command.as_slice()[k], tendon.range);
            let held = (value <= low && gradient[k] > 0.0) || (value >= high && gradient[k] < 0.0);
            if held || high <= low {
                normal.row_mut(k).fill(0.0);
                normal.column_mut(k).fill(0.0);
                normal[(k, k)] = f64::INFINITY;
            }
        }
        for k in 0..gradient.len() {
            match normal[(k, k)].is_finite() {
                true => normal[(k, k)] += damping * largest,
                false => normal[(k, k)] = largest * 1e12,
            }
        }
        normal.cholesky().map(|factor| -factor.solve(&gradient))
    }

    /// The robot after a step, with commands within their ranges.
    fn moved(&self, posed: &Posed, step: &DVector<f64>) -> Option<Posed> {
        let tendons = self.robot.tendons();
        let values: Vec<f64> = (tendons.iter().enumerate())
            .map(|(k, tendon)| {
                let [low, high] = tendon.range;
                (posed.command.as_slice()[k] + step[k] * (high - low)).clamp(low, high)
            })
            .collect();
        let command = self.robot.command(&values).ok()?;
        let rest = step.rows_range(tendons.len()..);
        let base = match self.motion {
            BaseMotion::Free => {
                let turn =
                    UnitQuaternion::from_scaled_axis(Vector3::new(rest[0], rest[1], rest[2]));
                Isometry3::from_parts(posed.base.translation, turn * posed.base.rotation)
            }
            BaseMotion::Carriage => {
                Translation3::from(posed.base.rotation * Vector3::z() * rest[0]) * posed.base
            }
        };
        self.settle(&command, base, Some(&posed.equilibrium.configuration))
    }

    fn base_unknowns(&self) -> usize {
        match self.motion {
            BaseMotion::Free => 3,
            BaseMotion::Carriage => 1,
        }
    }
}
