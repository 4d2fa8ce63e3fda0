//! From state and command to accelerations.

use nalgebra::{Matrix3, Vector3};

use super::articulated::ArticulatedBodies;
use super::forces::Forces;
use super::links::{Link, Motion, MovingChain, PointMass, set_in_motion};
use super::reaction::Reaction;
use super::symmetric::transpose_times;
use super::{DynamicsError, Energy, State};
use crate::chain::{Chain, Configuration};
use crate::robot::{Command, Loads, Robot};
use crate::tendon::Posture;

/// How far a rotation may be from one that hinges can have (rad): far above rounding, as in files.
const MOST_OFF: f64 = 1e-6;

/// The equations of motion of one robot; reuses its memory.
#[derive(Clone, Debug)]
pub(super) struct EquationsOfMotion {
    pub robot: Robot,
    pub links: Vec<Link>,
    pub payload: PointMass,
    pub forces: Forces,
    pub posture: Posture,
    pub motions: Vec<Motion>,
    /// The same of the chain at rest.
    still: Vec<Motion>,
    /// Torque on every joint but that of its armature (N m), world axes.
    torques: Vec<Vector3<f64>>,
    bodies: ArticulatedBodies,
    /// Acceleration of every joint (rad/s²), world axes.
    accelerations: Vec<Vector3<f64>>,
    /// Force that accelerates every disc (N).
    body_forces: Vec<Vector3<f64>>,
}

impl EquationsOfMotion {
    /// The equations of `robot`, whose joints have `armatures` ([`Link::armatures`]), implicit damping included.
    pub fn new(robot: &Robot, armatures: &[Vector3<f64>]) -> Result<Self, DynamicsError> {
        if let Some(tendon) = robot.tendons().iter().position(|t| t.holds_length()) {
            return Err(DynamicsError::Inextensible { tendon });
        }
        let links = Link::all(robot);
        let inert =
            |(armature, link): (&Vector3<f64>, &Link)| link.has_axis_without_inertia(armature);
        if let Some(joint) = armatures.iter().zip(&links).position(inert) {
            return Err(DynamicsError::NoInertia { joint });
        }
        let n = links.len();
        Ok(Self {
            robot: robot.clone(),
            links,
            payload: PointMass::payload(robot, &Loads::default()),
            forces: Forces::new(robot),
            posture: Posture::new(robot),
            motions: vec![Motion::default(); n],
            still: vec![Motion::default(); n],
            torques: vec![Vector3::zeros(); n],
            bodies: ArticulatedBodies::new(n),
            accelerations: vec![Vector3::zeros(); n],
            body_forces: vec![Vector3::zeros(); n],
        })
    }

    /// Takes the loads, if state, command and loads are of this robot.
    pub fn accept(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        let dof = self.robot.dof();
        self.check_size("configuration", state.configuration.0.len(), dof / 3)?;
        self.check_size("velocity", state.velocity.len(), dof)?;
        self.check_size(
            "command",
            command.as_slice().len(),
            self.robot.tendons().len(),
        )?;
        self.check_hinges(&state.configuration)?;
        loads.check(&self.robot)?;
        self.payload = PointMass::payload(&self.robot, loads);
        self.forces.set_loads(loads);
        Ok(())
    }

    fn check_hinges(&self, q: &Configuration) -> Result<(), DynamicsError> {
        for (joint, (link, q)) in self.links.iter().zip(&q.0).enumerate() {
            let Some(hinges) = &link.hinges else { continue };
            let off = hinges.rotation(&hinges.angles(q)).angle_to(q);
            if off > MOST_OFF {
                return Err(DynamicsError::NotOfHinges { joint, off });
            }
        }
        Ok(())
    }

    fn check_size(
        &self,
        what: &'static str,
        found: usize,
        expected: usize,
    ) -> Result<(), DynamicsError> {
        DynamicsError::check_size(&self.robot, what, [expected, found])
    }

    /// Orientations of the discs at the last state.
    pub fn orientations(&self) -> &[Matrix3<f64>] {
        &self.posture.chain.orientations[1..]
    }

