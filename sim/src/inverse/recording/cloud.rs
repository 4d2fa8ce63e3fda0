//! Clouds: how far measured points are from the surface of a settled robot.
//!
//! A point's residual is its signed distance from the nearest solid that cameras see. Its derivative is that of a plane fixed to
//! the solid's body at the nearest place (point to plane: Chen and Medioni, Image and Vision Computing 10, 1992), which is exact: where
//! the nearest place lies on its body does not count to first order, as it is a minimum of the distance.

use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::geometry::{Shape, base_pose, base_solids, disc_solids, rod_pieces};
use crate::robot::{Robot, RobotSpec};
use crate::sensitivity::DiscPoint;
use crate::statics::Equilibrium;

/// What of a robot its clouds show besides the discs; nothing by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shown {
    /// Whether they show the base.
    pub base: bool,
    /// Radius of the rod at each disc's joint (m), from the base up; none where there is none, or beyond the list's end.
    pub rods: Vec<Option<f64>>,
}

impl Shown {
    /// What cameras see of a robot, with or without its `base`.
    pub fn of(spec: &RobotSpec, base: bool) -> Self {
        let radius = |disc: usize| Some(spec.modules[spec.module_of(disc)?].rod?.radius);
        Self {
            base,
            rods: (0..spec.disc_count()).map(radius).collect(),
        }
    }
}

/// The surface of a settled robot, as cameras see it.
pub struct Surface {
    pieces: Vec<Piece>,
}

/// A solid, and the body that carries it: a disc, or none for the base.
struct Piece {
    body: Option<usize>,
    shape: Shape,
    pose: Isometry3<f64>,
    /// How far it reaches from its middle (m).
    reach: f64,
}

/// The place on a surface that is nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The body that carries the place: a disc, or none for the base.
    pub body: Option<usize>,
    /// The place in the body's frame (m).
    pub in_body: Vector3<f64>,
    /// The place in the world (m).
    pub place: Vector3<f64>,
    /// Outward normal, world frame.
    pub normal: Vector3<f64>,
    /// Distance of the point (m), below 0 inside.
    pub distance: f64,
}

fn disc_pose(settled: &Equilibrium, disc: usize) -> Isometry3<f64> {
    Isometry3::from_parts(settled.positions[disc].into(), settled.orientations[disc])
}

impl Surface {
    /// The discs of `robot` where it has `settled`, and what else is `shown`.
    pub fn new(robot: &Robot, shown: &Shown, settled: &Equilibrium) -> Self {
        let piece = |body: Option<usize>, shape: Shape, pose: Isometry3<f64>| Piece {
            reach: shape.middle().norm() + shape.extents(&Matrix3::identity()).norm(),
            body,
            shape,
            pose,
        };
        let pose_of = |disc| disc_pose(settled, disc);
        let discs = disc_solids(robot, pose_of).enumerate();
        let mut pieces: Vec<Piece> = discs
            .map(|(disc, solid)| piece(Some(disc), solid.shape, solid.pose))
            .collect();
        let radius = |disc: usize| shown.rods.get(disc).copied().flatten();
        let rods = rod_pieces(robot, radius, pose_of).into_iter();
        pieces.extend(rods.map(|(body, shape, pose)| piece(body, shape, pose)));
        if shown.base {
            let base = base_solids(robot).into_iter();
            pieces.extend(base.map(|solid| piece(None, solid.shape, solid.pose)));
        }
        Self { pieces }
    }

    /// The places nearest to `points` (m, world frame), one for each, of the robot and the equilibrium that the surface was made of.
    pub fn touches(
        &self,
        robot: &Robot,
        settled: &Equilibrium,
        points: &[Vector3<f64>],
    ) -> Vec<Touch> {
        let body_pose = |body: Option<usize>| match body {
            Some(disc) => disc_pose(settled, disc),
            None => base_pose(robot),
        };
        let touch = |point: &Vector3<f64>| {
            let (piece, normal, distance) = self.nearest(point)?;
            let place = point - normal * distance;
            Some(Touch {
                body: piece.body,
                in_body: body_pose(piece.body)
                    .inverse_transform_point(&place.into())
                    .coords,
                place,
                normal,
                distance,
            })
        };
        points.iter().filter_map(touch).collect()
    }

