//! Why a motion cannot be computed.

use thiserror::Error;

use super::integrator::{Integrator, LARGEST_TURN};
use crate::objects::ObjectError;
use crate::robot::{LoadsError, ParameterError, Robot};

/// Why a motion cannot be computed.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DynamicsError {
    /// A time step that is not a finite number above 0.
    #[error("the time step is {0} s; expected a finite number above 0")]
    Timestep(f64),
    /// A joint that has nothing to accelerate.
    #[error(
        "joint {joint} has no armature and its disc no moment of inertia about some axis; expected \
         one or the other"
    )]
    NoInertia {
        /// The joint, from 0 at the base.
        joint: usize,
    },
    /// A tendon whose length is imposed, where that cannot be held.
    #[error(
        "tendon {} is inextensible and its length is commanded, which only steps by {:?} and {:?} hold, not under MuJoCo's law of \
         contacts and without derivatives; give it an `axial_stiffness`, or a drive with a gain",
        tendon + 1,
        Integrator::SemiImplicitEuler,
        Integrator::ImplicitEuler
    )]
    Inextensible {
        /// The tendon, from 0.
        tendon: usize,
    },
    /// A fluid around the robot, where its drag is not known.
    #[error(
        "the robot moves in a fluid, whose drag only steps by {:?} and {:?} have, not under MuJoCo's law of contacts; leave \
         out its `fluid`",
        Integrator::SemiImplicitEuler,
        Integrator::ImplicitEuler
    )]
    InFluid,
    /// Friction of a tendon in its holes, where steps do not have it.
    #[error(
        "tendon {} has friction in its holes, which only steps by {:?} and {:?} have, without inextensible tendons whose length is commanded, and \
         not under MuJoCo's law of contacts; leave out its `friction`",
        tendon + 1,
        Integrator::SemiImplicitEuler,
        Integrator::ImplicitEuler
    )]
    TendonFriction {
        /// The tendon, from 0.
        tendon: usize,
    },
    /// A robot with friction of tendons one of which goes another way than up the discs.
    #[error(
        "a tendon passes some discs by or turns back, and tendon {} has friction in its holes: in motion friction needs tendons that go \
         through a hole of each disc on their way up; leave out its `friction`, or let the tendons go through all discs",
        tendon + 1
    )]
    FrictionRoute {
        /// The tendon with friction, from 0.
        tendon: usize,
    },
    /// Deflections that cannot be those of a robot's contacts.
    #[error(
        "deflections in the tendons' holes are not finite, or not one for each interior hole of each tendon"
    )]
    Deflections,
    /// A servo that takes time to follow its commands, where derivatives of a single step are asked for.
    #[error(
        "the servo of tendon {} follows its commands late, and single steps have derivatives only by the command that acts; \
         take the gradient of a motion, or leave out its `lag` and `rate`",
        tendon + 1
    )]
    LateServo {
        /// The tendon, from 0.
        tendon: usize,
    },
    /// Motions that have no derivatives here.
    #[error("{what} have no derivatives; expected {expected}")]
    Underivable {
        /// What they are.
        what: &'static str,
        /// What has derivatives.
        expected: &'static str,
    },
    /// A state, command or gradient made for another robot.
    #[error("the {what} has {found} entries; robot `{robot}` needs {expected}")]
    Size {
        /// What does not fit.
        what: &'static str,
        /// Name of the robot.
        robot: String,
        /// Entries that fit.
        expected: usize,
        /// Entries found.
        found: usize,
    },
    /// A load that does not fit the robot.
    #[error(transparent)]
    Load(#[from] LoadsError),
    /// A parameter that the robot does not have.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// A motion that the time step does not resolve: it is of the integration, not of the robot.
    #[error(
        "the motion diverged: joint {joint} turns by {turn:.3e} rad in one step of {timestep} s, more than the \
         {} rad that a step resolves; take a shorter time step{}",
        LARGEST_TURN,
        if .integrator.is_implicit() { "" } else { ", or an implicit integrator" }
    )]
    Diverged {
        /// The joint that turns most, from 0 at the base.
        joint: usize,
        /// By how much it turns in the step (rad); not finite where the numbers have left their range.
        turn: f64,
        /// The time step (s).
        timestep: f64,
        /// How the step was taken.
        integrator: Integrator,
    },
    /// A state in which a joint of hinges has a rotation that no angles of theirs give.
    #[error(
        "joint {joint} is turned by {off:.1e} rad from what its hinges can; expected rotations about their axes"
    )]
    NotOfHinges {
        /// The joint, from 0 at the base.
        joint: usize,
        /// How far its rotation is from one that they can have (rad).
        off: f64,
    },
    /// A joint of hinges that was turned to where they have no angles.
    #[error(
        "the hinges of joint {joint} turn beyond {angles:.3?} rad into gimbal lock, or one of them beyond half a turn: motions here \
         end there; expected three hinges about axes that stay apart, or a ball joint in their place"
    )]
    HingesOutOfReach {
        /// The joint, from 0 at the base.
        joint: usize,
        /// Its hinges' angles before the step (rad).
        angles: Vec<f64>,
    },
    /// An implicit step whose equations were not solved.
    #[error(
        "the implicit step of {timestep} s could not be solved, nor in halves down to {smallest:.1e} s; take a shorter \
         time step"
    )]
    NotSolved {
        /// The time step (s).
        timestep: f64,
        /// The shortest part of it that was tried (s).
        smallest: f64,
    },
    /// Contacts whose friction was not found.
    #[error(
        "friction of contacts was not found in the step of {timestep} s: what it may bear is off by {off:.1e} of the largest; take a \
         shorter time step, or smaller coefficients of friction"
    )]
    FrictionNotFound {
        /// By how much bounds of friction differ from the normal impulses times the coefficient, for the largest of them.
        off: f64,
        /// The time step (s).
        timestep: f64,
    },
    /// A time step by which even small motions about a pose grow without bound.
    #[error(
        "steps of {timestep} s are unstable: small motions about the robot's pose grow unless they are below \
         {longest:.2e} s; take a shorter time step, or an implicit integrator"
    )]
    Unstable {
        /// The time step (s).
        timestep: f64,
        /// The longest that is stable (s).
        longest: f64,
    },
    /// An integrator whose steps do not take contacts.
    #[error(
        "{integrator:?} steps take no contacts; among obstacles expected {:?} or {:?}",
        Integrator::SemiImplicitEuler,
        Integrator::ImplicitEuler
    )]
    NotAmongObstacles {
        /// The integrator.
        integrator: Integrator,
    },
    /// Objects of the scene that cannot move.
    #[error(transparent)]
    Objects(#[from] ObjectError),
    /// A state from which a step has no finite derivative.
    #[error(
        "the step from this state has no finite derivative: the joints' accelerations, or the inverse of \
         the mass matrix, are not finite numbers; expected a state of a motion that did not diverge"
    )]
    NotDifferentiable,
}

impl DynamicsError {
    /// [`DynamicsError::Size`] where there are not as many entries found as expected.
    pub(crate) fn check_size(
        robot: &Robot,
        what: &'static str,
        [expected, found]: [usize; 2],
    ) -> Result<(), Self> {
        match expected == found {
            true => Ok(()),
            false => Err(Self::Size {
                what,
                robot: robot.spec().name.clone(),
                expected,
                found,
            }),
        }
    }
}