    /// Computes postures, motions, and the torques of a state, those of damping included.
    pub fn enter(&mut self, q: &Configuration, velocity: &[f64], command: &[f64]) {
        self.posture.place(&self.robot, q);
        set_in_motion(
            &self.links,
            &self.posture.chain,
            velocity,
            &mut self.motions,
        );
        self.forces
            .torques(q, &self.posture, command, &mut self.torques);
        let moving = self.links.iter().zip(&self.motions);
        let chain = &self.posture.chain;
        for (joint, (torque, (link, motion))) in self.torques.iter_mut().zip(moving).enumerate() {
            if let Some(hinges) = &link.hinges {
                let rates = Vector3::from_column_slice(&velocity[3 * joint..3 * joint + 3]);
                *torque -= chain.dual(joint) * hinges.damping.component_mul(&rates);
                continue;
            }
            let orientation = chain.disc(joint);
            *torque -= motion.rate * link.damping;
            if link.extra_damping != Vector3::zeros() {
                let rate = transpose_times(orientation, &motion.rate);
                *torque -= orientation * link.extra_damping.component_mul(&rate);
            }
        }
    }

    /// Leaves out the torques of the state last entered, so that [`EquationsOfMotion::residual`] is `M a + bias` alone.
    pub fn release(&mut self) {
        self.torques.fill(Vector3::zeros());
    }

    /// Writes the accelerations of the joints' coordinates in a state (rad/s²) to `out`; `armatures`
    /// may hold implicit damping besides.
    pub fn accelerate(
        &mut self,
        q: &Configuration,
        velocity: &[f64],
        command: &[f64],
        armatures: &[Vector3<f64>],
        out: &mut [f64],
    ) {
        self.enter(q, velocity, command);
        let orientations = &self.posture.chain.orientations[1..];
        let chain = MovingChain {
            links: &self.links,
            payload: &self.payload,
            orientations,
            motions: &self.motions,
            hinges: &self.posture.chain.hinges,
        };
        let accelerations = &mut self.accelerations;
        (self.bodies).accelerate(&chain, armatures, &self.torques, accelerations);
        to_coordinates(&self.posture.chain, &self.accelerations, out);
    }

    /// Writes `(M + forms)^-1 torques` to `out`, in the posture and with the payload of the last state: `torques` (N m) and `out`
    /// in world axes, `armatures` part of the mass matrix `M`, and `forms` what the surroundings do to each disc; an empty list is
    /// nothing. O(n) time.
    pub fn solve_among(
        &mut self,
        armatures: &[Vector3<f64>],
        torques: &[Vector3<f64>],
        forms: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        // What torques do to a chain at rest.
        let still = |motion: &Motion| Motion {
            arm: motion.arm,
            ..Motion::default()
        };
        let motions: Vec<Motion> = self.motions.iter().map(still).collect();
        let chain = MovingChain {
            links: &self.links,
            payload: &self.payload,
            orientations: &self.posture.chain.orientations[1..],
            motions: &motions,
            hinges: &self.posture.chain.hinges,
        };
        (self.bodies).react::<false>(&chain, armatures, torques, forms, out);
    }

    /// Writes the change of the joints' rates by `reactions` (rad/s, world axes), in the posture and with the payload of the last
    /// state: the solution `w` of `(M + forms) w = impulses`, `armatures` part of the mass matrix `M`. O(n) time. What is kept (`KEEPS`)
    /// serves [`respond_again`](Self::respond_again).
    pub fn respond<const KEEPS: bool>(
        &mut self,
        armatures: &[Vector3<f64>],
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        let still = self.still.iter_mut().zip(&self.motions);
        still.for_each(|(still, motion)| still.arm = motion.arm);
        let chain = MovingChain {
            links: &self.links,
            payload: &self.payload,
            orientations: &self.posture.chain.orientations[1..],
            motions: &self.still,
            hinges: &self.posture.chain.hinges,
        };
        // The last state's torques have been used: the chain is at rest but for the impulses.
        self.torques.fill(Vector3::zeros());
        (self.bodies).react::<KEEPS>(&chain, armatures, &self.torques, reactions, out);
    }

    /// The same of the impulses of other `reactions`, with the forms of those before.
    pub fn respond_again(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        self.bodies.react_again(&self.still, reactions, out);
    }