    /// The solid nearest to a point, its normal there (world frame), and the distance (m).
    fn nearest(&self, point: &Vector3<f64>) -> Option<(&Piece, Vector3<f64>, f64)> {
        let mut best: Option<(&Piece, Vector3<f64>, f64)> = None;
        for piece in &self.pieces {
            let least = (point - piece.pose.translation.vector).norm() - piece.reach;
            if best.is_some_and(|(_, _, distance)| least > distance.abs()) {
                continue;
            }
            let local = piece.pose.inverse_transform_point(&(*point).into());
            let found = piece.shape.nearest(&local.coords);
            if best.is_none_or(|(_, _, distance)| found.distance.abs() < distance.abs()) {
                best = Some((piece, piece.pose * found.normal, found.distance));
            }
        }
        best
    }
}

/// Corners of a disc's frame, which carry what moves with the disc: its origin, and a place on each axis.
const CORNERS: usize = 4;
/// How far the corners are from the origin (m): about as far as a disc's surface.
const ARM: f64 = 0.01;

/// The corners of all discs of a robot; none where there are no points to carry.
pub(super) fn corners(discs: usize, points: usize) -> Vec<DiscPoint> {
    let discs = if points == 0 { 0 } else { discs };
    let arms = [
        Vector3::zeros(),
        Vector3::x() * ARM,
        Vector3::y() * ARM,
        Vector3::z() * ARM,
    ];
    let of_disc = |disc| arms.map(|place| DiscPoint { disc, place });
    (0..discs).flat_map(of_disc).collect()
}

