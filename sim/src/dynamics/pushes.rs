//! What the surroundings do to the discs in a step, to first order: contacts and drag in derivatives of steps.
//!
//! A push is an impulse `p` on a point `x` of a disc, which depends on the velocity `u` of that point at the end of the step. With the
//! multipliers `w` of the step's adjoint it is in the equations as `w . J'p / h`, `J` the Jacobian of the point, whose derivatives are those
//! of `p` and those of `J`: for rates `r` of the joints and a force `y` on the point, `J r . y` is `V . (x × y, y)` with the disc's spatial
//! velocity `V` about the base's origin. A turn by the motion `X` of a joint takes the disc, and changes `V` by `X × (V - V_below)`; so
//! sums over the discs above each joint give all derivatives in O(n), and `X` may be a longer joint as well.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3, Vector6};

use super::expansion::StepExpansion;
use super::obstacles::ObstacleGradient;
use super::reaction::{Reaction, torques_of};
use super::spatial::{cross_force, halves, spatial};
use crate::factor::{ChainLu, ChainMatrix, ContactLu, Inflow, RubbedMatrix, Side};
use crate::model_tangent::ModelTangent;
use crate::robot::HingeAxes;

/// An impulse on a disc and its derivatives: by the velocity of its point `dp = -inertance du`, and so on.
#[derive(Clone, Debug)]
pub(crate) struct Push {
    pub disc: usize,
    /// A point that the disc carries, as the centre of a bead (m), and the point of the impulse from there.
    pub carried: Vector3<f64>,
    pub arm: Vector3<f64>,
    /// How that arm changes as the carried point is displaced.
    pub slides: Matrix3<f64>,
    /// The impulse (N s).
    pub impulse: Vector3<f64>,
    /// By what a change of the point's velocity at the end of the step diminishes it (kg).
    pub inertance: Matrix3<f64>,
    /// Its derivative by the displacement of the carried point (N s/m), by its velocity at the begin of the step (kg), and by the turn of
    /// the disc (N s).
    pub by_place: Matrix3<f64>,
    pub by_begin: Matrix3<f64>,
    pub by_turn: Matrix3<f64>,
    /// The other disc that the opposite impulse acts on.
    pub opposite: Option<OppositePush>,
    /// The obstacle that pushes.
    pub obstacle: Option<PushingObstacle>,
}

/// An obstacle that pushes, as derivatives by it take it.
#[derive(Clone, Debug)]
pub(crate) struct PushingObstacle {
    /// Its number in the scene, and its origin (m).
    pub number: usize,
    pub origin: Vector3<f64>,
    /// Velocity of the push's point at the end of the step (m/s).
    pub velocity: Vector3<f64>,
    /// The impulse's derivative by the obstacle's compliance (N² s/m).
    pub by_compliance: Vector3<f64>,
}

/// Where the opposite impulse acts. Displacements and velocities are then those of the first disc's point beside this one.
#[derive(Clone, Debug)]
pub(crate) struct OppositePush {
    pub disc: usize,
    pub carried: Vector3<f64>,
    /// The inertance of the push is this (kg), along this normal.
    pub inertance: f64,
    pub normal: Vector3<f64>,
}

impl Push {
    /// The point of the impulse (m).
    fn point(&self) -> Vector3<f64> {
        self.carried + self.arm
    }
}

/// The inertances of pushes as forms of their discs; none where one is not symmetric, or acts on two discs.
pub(super) fn symmetric_forms(pushes: &[Push], centres: &[Vector3<f64>]) -> Option<Vec<Reaction>> {
    let mut forms = vec![Reaction::default(); centres.len()];
    for push in pushes {
        let inertance = &push.inertance;
        if push.opposite.is_some() || *inertance != inertance.transpose() {
            return None;
        }
        let arm = push.point() - centres[push.disc];
        forms[push.disc].push(&arm, &Vector3::zeros(), inertance);
    }
    Some(forms)
}

/// The step's matrix with the inertances of the pushes in it, factorised in O(n) and a dense matrix of the pairs of discs that push each
/// other (Woodbury's formula).
#[derive(Clone, Debug)]
pub(super) struct PushedMatrix {
    lu: ChainLu,
    /// The same where tendons rub in their holes.
    rubbed: Option<ContactLu<6>>,
    joints: Vec<Matrix3<f64>>,
    bodies: Vec<Matrix6<f64>>,
    none: Vec<Vector3<f64>>,
    /// Of each pair, the moments on the joints by a unit impulse, and what the transposed matrix makes of them.
    units: Vec<Vec<Vector3<f64>>>,
    columns: Vec<Vec<Vector3<f64>>>,
    dense: DMatrix<f64>,
}

