//! The pose that a model starts in, and the time step that is stable about it.

use faer::Mat;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::joint::Freedom;
use super::options::{ExportOptions, Integrator};
use super::written_joint::WrittenJoint;
use crate::chain::Configuration;
use crate::contact::ContactSettler;
use crate::dynamics::{self, SmallMotions, State};
use crate::formats::ExportError;
use crate::robot::{Command, CommandUnit, Disc, Loads, Robot};

/// Name of the keyframe of a model: the robot settled under a command.
pub(super) const KEYFRAME: &str = "settled";

/// Time steps to choose from (s), where none is asked for: MuJoCo's own, and shorter ones.
const TIME_STEPS: [f64; 10] = [2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6];
/// How much longer a chosen step could be and yet be stable: the stiffness changes with the pose.
const MARGIN: f64 = 1.5;

/// The middle of every tendon's range, but for the first tendon of each group, which pulls by a tenth of
/// its range more. Under equal commands a robot stands straight or leans to any side, and rounding
/// decides to which.
fn leaning(robot: &Robot) -> Command {
    let mut values = robot.mean_command().as_slice().to_vec();
    for group in robot.spec().tendon_groups() {
        let first = group.tendons.start;
        let [low, high] = robot.tendons()[first].range;
        let pull = match group.unit {
            CommandUnit::Metre => low - high,
            CommandUnit::Newton => high - low,
        };
        values[first] += pull / 10.0;
    }
    robot
        .command(&values)
        .expect("a tenth of the range off its middle")
}

/// A robot at rest under a command.
pub(super) struct Start {
    pub command: Command,
    /// The settled pose; straight where the robot does not settle.
    configuration: Configuration,
    pub settled: bool,
    loads: Loads,
}

impl Start {
    /// The robot under the command of the options, or [`leaning`].
    pub fn of(robot: &Robot, options: &ExportOptions) -> Result<Self, ExportError> {
        let loads = Loads::default().with_payload(options.payload)?;
        let command = match &options.command {
            Some(values) => robot.command(values)?,
            None => leaning(robot),
        };
        let equilibrium = match options.scene.is_empty() {
            true => robot.settle(&command, &loads),
            false => {
                let mut settler = ContactSettler::new(robot, &options.scene);
                settler.settle(&command, &loads)?.equilibrium.clone()
            }
        };
        let settled = equilibrium.converged;
        if options.command.is_some() && !settled {
            let residual = equilibrium.residual;
            return Err(ExportError::NotSettled { residual });
        }
        let configuration = match settled {
            true => equilibrium.configuration,
            false => Configuration::straight(robot),
        };
        Ok(Self {
            command,
            configuration,
            settled,
            loads,
        })
    }

    /// MuJoCo's coordinates of the pose.
    pub fn coordinates(&self, robot: &Robot, joints: &[WrittenJoint]) -> Vec<f64> {
        let turns = robot.discs().iter().zip(&self.configuration.0);
        let turns = turns.zip(joints);
        turns
            .flat_map(|((disc, q), joint)| joint.coordinates(&from_rest(disc, q)))
            .collect()
    }

    /// The time step asked for, if it is stable about the pose; else the longest of the usual ones
    /// that is by a margin.
    pub fn timestep(
        &self,
        robot: &Robot,
        joints: &[WrittenJoint],
        options: &ExportOptions,
    ) -> Result<f64, ExportError> {
        let state = State::at_rest(self.configuration.clone());
        let motions = SmallMotions::about(robot, &state, &self.command, &self.loads)?;
        let motions = self.in_series(robot, joints, &motions);
        let scheme = options.integrator.scheme();
        let longest = |timestep| motions.longest_step(scheme, timestep);
        let unstable = |timestep| ExportError::Unstable {
            integrator: options.integrator.name(),
            timestep,
            longest: longest(timestep),
        };
        match options.timestep {
            Some(timestep) if !(timestep.is_finite() && timestep > 0.0) => {
                Err(dynamics::DynamicsError::Timestep(timestep).into())
            }
            Some(timestep) if !motions.is_stable(scheme, timestep) => Err(unstable(timestep)),
            Some(timestep) => Ok(timestep),
            None => (TIME_STEPS.into_iter())
                .find(|timestep| motions.is_stable(scheme, MARGIN * timestep))
                .ok_or_else(|| unstable(TIME_STEPS[TIME_STEPS.len() - 1])),
        }
    }

    /// Small motions of the joints as MuJoCo has them, from those of the joints here: each freedom turns
    /// its disc about an axis, and has a spring, damping and armature of its own.
    fn in_series(
        &self,
        robot: &Robot,
        joints: &[WrittenJoint],
        balls: &SmallMotions,
    ) -> SmallMotions {
        if joints.iter().all(WrittenJoint::is_as_here) {
            // What MuJoCo's joints have of the damping is alike about all axes.
            let mut balls = balls.clone();
            let damping = balls.damping.iter_mut().zip(&mut balls.explicit);
            damping.for_each(|(all, explicit)| *all -= std::mem::take(explicit));
            return balls;
        }
        let turns = robot.discs().iter().zip(&self.configuration.0);
        let freedoms: Vec<(usize, Freedom)> = (turns.zip(joints).enumerate())
            .flat_map(|(index, ((disc, q), joint))| {
                let freedoms = joint.freedoms(&from_rest(disc, q)).into_iter();
                freedoms.map(move |freedom| (index, freedom))
            })
            .collect();
        // `J' (A - B) J + C`, where the columns of `J` are the freedoms' axes, and `B` and `C` what the
        // balls alone and the freedoms have of their own.
        let spread =
            |matrix: &Mat<f64>, of_ball: fn(&Disc) -> Vector3<f64>, own: fn(&Freedom) -> f64| {
                Mat::from_fn(freedoms.len(), freedoms.len(), |row, column| {
                    let ((i, left), (j, right)) = (&freedoms[row], &freedoms[column]);
                    let mut block = Matrix3::from_fn(|r, c| matrix[(3 * i + r, 3 * j + c)]);
                    if i == j {
                        block -= Matrix3::from_diagonal(&of_ball(&robot.discs()[*i]));
                    }
                    let own = if row == column { own(left) } else { 0.0 };
                    left.axis.dot(&(block * right.axis)) + own
                })
            };
        let armature = |disc: &Disc| match disc.hinges {
            None => Vector3::repeat(disc.armature),
            Some(_) => Vector3::zeros(),
        };
        let spring = |disc: &Disc| disc.backbone.map_or(Vector3::zeros(), |b| b.stiffness());
        SmallMotions {
            mass: spread(&balls.mass, armature, |freedom| freedom.armature),
            damping: freedoms
                .iter()
                .map(|(_, freedom)| freedom.damping)
                .collect(),
            explicit: vec![0.0; freedoms.len()],
            stiffness: spread(&balls.stiffness, spring, |freedom| freedom.stiffness),
        }
    }
}

impl Integrator {
    /// What is stable where it is. MuJoCo's implicit integrators are implicit in velocities alone: at
    /// rest they are its Euler integrator, whose damping is implicit.
    fn scheme(self) -> dynamics::Integrator {
        match self {
            Self::Euler | Self::ImplicitFast | Self::Implicit => {
                dynamics::Integrator::SemiImplicitEuler
            }
            Self::RungeKutta4 => dynamics::Integrator::RungeKutta4,
        }
    }
}

/// Turn of a joint from its rest, which MuJoCo counts from.
fn from_rest(disc: &Disc, q: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let rest = disc.backbone.map_or(Vector3::zeros(), |b| b.rest.into());
    UnitQuaternion::from_scaled_axis(rest).inverse() * q
}