impl Touch {
    /// Derivative of the distance by what moves the corners of the discs at `rates` (m), and takes the one robot's base to the other's
    /// in one `step`.
    pub fn growth(&self, rates: &[Vector3<f64>], step: f64, [here, changed]: [&Robot; 2]) -> f64 {
        let motion = match self.body {
            // A rigid body, taken linear: what each place moves by is linear in the place.
            Some(disc) => {
                let own = &rates[CORNERS * disc..][..CORNERS];
                let along = |axis: usize| (own[axis + 1] - own[0]) * (self.in_body[axis] / ARM);
                own[0] + along(0) + along(1) + along(2)
            }
            None => {
                let at = |robot: &Robot| base_pose(robot) * nalgebra::Point3::from(self.in_body);
                (at(changed) - at(here)) / step
            }
        };
        -self.normal.dot(&motion)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;
    use std::ops::ControlFlow;

    use nalgebra::DVector;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    use super::super::{
        Group, Order, Recording, RecordingSettings, Replay, Transmission, explicit, facts,
        fit_recording, problem, unknowns,
    };
    use super::*;
    use crate::robot::{Backbone, Drive, PerDisc, Pull};

    const NOISE: f64 = 3e-4;

    /// Two modules on an elastic backbone, whose tendons stretch.
    fn robot(stiffness: [f64; 2]) -> RobotSpec {
        let mut spec = RobotSpec::standard("2m").expect("a standard robot");
        for (module, stiffness) in spec.modules.iter_mut().zip(stiffness) {
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(stiffness)));
            if let Some(tendons) = &mut module.tendons {
                tendons.drive = Drive::Gain(2000.0);
                tendons.pull = Pull::Bilateral;
            }
        }
        spec
    }

    /// Rows at rest, in which `points` of the discs' rims and faces are seen, and sometimes a payload hangs from the tip.
    fn recording(spec: &RobotSpec, there: &Transmission, rows: usize, points: usize) -> Recording {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let normal = Normal::new(0.0, NOISE).expect("a deviation above 0");
        let mut recording = Recording {
            times: (0..rows).map(|row| row as f64).collect(),
            points: vec![Vec::new(); rows],
            payloads: (0..rows).map(|row| 0.01 * (row % 3) as f64).collect(),
            order: Order::AtRest,
            ..Recording::default()
        };
        for _ in 0..rows {
            // Each module bends some way, and all of its tendons pull.
            let ways = [(); 2].map(|()| (rng.random_range(0.0..0.01), rng.random_range(0.0..TAU)));
            let pull = |t: usize| {
                let (bend, way): (f64, f64) = ways[t / 3];
                0.003 + bend * (way + TAU / 3.0 * t as f64).sin()
            };
            recording.pulls.push((0..6).map(pull).collect());
        }
        let robot = Robot::new(super::super::without_ranges(spec).expect("a robot")).expect("one");
        let commands = there.commands(&robot, &recording);
        for (row, command) in commands.iter().enumerate() {
            let command = robot.command(command).expect("a command");
            let settled = robot.settle(&command, &recording.loads(row));
            assert!(settled.converged);
            let mut point = || {
                let disc = rng.random_range(0..robot.discs().len());
                let own = &robot.discs()[disc];
                let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
                let share: f64 = rng.random_range(-1.0..1.0);
                let (radius, height) = match rng.random::<bool>() {
                    true => (own.radius, own.half_height * share),
                    false => (own.radius * share, own.half_height),
                };
                let local = Vector3::new(radius * cos, radius * sin, height);
                let noise = Vector3::from_fn(|_, _| normal.sample(&mut rng));
                (disc_pose(&settled, disc) * nalgebra::Point3::from(local)).coords + noise
            };
            recording
                .clouds
                .push((0..points).map(|_| point()).collect());
        }
        recording
    }

    #[test]
    fn stiffness_and_pretension_are_found_from_clouds_alone() {
        let (first, real) = (robot([0.3, 0.3]), robot([0.36, 0.26]));
        let given = Transmission::ideal(6, Vec::new());
        let mut there = given.clone();
        for (servo, offset) in (there.servos.iter_mut()).zip([4e-4, -3e-4, 2e-4, 5e-4, 0.0, -2e-4])
        {
            servo.offset = offset;
        }
        let recording = recording(&real, &there, 40, 60);
        let settings = RecordingSettings {
            groups: vec![Group::Pretension, Group::Stiffness],
            ..RecordingSettings::default()
        };
        let fit = fit_recording(
            &first,
            &given,
            &recording,
            &settings,
            &mut |_| ControlFlow::Continue(()),
            &|| false,
        )
        .expect("a fit");
        let truth = there.servos.iter().map(|servo| servo.offset);
        let truth: Vec<f64> = truth.chain([0.36 / 0.3, 0.26 / 0.3]).collect();
        assert_eq!(fit.unknowns.len(), truth.len());
        for (unknown, truth) in fit.unknowns.iter().zip(truth) {
            let [low, high] = unknown.interval;
            assert!((low..=high).contains(&truth), "{unknown:?}, truth {truth}");
            let near = if unknown.group == Group::Stiffness {
                0.05
            } else {
                2.5e-4
            };
            assert!(
                (unknown.value - truth).abs() < near,
                "{unknown:?}, truth {truth}"
            );
        }
        // Along the normal the noise has one of its three coordinates.
        assert!(
            (fit.after.rmse / NOISE - 1.0).abs() < 0.1,
            "{}",
            fit.after.rmse
        );
        assert!(
            fit.before.rmse > 2.0 * fit.after.rmse,
            "{}",
            fit.before.rmse
        );
    }

    /// Derivatives against differences of the residuals, of every group that rows at rest tell of.
    #[test]
    fn derivatives_of_distances_are_those_of_the_residuals() {
        let (first, real) = (robot([0.3, 0.3]), robot([0.31, 0.29]));
        let there = Transmission::ideal(6, Vec::new());
        let mut recording = recording(&real, &there, 4, 30);
        recording.shown.rods = vec![Some(0.002); 10];
        let explicit = explicit::Explicit::new(&first).expect("a robot");
        let way = [Group::Backlash, Group::Lag, Group::Friction];
        let groups: Vec<Group> = (Group::ALL.into_iter())
            .filter(|group| !way.contains(group))
            .collect();
        let facts = facts::Facts {
            groups: &groups,
            explicit: &explicit,
            transmission: &there,
            recording: &recording,
        };
        let unknowns = unknowns::unknowns(&facts).expect("all groups");
        let problem = problem::Problem {
            explicit: &explicit,
            transmission: &there,
            recording: &recording,
            speeds: recording.speeds(),
            unknowns: &unknowns,
            loss: 2e-3,
            friction: false,
            stop: &|| false,
        };
        let weighing = problem::Weighing {
            rows: (0..4).collect(),
            error: 1e-3,
        };
        let x = DVector::from_fn(unknowns.len(), |i, _| 0.02 * (i as f64).sin());
        let at = |x: &DVector<f64>| {
            let found = problem.evaluate(x, &weighing, &vec![None; 4]);
            found.expect("settled")
        };
        let here = at(&x);
        let h = 1e-4;
        for i in 0..x.len() {
            let [mut low, mut high] = [x.clone(), x.clone()];
            (low[i], high[i]) = (x[i] - h, x[i] + h);
            let slope = (at(&high).residuals - at(&low).residuals) / (2.0 * h);
            let error = slope.clone() - here.jacobian.column(i);
            // A point may change from one face to the next within the step, where its distance has a kink.
            let far = 1e-2 * slope.amax().max(1e-6);
            let beyond = error.iter().filter(|error| error.abs() > far).count();
            assert!(beyond <= 2, "{}: {}", unknowns[i].sought.name, error.amax());
        }
    }

    #[test]
    fn what_rows_at_rest_do_not_tell_is_refused() {
        let first = robot([0.3, 0.3]);
        let there = Transmission::ideal(6, Vec::new());
        let mut recording = recording(&first, &there, 3, 8);
        let fit = |recording: &Recording, group| {
            let settings = RecordingSettings {
                groups: vec![group],
                ..RecordingSettings::default()
            };
            let watch = &mut |_| ControlFlow::Continue(());
            let refused = fit_recording(&first, &there, recording, &settings, watch, &|| false);
            refused.expect_err("refused").to_string()
        };
        for group in [Group::Lag, Group::Backlash, Group::Friction] {
            let refusal = fit(&recording, group);
            assert!(
                refusal.contains("each row is the robot at rest"),
                "{refusal}"
            );
        }
        recording.clouds[1][2].x = f64::NAN;
        let refusal = fit(&recording, Group::Stiffness);
        assert_eq!(refusal, "row 1 of the recording: a number is not finite");
        recording.clouds.pop();
        let refusal = fit(&recording, Group::Stiffness);
        assert_eq!(refusal, "rows of clouds: found 2, expected 3");
    }

    /// A base that cameras see explains the points on it.
    #[test]
    fn the_base_counts_where_clouds_show_it() {
        let spec = robot([0.3, 0.3]);
        let there = Transmission::ideal(6, Vec::new());
        let mut recording = recording(&spec, &there, 2, 20);
        let foot = Vector3::from(spec.base.position) - Vector3::z() * 0.05;
        recording.clouds[0].push(foot + Vector3::x() * 0.0121);
        let rmse = |recording: &Recording| {
            let replay = Replay::new(&spec, &there, recording).expect("a recording of it");
            replay.residuals(recording).rmse
        };
        let hidden = rmse(&recording);
        recording.shown = Shown::of(&spec, true);
        let shown = rmse(&recording);
        assert!(
            shown < 2.0 * NOISE && hidden > 5.0 * shown,
            "{hidden}, {shown}"
        );
    }
}
