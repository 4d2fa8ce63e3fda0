//! The world of objects, which rapier moves.

use std::fmt;

use nalgebra::{Isometry3, Matrix3, Vector3};
use rapier3d_f64::prelude::{
    BroadPhaseBvh, CCDSolver, CoefficientCombineRule, ColliderHandle, ColliderSet, FrictionModel,
    ImpulseJointSet, IntegrationParameters, IslandManager, MultibodyJointSet, NarrowPhase,
    PhysicsPipeline, Real, RigidBodyBuilder, RigidBodyHandle, RigidBodySet, SoftBodySet,
    SpringCoefficients, Vector,
};

use super::joints::{damping, motions, stops, to_world};
use super::shapes::{back, fixed, movable, pose, pose_back, vector};
use super::{Body, Meeting, ObjectError, ObjectState, Twist};
use crate::scene::{JointSpec, Scene};

/// Length of the things that continuum robots move (m): rapier's margins are shares of it (2 % for contacts ahead of touching).
const LENGTH_UNIT: f64 = 0.1;
/// Sweeps over the contacts in a step. There are no substeps: what falls in all of a step must be held in all of it, or friction, which
/// is bounded by what holds, would act in the first of them alone.
const SWEEPS: usize = 8;
/// Natural frequency of contacts by that of steps: things sink in by a millionth of a metre under their weight in steps of 2 ms.
const STIFFNESS: f64 = 1.0;
/// Damping ratio of contacts: rapier's own, 10, lets them bear a weight only after a dozen milliseconds.
const DAMPING: f64 = 1.0;

/// Speed (m/s, rad/s) below which objects are at rest, and the number of such steps after which they stay so until something touches
/// them. One at the top of its flight is as slow in a single step.
const STILL: f64 = 1e-12;
const STILL_STEPS: usize = 4;

/// The objects of a scene, and what is fixed in it.
pub(crate) struct World {
    bodies: Vec<Body>,
    states: Vec<ObjectState>,
    kept: Vec<Kept>,
    gravity: Vector3<f64>,
    sets: Sets,
    parameters: IntegrationParameters,
    pipeline: PhysicsPipeline,
    /// In how many steps no object has moved.
    still: usize,
}

/// What of an object does not change.
#[derive(Clone, Debug)]
struct Kept {
    handle: RigidBodyHandle,
    name: String,
    /// Centre of mass (m) and inertia about it (kg m²), in the object's frame.
    centre: Vector3<f64>,
    inertia: Matrix3<f64>,
    joint: Option<JointSpec>,
    /// Pose in which the joint's position is 0.
    start: Isometry3<f64>,
}

/// What rapier keeps from step to step.
#[derive(Clone, Default)]
struct Sets {
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    narrow_phase: NarrowPhase,
    bodies: RigidBodySet,
    colliders: ColliderSet,
    impulse_joints: ImpulseJointSet,
    multibody_joints: MultibodyJointSet,
    soft_bodies: SoftBodySet,
    ccd: CCDSolver,
}

impl Clone for World {
    fn clone(&self) -> Self {
        Self {
            bodies: self.bodies.clone(),
            states: self.states.clone(),
            kept: self.kept.clone(),
            gravity: self.gravity,
            sets: self.sets.clone(),
            parameters: self.parameters,
            // A workspace.
            pipeline: PhysicsPipeline::new(),
            still: self.still,
        }
    }
}

impl fmt::Debug for World {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (f.debug_struct("World").field("states", &self.states)).finish_non_exhaustive()
    }
}

impl World {
    /// The world of a scene's objects under `gravity` (m/s²), moved in steps of `timestep` (s); `None` where there are none.
    pub fn new(
        scene: &Scene,
        gravity: Vector3<f64>,
        timestep: f64,
    ) -> Result<Option<Self>, ObjectError> {
        if scene.objects().next().is_none() {
            return Ok(None);
        }
        let mut world = Self {
            bodies: Vec::new(),
            states: Vec::new(),
            kept: Vec::new(),
            gravity,
            sets: Sets::default(),
            parameters: parameters(timestep),
            pipeline: PhysicsPipeline::new(),
            still: 0,
        };
        world.add_fixed(scene);
        world.add_objects(scene)?;
        world.measure();
        Ok(Some(world))
    }

    fn add_fixed(&mut self, scene: &Scene) {
        for obstacle in scene.obstacles().iter().filter(|one| one.mass.is_none()) {
            let mut collider = fixed(obstacle)
                .friction(obstacle.friction)
                .friction_combine_rule(CoefficientCombineRule::Max)
                .build();
            let placed = pose(&obstacle.pose) * *collider.position();
            collider.set_position(placed);
            self.sets.colliders.insert(collider);
        }
    }