    /// Writes `M a + bias - tau` in the state last entered (N m), armatures in `M` and damping in `tau`, for the joints'
    /// `accelerations` (rad/s²); world axes. The recursion of Newton and Euler (Featherstone, Rigid Body Dynamics
    /// Algorithms, ch. 5.3) about the joints' centres, in O(n).
    pub fn residual(&mut self, accelerations: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        let orientations = &self.posture.chain.orientations[1..];
        let last = self.links.len() - 1;
        // From the base to the tip: the force on each disc, and its moment about the joint.
        let (mut angular, mut linear) = (Vector3::zeros(), Vector3::zeros());
        let bodies = self.links.iter().zip(&self.motions).zip(orientations);
        let results = out.iter_mut().zip(&mut self.body_forces);
        for (k, (((link, motion), orientation), (moment, force))) in bodies.zip(results).enumerate()
        {
            linear += angular.cross(&motion.arm) + motion.linear_bias;
            angular += motion.angular_bias + accelerations[k];
            let mut body = link.body(orientation);
            if k == last {
                body = body.with(&self.payload.body(orientation));
            }
            let spin = &motion.spin;
            *force = linear * body.mass
                + angular.cross(&body.moment)
                + spin.cross(&spin.cross(&body.moment));
            *moment = body.inertia.times(&angular)
                + body.moment.cross(&linear)
                + spin.cross(&body.inertia.times(spin));
        }
        // From the tip to the base: the moment of everything above each joint.
        let (mut moment, mut force) = (Vector3::zeros(), Vector3::zeros());
        let mut arm = Vector3::zeros();
        for (k, out) in out.iter_mut().enumerate().rev() {
            moment += arm.cross(&force) + *out;
            force += self.body_forces[k];
            arm = self.motions[k].arm;
            *out = match (&self.links[k].hinges, self.posture.chain.hinges(k)) {
                (Some(hinges), Some(axes)) => {
                    let own = axes.dual.tr_mul(&accelerations[k]);
                    moment + axes.dual * hinges.armature.component_mul(&own) - self.torques[k]
                }
                _ => moment + accelerations[k] * self.links[k].armature - self.torques[k],
            };
        }
    }

    /// Energy in a state.
    pub fn energy(&mut self, state: &State, command: &[f64]) -> Energy {
        self.enter(&state.configuration, &state.velocity, command);
        let mut kinetic = 0.0;
        let (mut spin_below, mut velocity) = (Vector3::zeros(), Vector3::zeros());
        let last = self.links.len() - 1;
        // 1/2 m v² + m v . (w x c) + 1/2 w' I w of each disc about its joint's centre, and the armature's energy.
        for (i, (link, motion)) in self.links.iter().zip(&self.motions).enumerate() {
            velocity += spin_below.cross(&motion.arm);
            let mut body = link.body(&self.orientations()[i]);
            if i == last {
                body = body.with(&self.payload.body(&self.orientations()[i]));
            }
            let spin = &motion.spin;
            let rates = Vector3::from_column_slice(&state.velocity[3 * i..3 * i + 3]);
            let armature = match &link.hinges {
                None => 0.5 * link.armature * motion.rate.norm_squared(),
                Some(hinges) => 0.5 * rates.dot(&hinges.armature.component_mul(&rates)),
            };
            kinetic += 0.5 * body.mass * velocity.norm_squared()
                + velocity.dot(&spin.cross(&body.moment))
                + 0.5 * spin.dot(&body.inertia.times(spin))
                + armature;
            spin_below = *spin;
        }
        let potential = self.forces.potential(command);
        Energy {
            kinetic,
            potential: potential.energy(&state.configuration, &self.posture),
        }
    }
}

/// Turns, rates or accelerations of the joints, world axes, by the joints' coordinates.
pub(super) fn to_coordinates(chain: &Chain, world: &[Vector3<f64>], out: &mut [f64]) {
    let joints = out.as_chunks_mut::<3>().0.iter_mut().zip(world);
    for (joint, (out, world)) in joints.enumerate() {
        *out = transpose_times(chain.dual(joint), world).into();
    }
}
