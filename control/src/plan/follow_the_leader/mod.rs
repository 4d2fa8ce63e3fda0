//! Follow the leader: a robot is deployed along a curve so that its body stays on the curve that its tip has gone.
//!
//! The base moves, on a carriage along the curve's first direction or freely as a manipulator carries it, and all tendons are commanded.
//! The robot is first laid on the whole curve, which is bent from a straight line step by step, and then drawn back stage by stage: what it does
//! in reverse order is the deployment. At each stage the discs that have passed the curve's start lie on it in the sense of least squares, with gravity and
//! everything else that the robot's equilibrium has; those that have not are where they need not change. In a scene the robot may touch
//! obstacles on the way: what it then presses them with is part of its equilibrium, and of the derivatives that lay it on the curve.

mod curve;
mod fit;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::Contact;
use tdcr_sim::curve::BackboneCurve;
use tdcr_sim::robot::{Command, Drive, Loads, LoadsError, Robot, Tendon};
use tdcr_sim::scene::Scene;
use thiserror::Error;

use curve::Curve;
use fit::{Fitter, Posed};

/// In how many parts the curve is bent from a straight line.
const BENDS: usize = 12;
/// Commands drawn at random to start from.
const DRAWS: usize = 20;
/// Points of the robot that its deviation is the mean over.
const POINTS: usize = 50;

/// How a robot's base moves while it is deployed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BaseMotion {
    /// In any way, as a manipulator carries it: the tip is then exactly on the curve, unless an obstacle is there.
    Free,
    /// Along the direction in which the curve begins, as on a carriage.
    Carriage,
}

/// A deployment along a curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Deployment {
    /// From the tip at the curve's start to the tip at its end.
    pub stages: Vec<DeploymentStage>,
    /// Mean over the stages of their deviation (m).
    pub mean_deviation: f64,
    /// The largest of them (m).
    pub largest_deviation: f64,
}

/// A stage of it.
#[derive(Clone, Debug, PartialEq)]
pub struct DeploymentStage {
    /// Arc length of the curve at the tip (m).
    pub arc_length: f64,
    /// The command (m, or N for a tension drive).
    pub command: Command,
    /// The base's pose in the world (m).
    pub base: Isometry3<f64>,
    /// Origins of the discs, world frame (m).
    pub positions: Vec<Vector3<f64>>,
    /// Mean distance from the curve up to the tip's place, over the part of the robot that is as far from the tip at most (m).
    pub deviation: f64,
    /// Distance of the tip from its place (m).
    pub tip_error: f64,
    /// What the robot touches.
    pub contacts: Vec<Contact>,
}

impl DeploymentStage {
    /// Sum of the forces of all contacts (N).
    pub fn contact_force(&self) -> f64 {
        self.contacts.iter().map(|one| one.force.norm()).sum()
    }
}

/// Why there is no deployment.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DeploymentError {
    /// A curve of fewer than two different points, or with points that are not finite.
    #[error("the curve has {0} points that differ; expected 2 at least, of finite numbers")]
    Curve(usize),
    /// A curve that is longer than the robot.
    #[error(
        "the curve is {found:.4} m long; expected {length:.4} m at most, the length of robot `{robot}`"
    )]
    TooLong {
        /// Its length (m).
        found: f64,
        /// The robot's (m).
        length: f64,
        /// Name of the robot.
        robot: String,
    },
    /// Too few stages, or too many.
    #[error("a deployment of {0} stages; expected 2 to 10000000")]
    Stages(usize),
    /// Loads of another robot.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// The robot does not settle on the way.
    #[error("the robot does not settle with its tip {arc_length:.4} m along the curve")]
    Unsettled {
        /// Where (m).
        arc_length: f64,
    },
    /// It was asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Stages that nobody means to ask for: their poses would fill the memory.
const MOST_STAGES: usize = 10_000_000;