    fn add_objects(&mut self, scene: &Scene) -> Result<(), ObjectError> {
        let sets = &mut self.sets;
        let mut ground = None;
        for (number, object) in scene.objects() {
            let mass = object.mass.unwrap_or_default();
            let collider = movable(object)?
                .mass(mass)
                .friction(object.friction)
                .friction_combine_rule(CoefficientCombineRule::Max);
            let body = RigidBodyBuilder::dynamic()
                .pose(pose(&object.pose))
                .can_sleep(false)
                .gyroscopic_forces_enabled(true);
            let handle = sets.bodies.insert(body);
            (sets.colliders).insert_with_parent(collider, handle, &mut sets.bodies);
            if let Some(joint) = &object.joint {
                let ground =
                    *ground.get_or_insert_with(|| sets.bodies.insert(RigidBodyBuilder::fixed()));
                let joint = to_world(joint, object);
                sets.impulse_joints.insert(ground, handle, joint, false);
            }
            let body = &mut sets.bodies[handle];
            body.recompute_mass_properties_from_colliders(&sets.colliders);
            let local = &body.mass_properties().local_mprops;
            let inertia = local.reconstruct_inertia_matrix();
            let column = |axis: Vector| back(inertia * axis);
            let [x, y, z] = [Vector::X, Vector::Y, Vector::Z].map(column);
            let centre = back(local.local_com);
            let (shape, _) = object.seen();
            let half = shape.extents(&Matrix3::identity());
            self.bodies.push(Body {
                obstacle: number,
                mass,
                inertia: Matrix3::zeros(),
                centre: Vector3::zeros(),
                enclosing: half.norm() + (shape.middle() - centre).norm(),
                twist: Twist::default(),
                free: Twist::default(),
                basis: nalgebra::Matrix6::zeros(),
                freedoms: 0,
                resistance: 0.0,
            });
            self.kept.push(Kept {
                handle,
                name: object.name.clone(),
                centre,
                inertia: Matrix3::from_columns(&[x, y, z]),
                joint: object.joint,
                start: object.pose,
            });
            self.states.push(ObjectState::start(object));
        }
        let states = std::mem::take(&mut self.states);
        self.set(&states)
    }

    /// The objects as they stand at the begin of a step.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// Where they are and how they move.
    pub fn states(&self) -> &[ObjectState] {
        &self.states
    }

    /// Places the objects.
    pub fn set(&mut self, states: &[ObjectState]) -> Result<(), ObjectError> {
        let expected = self.kept.len();
        if states.len() != expected {
            let found = states.len();
            return Err(ObjectError::Count { found, expected });
        }
        for (kept, state) in self.kept.iter().zip(states) {
            state.check(&kept.name)?;
        }
        for (kept, state) in self.kept.iter().zip(states) {
            let body = &mut self.sets.bodies[kept.handle];
            body.set_position(pose(&state.pose), true);
        }
        self.states.clear();
        self.states.extend_from_slice(states);
        self.still = 0;
        self.measure();
        Ok(())
    }

    /// Computes the bodies from the states.
    fn measure(&mut self) {
        let h = self.parameters.dt;
        for ((body, kept), state) in self.bodies.iter_mut().zip(&self.kept).zip(&self.states) {
            let rotation = state.pose.rotation;
            let turn = rotation.to_rotation_matrix();
            let arm = rotation * kept.centre;
            body.centre = state.pose.translation.vector + arm;
            body.inertia = turn * kept.inertia * turn.transpose();
            body.twist = Twist {
                linear: state.velocity + state.angular_velocity.cross(&arm),
                angular: state.angular_velocity,
            };
            (body.basis, body.freedoms) = motions(kept.joint.as_ref(), &rotation, &arm);
            body.resistance = h * damping(kept.joint.as_ref());
            body.free = body.confined(&fallen(body, &self.gravity, h));
        }
    }