impl PushedMatrix {
    pub fn new(step: &StepExpansion) -> Self {
        let n = step.armatures.len();
        Self {
            lu: ChainLu::new(&step.expansion),
            rubbed: (step.rubbed.as_ref())
                .and_then(|_| ContactLu::new(&step.equations.robot, &step.expansion)),
            joints: vec![Matrix3::zeros(); n],
            bodies: vec![Matrix6::zeros(); n],
            none: vec![Vector3::zeros(); n],
            units: Vec::new(),
            columns: Vec::new(),
            dense: DMatrix::zeros(0, 0),
        }
    }

    /// Factorises the matrix of a step with the `inflows` of tendons that rub in their holes; `false` if it has no inverse.
    pub fn factorise(
        &mut self,
        step: &StepExpansion,
        pushes: &[Push],
        inflows: Option<&[Inflow]>,
    ) -> bool {
        let equations = &step.equations;
        let chain = &equations.posture.chain;
        let last = self.bodies.len() - 1;
        for (k, (joint, body)) in self.joints.iter_mut().zip(&mut self.bodies).enumerate() {
            let mut own = equations.links[k].body(chain.disc(k));
            if k == last {
                own = own.with(&equations.payload.body(chain.disc(k)));
            }
            *body = own.spatial();
            let armature = &step.armatures[k];
            let alike = || Matrix3::identity() * armature.x;
            *joint = (chain.hinges(k)).map_or_else(alike, |axes: &HingeAxes| axes.form(armature));
        }
        for push in pushes.iter().filter(|push| push.opposite.is_none()) {
            let arm = push.point() - chain.centres[push.disc];
            self.bodies[push.disc] += form(&arm, &push.inertance);
        }
        let factorised = match (&mut self.rubbed, inflows) {
            (Some(lu), Some(inflows)) => {
                lu.inflows.copy_from_slice(inflows);
                lu.factorise(&RubbedMatrix {
                    expansion: &step.expansion,
                    hessian: 0.0,
                    tensions: step.timestep * step.timestep,
                    centres: &chain.centres,
                    joints: &self.joints,
                    bodies: &self.bodies,
                })
            }
            _ => {
                let matrix = ChainMatrix {
                    expansion: &step.expansion,
                    scale: 0.0,
                    centres: &chain.centres,
                    joints: &self.joints,
                    bodies: &self.bodies,
                };
                self.lu.factorise(&matrix).is_some()
            }
        };
        factorised && self.take_pairs(pushes, &chain.centres)
    }

    fn take_pairs(&mut self, pushes: &[Push], centres: &[Vector3<f64>]) -> bool {
        let zeros = vec![Vector3::zeros(); centres.len()];
        let pairs = || {
            pushes
                .iter()
                .filter_map(|push| Some((push, push.opposite.as_ref()?)))
        };
        self.units.clear();
        self.columns.clear();
        for (push, other) in pairs() {
            let mut unit = vec![Reaction::default(); centres.len()];
            let ends = [
                (push.disc, push.point(), 1.0),
                (other.disc, other.carried, -1.0),
            ];
            for (disc, point, sign) in ends {
                let arm = point - centres[disc];
                unit[disc].push(&arm, &(other.normal * sign), &Matrix3::zeros());
            }
            let (mut moments, mut column) = (zeros.clone(), zeros.clone());
            torques_of(&unit, centres, &mut moments);
            self.solve_alone(&moments, &mut column);
            self.units.push(moments);
            self.columns.push(column);
        }
        if self.units.is_empty() {
            return true;
        }
        let (units, columns) = (&self.units, &self.columns);
        let mut dense = DMatrix::from_fn(units.len(), units.len(), |i, j| {
            work(&units[i], &columns[j])
        });
        for (i, (_, other)) in pairs().enumerate() {
            dense[(i, i)] += 1.0 / other.inertance;
        }
        dense
            .try_inverse()
            .map(|inverse| self.dense = inverse)
            .is_some()
    }