/// What a deployment goes through.
#[derive(Clone, Copy, Debug)]
pub struct DeploymentTask<'a> {
    /// The robot. Where its base is in its file does not matter; its size, its masses and gravity do.
    pub robot: &'a Robot,
    /// Obstacles, which it may touch.
    pub scene: &'a Scene,
    /// What pulls at it.
    pub loads: &'a Loads,
    /// Points of the curve, world frame (m).
    pub points: &'a [Vector3<f64>],
    /// How its base moves.
    pub motion: BaseMotion,
    /// Stages of equal length, 2 to ten million.
    pub stages: usize,
}

/// Deploys a robot along the curve through points in the world (m), in stages of equal length.
///
/// Where the robot's base is in its file does not matter; its size, its masses and gravity do.
///
/// # Errors
/// [`DeploymentError`] for a curve that is none or longer than the robot, fewer than 2 stages, loads of another robot, and a robot
/// that does not settle.
///
/// ```
/// use nalgebra::Vector3;
/// use tdcr_control::plan::follow_the_leader::{BaseMotion, deploy};
/// use tdcr_sim::robot::{Loads, Robot};
///
/// let robot = Robot::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/three-segments.toml"))?;
/// // An arc of 0.16 m that bends by 0.8 rad.
/// let at = |k: i32| {
///     let angle = 0.8 * f64::from(k) / 40.0;
///     Vector3::new(0.2 * (1.0 - angle.cos()), 0.0, 0.2 * angle.sin())
/// };
/// let curve: Vec<_> = (0..=40).map(at).collect();
/// let deployment = deploy(&robot, &Loads::default(), &curve, BaseMotion::Free, 10)?;
/// assert!(deployment.mean_deviation < 0.01 * 0.16);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn deploy(
    robot: &Robot,
    loads: &Loads,
    points: &[Vector3<f64>],
    motion: BaseMotion,
    stages: usize,
) -> Result<Deployment, DeploymentError> {
    let task = DeploymentTask {
        robot,
        scene: &Scene::default(),
        loads,
        points,
        motion,
        stages,
    };
    deploy_while(&task, |_, _| true)
}

/// The same of a robot among obstacles, as long as `go_on` says so, which is told after each step how many there were, and how many there
/// are to be.
///
/// The robot is laid on the whole curve first: what is in its way there, or beside the curve's beginning, bends it.
///
/// # Errors
/// As [`deploy`]; [`DeploymentError::Interrupted`] after it was told to stop.
pub fn deploy_while(
    task: &DeploymentTask,
    mut go_on: impl FnMut(usize, usize) -> bool,
) -> Result<Deployment, DeploymentError> {
    let DeploymentTask {
        robot,
        scene,
        loads,
        points,
        motion,
        stages,
    } = *task;
    loads.check(robot)?;
    let finite = points.iter().flatten().all(|x| x.is_finite());
    let curve = Curve::new(points.iter().copied()).filter(|_| finite);
    let curve = curve.ok_or(DeploymentError::Curve(points.len()))?;
    if !(2..=MOST_STAGES).contains(&stages) {
        return Err(DeploymentError::Stages(stages));
    }
    let fitter = Fitter::new(robot, scene, loads, motion);
    let length = fitter.length();
    // Rounding of a curve that is as long as the robot.
    if curve.length() > length * (1.0 + 1e-9) {
        return Err(DeploymentError::TooLong {
            found: curve.length(),
            length,
            robot: robot.spec().name.clone(),
        });
    }
    let (steps, mut done) = (BENDS + 1 + stages, 0);
    let mut step = || {
        done += 1;
        match go_on(done, steps) {
            true => Ok(()),
            false => Err(DeploymentError::Interrupted),
        }
    };
    let mut posed = lay_on_whole(&fitter, robot, &curve, &mut step)?;
    let mut found = Vec::new();
    for stage in (0..stages).rev() {
        let arc_length = curve.length() * stage as f64 / (stages - 1) as f64;
        posed = drawn_back(&fitter, &posed, &curve, arc_length)
            .ok_or(DeploymentError::Unsettled { arc_length })?;
        found.push(at_stage(robot, &posed, &curve, arc_length));
        step()?;
    }
    found.reverse();
    let deviations = || found.iter().map(|stage| stage.deviation);
    Ok(Deployment {
        mean_deviation: deviations().sum::<f64>() / stages as f64,
        largest_deviation: deviations().fold(0.0, f64::max),
        stages: found,
    })
}