    /// Adds the places where objects touch, or soon may, what is fixed or each other, each once, and the ends of their joints. They
    /// are those that rapier found at the begin of its last step, with the gaps of today.
    pub fn meetings(&self, out: &mut Vec<Meeting>) {
        for (object, (kept, state)) in self.kept.iter().zip(&self.states).enumerate() {
            let stops = stops(kept.joint.as_ref(), &kept.start, &state.pose);
            out.extend(stops.into_iter().flatten().map(|stop| Meeting {
                object,
                other: None,
                point: stop.point,
                normal: stop.direction,
                gap: stop.gap,
                friction: 0.0,
            }));
        }
        let of_collider = |handle: ColliderHandle| {
            let parent = self.sets.colliders[handle].parent();
            let own = |kept: &Kept| Some(kept.handle) == parent;
            self.kept.iter().position(own)
        };
        for pair in self.sets.narrow_phase.contact_pairs() {
            let sides = [of_collider(pair.collider1), of_collider(pair.collider2)];
            let (object, other, swapped) = match sides {
                [Some(object), other] => (object, other, true),
                [None, Some(object)] => (object, None, false),
                [None, None] => continue,
            };
            let poses =
                [pair.collider1, pair.collider2].map(|one| *self.sets.colliders[one].position());
            for manifold in pair.manifolds() {
                let own = |at: Option<&rapier3d_f64::math::Pose>, collider: usize| {
                    at.map_or(poses[collider], |at| poses[collider] * *at)
                };
                let first = own(manifold.subshape_pos1(), 0);
                let second = own(manifold.subshape_pos2(), 1);
                let normal = back(first.transform_vector(manifold.local_n1));
                for point in &manifold.points {
                    let one = back(first.transform_point(point.local_p1));
                    let two = back(second.transform_point(point.local_p2));
                    // The normal is from the first to the second.
                    out.push(Meeting {
                        object,
                        other,
                        point: (one + two) / 2.0,
                        normal: if swapped { -normal } else { normal },
                        gap: normal.dot(&(two - one)),
                        friction: manifold.data.friction,
                    });
                }
            }
        }
    }

    /// Moves the objects by one step. Those of which a motion is given begin it with that, the others fall. Where all have come to
    /// rest and none is given a motion, nothing is to be done.
    pub fn step(&mut self, motions: &[Option<Twist>]) -> Result<(), ObjectError> {
        let given = motions.iter().any(Option::is_some);
        if self.still >= STILL_STEPS && !given {
            return Ok(());
        }
        let h = self.parameters.dt;
        for ((body, kept), motion) in self.bodies.iter().zip(&self.kept).zip(motions) {
            let twist = motion.unwrap_or_else(|| fallen(body, &self.gravity, h));
            let own = &mut self.sets.bodies[kept.handle];
            own.set_linvel(vector(&twist.linear), true);
            own.set_angvel(vector(&twist.angular), true);
        }
        let sets = &mut self.sets;
        self.pipeline.step(
            // Gravity is in the velocities already.
            Vector::ZERO,
            &self.parameters,
            &mut sets.islands,
            &mut sets.broad_phase,
            &mut sets.narrow_phase,
            &mut sets.bodies,
            &mut sets.colliders,
            &mut sets.impulse_joints,
            &mut sets.multibody_joints,
            &mut sets.soft_bodies,
            &mut sets.ccd,
            &(),
            &(),
        );
        let mut fastest: f64 = 0.0;
        for (kept, state) in self.kept.iter().zip(&mut self.states) {
            let body = &self.sets.bodies[kept.handle];
            let from = state.pose;
            let speed = state.velocity.norm();
            let pose: Isometry3<f64> = pose_back(body.position());
            let angular_velocity = back(body.angvel());
            *state = ObjectState {
                velocity: back(body.linvel())
                    - angular_velocity.cross(&(pose.rotation * kept.centre)),
                pose,
                angular_velocity,
            };
            // Rapier stops a body whose numbers are not finite, and disables it.
            if !state.is_finite() || !body.is_enabled() {
                let object = kept.name.clone();
                return Err(ObjectError::Diverged { object, speed });
            }
            // Contacts push what overlaps apart without a velocity.
            let shift = (pose.translation.vector - from.translation.vector).norm();
            let turn = (pose.rotation.coords - from.rotation.coords).norm();
            let (linear, angular) = (state.velocity.norm(), state.angular_velocity.norm());
            let speeds = [linear, angular, shift / h, turn / h];
            fastest = speeds.into_iter().fold(fastest, f64::max);
        }
        self.still = match fastest < STILL && !given {
            true => self.still + 1,
            false => 0,
        };
        self.measure();
        Ok(())
    }
}

/// Motion of a body after a step of `h` (s) under gravity, but for what its joint and its contacts do.
fn fallen(body: &Body, gravity: &Vector3<f64>, h: f64) -> Twist {
    Twist {
        linear: body.twist.linear + gravity * h,
        angular: body.twist.angular,
    }
}

fn parameters(timestep: f64) -> IntegrationParameters {
    let softness = SpringCoefficients::new(STIFFNESS / timestep, DAMPING);
    IntegrationParameters {
        dt: timestep,
        length_unit: LENGTH_UNIT,
        num_solver_iterations: 1,
        num_internal_pgs_iterations: SWEEPS,
        // Friction acts in these alone.
        num_internal_stabilization_iterations: SWEEPS,
        contact_softness: softness,
        static_contact_softness: softness,
        normalized_max_linear_velocity: Real::MAX,
        // Contacts as they are, and not as they were.
        contact_recycling: false,
        warmstart_joints: true,
        // The other one brakes a sliding box by 88 % of its friction.
        friction_model: FrictionModel::Simplified,
        ..IntegrationParameters::default()
    }
}