    /// Writes the inverse of the transposed matrix without pairs times `torques`.
    fn solve_alone(&mut self, torques: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        match &mut self.rubbed {
            Some(lu) => lu.solve_transposed(torques, out),
            None => self.lu.solve(torques, &self.none, Side::Transpose, out),
        }
    }

    /// Writes the inverse of the transposed matrix times `torques`; world axes.
    pub fn solve_transposed(&mut self, torques: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        self.solve_alone(torques, out);
        if self.units.is_empty() {
            return;
        }
        let pressed = self.units.iter().map(|unit| work(unit, out));
        let pressed = &self.dense * DVector::from_iterator(self.units.len(), pressed);
        for (column, by) in self.columns.iter().zip(pressed.iter()) {
            out.iter_mut()
                .zip(column)
                .for_each(|(out, column)| *out -= column * *by);
        }
    }
}

/// A form of the velocities of a point, at `arm` from the centre of its disc's joint, by the motion of that.
fn form(arm: &Vector3<f64>, inertance: &Matrix3<f64>) -> Matrix6<f64> {
    let cross = arm.cross_matrix();
    let mut form = Matrix6::zeros();
    (form.fixed_view_mut::<3, 3>(0, 0)).copy_from(&-(cross * inertance * cross));
    (form.fixed_view_mut::<3, 3>(0, 3)).copy_from(&(cross * inertance));
    (form.fixed_view_mut::<3, 3>(3, 0)).copy_from(&-(inertance * cross));
    (form.fixed_view_mut::<3, 3>(3, 3)).copy_from(inertance);
    form
}

fn work(moments: &[Vector3<f64>], turns: &[Vector3<f64>]) -> f64 {
    moments.iter().zip(turns).map(|(a, b)| a.dot(b)).sum()
}

/// The rates along which pushes do work: those of the joints at the begin of the step and at its end, and the multipliers.
const RATES: usize = 3;
type Motions = [Vector6<f64>; RATES];

/// What pushes on a disc add: by motions of the disc, and by its velocities along each of the rates.
#[derive(Clone, Copy, Default)]
struct Pushed {
    by_motion: Vector6<f64>,
    by_velocity: Motions,
}

/// Adds what pushes change of the derivatives of a cost by the joints' coordinates, by their rates, by the model and by the
/// obstacles, given the step's multipliers (world axes).
pub(super) fn pull_back_pushes(
    (step, pushes): (&StepExpansion, &[Push]),
    velocity: &[f64],
    multipliers: &[Vector3<f64>],
    [turns, rates]: [&mut [f64]; 2],
    (model, obstacles): (&mut ModelTangent, &mut [ObstacleGradient]),
) {
    let chain = &step.equations.posture.chain;
    let composites = &step.composites;
    // Spatial velocities of the body below each joint, or hinge, and of the disc, along each of the rates.
    let mut sums: Motions = Default::default();
    let mut below = Vec::with_capacity(composites.len());
    let mut discs = vec![Motions::default(); multipliers.len()];
    for composite in composites {
        let joint = composite.joint;
        let begin = Vector3::from_column_slice(&velocity[3 * joint..][..3]);
        let change = Vector3::from_column_slice(&step.accelerations[3 * joint..][..3]);
        let multiplier = chain.dual(joint).tr_mul(&multipliers[joint]);
        below.push(sums);
        let own = [begin, begin + change * step.timestep, multiplier];
        for (sum, own) in sums.iter_mut().zip(own) {
            *sum += composite.axes * own;
        }
        discs[joint] = sums;
    }
    let mut pushed = vec![Pushed::default(); discs.len()];
    let base = step.equations.robot.base();
    for push in pushes {
        let by = push.pull_back(&base, step.timestep, &discs, &mut pushed);
        // Where nobody asks for them there is no room for any.
        if let Some(obstacle) = &push.obstacle
            && let Some(out) = obstacles.get_mut(obstacle.number)
        {
            push.pull_back_obstacle(obstacle, &by, out);
        }
    }
    // From the tip to the base: sums over all that a joint moves.
    let mut above = Pushed::default();
    for (j, composite) in composites.iter().enumerate().rev() {
        let joint = composite.joint;
        if composites.get(j + 1).is_none_or(|next| next.joint != joint) {
            above.by_motion += pushed[joint].by_motion;
            for (sum, own) in above.by_velocity.iter_mut().zip(&pushed[joint].by_velocity) {
                *sum += own;
            }
        }
        let mut by_motion = above.by_motion;
        for (below, by_velocity) in below[j].iter().zip(&above.by_velocity) {
            by_motion -= cross_force(below, by_velocity);
        }
        let by_turn = composite.axes.tr_mul(&by_motion);
        let by_rate = composite
            .axes
            .tr_mul(&(above.by_velocity[0] + above.by_velocity[1]));
        for axis in 0..3 {
            turns[3 * joint + axis] += by_turn[axis];
            rates[3 * joint + axis] += by_rate[axis];
        }
        if j == 0 || composites[j - 1].joint != joint {
            let lifted: Vector3<f64> = by_motion.fixed_rows::<3>(3).into();
            model.joint_offsets[joint] += chain.orientations[joint].tr_mul(&lifted);
        }
    }
}