/// The robot with its tip at the end of the curve, and what is before it straight behind the curve's start.
fn lay_on_whole(
    fitter: &Fitter,
    robot: &Robot,
    curve: &Curve,
    step: &mut impl FnMut() -> Result<(), DeploymentError>,
) -> Result<Posed, DeploymentError> {
    let length = fitter.length();
    let unsettled = DeploymentError::Unsettled {
        arc_length: curve.length(),
    };
    let whole = curve.lengthened(length - curve.length());
    let along = whole.start_direction();
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &along).unwrap_or_else(|| {
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
    });
    let base = Isometry3::from_parts(Translation3::from(whole.at(0.0)), turn);
    let mut settled = starts(robot).filter_map(|command| fitter.settle(&command, base, None));
    let mut posed = settled.next().ok_or(unsettled.clone())?;
    for part in 0..=BENDS {
        let bent = whole.bent(part as f64 / BENDS as f64);
        posed = fitter
            .lay(&posed, &bent, [bent.length(), length])
            .ok_or(unsettled.clone())?;
        step()?;
    }
    Ok(posed)
}

/// Commands to start from: tensions of a tenth of their range, others in the middle of theirs, and where the robot does not settle
/// so, others drawn at random.
fn starts(robot: &Robot) -> impl Iterator<Item = Command> {
    let share = |tendon: &Tendon| match tendon.drive {
        Drive::Tension => 0.1,
        _ => 0.5,
    };
    let values: Vec<f64> = (robot.tendons().iter())
        .map(|tendon| tendon.range[0] + share(tendon) * (tendon.range[1] - tendon.range[0]))
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let others = (0..DRAWS).map(move |_| robot.random_command(&mut rng));
    robot.command(&values).into_iter().chain(others)
}

/// The robot with its tip at an arc length of the curve, from where it was farther.
fn drawn_back(fitter: &Fitter, posed: &Posed, curve: &Curve, arc_length: f64) -> Option<Posed> {
    fitter.lay(posed, curve, [arc_length, arc_length])
}

fn at_stage(robot: &Robot, posed: &Posed, curve: &Curve, arc_length: f64) -> DeploymentStage {
    let positions = posed.equilibrium.positions.clone();
    let tip_error = (positions[positions.len() - 1] - curve.at(arc_length)).norm();
    DeploymentStage {
        arc_length,
        command: posed.command.clone(),
        base: posed.base,
        deviation: deviation(robot, posed, curve, arc_length),
        positions,
        tip_error,
        contacts: posed.contacts.clone(),
    }
}

/// Mean distance from the curve of the part of the robot that is as far from the tip at most as the tip is along the curve (m).
fn deviation(robot: &Robot, posed: &Posed, curve: &Curve, arc_length: f64) -> f64 {
    let backbone = BackboneCurve::new(&posed.at_base(robot), &posed.equilibrium.pose());
    let length = backbone.length();
    let distance = |k: usize| {
        let from_tip = arc_length * k as f64 / (POINTS - 1) as f64;
        let frame = backbone.at((length - from_tip).max(0.0))?;
        let place = frame.translation.vector;
        Some((place - curve.nearest(&place, arc_length).0).norm())
    };
    let distances: Vec<f64> = (0..POINTS).filter_map(distance).collect();
    distances.iter().sum::<f64>() / distances.len().max(1) as f64
}