impl Push {
    fn pull_back(
        &self,
        base: &Vector3<f64>,
        h: f64,
        discs: &[Motions],
        out: &mut [Pushed],
    ) -> ByPush {
        let point = self.point() - base;
        let mut along = at(&discs[self.disc][2], &point);
        if let Some(other) = &self.opposite {
            along -= at(&discs[other.disc][2], &(other.carried - base));
        }
        along /= h;
        let forces = [
            self.by_begin.tr_mul(&along),
            -self.inertance.tr_mul(&along),
            self.impulse / h,
        ];
        let by_place = self.by_place.tr_mul(&along);
        let own = &mut out[self.disc];
        let by_point = own.push(&point, &forces, &discs[self.disc]);
        let carried = self.carried - base;
        own.displace(
            &carried,
            &(by_place + by_point + self.slides.tr_mul(&by_point)),
        );
        own.turn(&self.by_turn.tr_mul(&along));
        if let Some(other) = &self.opposite {
            let (point, back) = (other.carried - base, forces.map(|force| -force));
            let own = &mut out[other.disc];
            let by_point = own.push(&point, &back, &discs[other.disc]);
            own.displace(&point, &(by_point - by_place));
        }
        ByPush {
            impulse: along,
            point: by_point,
        }
    }

    /// Adds what the push changes by its obstacle. A displacement of that is the opposite one of all else; a rotation turns the
    /// impulse and its arm as well, and all else the other way.
    fn pull_back_obstacle(
        &self,
        obstacle: &PushingObstacle,
        by: &ByPush,
        out: &mut ObstacleGradient,
    ) {
        let force = -(self.by_place.tr_mul(&by.impulse) + self.slides.tr_mul(&by.point));
        let by_velocity = self.inertance.tr_mul(&by.impulse);
        out.pose.position += force;
        out.pose.rotation += (self.carried - obstacle.origin).cross(&force)
            + self.impulse.cross(&by.impulse)
            + obstacle.velocity.cross(&by_velocity)
            + self.arm.cross(&by.point);
        out.compliance += obstacle.by_compliance.dot(&by.impulse);
    }
}

/// Derivatives of a cost by the impulse of a push, and by its point alone.
struct ByPush {
    impulse: Vector3<f64>,
    point: Vector3<f64>,
}

impl Pushed {
    /// Takes a force on the velocity of a point along each of the rates; returns the derivative by the displacement of the point alone.
    fn push(
        &mut self,
        point: &Vector3<f64>,
        forces: &[Vector3<f64>; RATES],
        motions: &Motions,
    ) -> Vector3<f64> {
        let mut by_point = Vector3::zeros();
        for ((force, motion), sum) in forces.iter().zip(motions).zip(&mut self.by_velocity) {
            let wrench = spatial(&point.cross(force), force);
            *sum += wrench;
            self.by_motion += cross_force(motion, &wrench);
            by_point += force.cross(&halves(motion).0);
        }
        by_point
    }

    fn displace(&mut self, point: &Vector3<f64>, by_place: &Vector3<f64>) {
        self.by_motion += spatial(&point.cross(by_place), by_place);
    }

    fn turn(&mut self, by_turn: &Vector3<f64>) {
        self.by_motion += spatial(by_turn, &Vector3::zeros());
    }
}

/// Velocity of a point by a spatial velocity.
fn at(motion: &Vector6<f64>, point: &Vector3<f64>) -> Vector3<f64> {
    let (turn, shift) = halves(motion);
    shift + turn.cross(point)
}
