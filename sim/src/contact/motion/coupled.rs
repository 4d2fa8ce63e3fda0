//! Objects in the velocity problem: each is six more unknowns, or one where a joint leaves it one.
//!
//! With `q` the changes of the objects' motions and `u = u* + J w + G q`, the objective gains `q' M q / 2`, and Newton's next iterate
//! solves `(A + J'HJ) w + J'HG q = J' r`, `(M + G'HG) q + G'HJ w = G' r`, where `r = p + H (u - u*)`. Eliminating `w` leaves a dense
//! matrix of the objects alone, whose columns take one solve with the robot's factorised matrix each.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};

use super::touch::{DiscVelocities, Response, Side, Touch};
use crate::dynamics::Reaction;
use crate::objects::{Body, Twist};

/// An object as the problem has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Movable {
    /// Its number among the objects of the scene.
    pub number: usize,
    pub body: Body,
    mass: Matrix6<f64>,
    /// Change of its coordinates, and that of the next iterate.
    change: Vector6<f64>,
    trial: Vector6<f64>,
}

/// What the robot's rates change by under reactions.
pub(super) trait Responds {
    /// Writes the change by `reactions`.
    fn respond(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]);
    /// The same, kept for the next.
    fn respond_keeping(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]);
    /// Writes the change by the impulses of `reactions`, with the forms of those that were kept last.
    fn respond_again(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]);
}

/// The objects of a problem.
#[derive(Clone, Debug, Default)]
pub(super) struct Movables {
    pub all: Vec<Movable>,
    reactions: Vec<Reaction>,
    response: Vec<Vector3<f64>>,
    columns: Vec<Vec<Vector3<f64>>>,
}

impl Movable {
    pub fn new(number: usize, body: &Body) -> Self {
        Self {
            number,
            body: *body,
            mass: body.mass_matrix(),
            change: Vector6::zeros(),
            trial: Vector6::zeros(),
        }
    }

    /// How the point at `arm` from the centre of mass moves by the object's coordinates.
    fn jacobian(&self, arm: &Vector3<f64>) -> Matrix3x6<f64> {
        let mut spatial = Matrix3x6::zeros();
        (spatial.fixed_view_mut::<3, 3>(0, 0)).copy_from(&Matrix3::identity());
        (spatial.fixed_view_mut::<3, 3>(0, 3)).copy_from(&-arm.cross_matrix());
        spatial * self.body.basis
    }

    /// Inverse of the mass with which the point at `arm` resists along a unit vector (1/kg).
    pub fn mobility(&self, arm: &Vector3<f64>, along: &Vector3<f64>) -> f64 {
        let row = self.jacobian(arm).tr_mul(along);
        let solved = self.mass.cholesky().map(|mass| mass.solve(&row));
        solved.map_or(0.0, |solved| row.dot(&solved))
    }

    fn twist(&self, coordinates: &Vector6<f64>) -> Twist {
        let motion = self.body.basis * coordinates;
        Twist {
            linear: motion.fixed_rows::<3>(0).into(),
            angular: motion.fixed_rows::<3>(3).into(),
        }
    }

    /// Velocity of the point at `arm` at the end of the step, as far as it is known (m/s).
    pub fn velocity(&self, arm: &Vector3<f64>) -> Vector3<f64> {
        self.body.free.at(arm) + self.twist(&self.change).at(arm)
    }

    /// Highest speed of any of its points, now and at the end of the step (m/s).
    pub fn fastest(&self) -> f64 {
        let change = self.twist(&self.change);
        let body = &self.body;
        let speed = |linear: Vector3<f64>, angular: Vector3<f64>| {
            linear.norm() + angular.norm() * body.enclosing
        };
        let end = speed(
            body.free.linear + change.linear,
            body.free.angular + change.angular,
        );
        end.max(speed(body.free.linear, body.free.angular))
    }
}

impl Movables {
    /// The place of an object in the problem, if it is there.
    pub fn find(&self, number: usize) -> Option<usize> {
        self.all.iter().position(|movable| movable.number == number)
    }

    /// The place of an object in the problem, which it takes if it has none.
    pub fn place(&mut self, number: usize, body: &Body) -> usize {
        self.find(number).unwrap_or_else(|| {
            self.all.push(Movable::new(number, body));
            self.all.len() - 1
        })
    }

    /// Forgets the objects' changes.
    pub fn release(&mut self) {
        for movable in &mut self.all {
            (movable.change, movable.trial) = (Vector6::zeros(), Vector6::zeros());
        }
    }

    /// Takes a share of the step to the next iterate.
    pub fn take(&mut self, share: f64) {
        for movable in &mut self.all {
            movable.change += (movable.trial - movable.change) * share;
        }
    }

    /// What the next iterate changes the velocity of a contact by through its objects (m/s).
    pub fn trial(&self, touch: &Touch) -> Vector3<f64> {
        let moved = |object: usize, arm: &Vector3<f64>| {
            let movable = &self.all[object];
            movable.twist(&movable.trial).at(arm)
        };
        let mut velocity = Vector3::zeros();
        if let Side::Object(object) = touch.on {
            velocity += moved(object, &touch.arm);
        }
        if let Some(opposite) = &touch.against {
            velocity -= moved(opposite.object, &opposite.arm);
        }
        velocity
    }

    /// The motions of the objects, by their numbers, at the end of the step under the impulses of the contacts, but for the dampers of
    /// their joints. They follow from the impulses themselves, so that what a contact puts on one side it takes from the other.
    pub fn motions(&self, touches: &[Touch]) -> Vec<(usize, Twist)> {
        let mut pushed = vec![Vector6::zeros(); self.all.len()];
        for touch in touches.iter().filter(|touch| touch.acts()) {
            for (place, jacobian) in self.jacobians(touch) {
                pushed[place] += jacobian.tr_mul(&touch.impulse);
            }
        }
        let moved = self.all.iter().zip(&pushed);
        moved
            .map(|(movable, pushed)| {
                let change = movable.mass.cholesky().map(|mass| mass.solve(pushed));
                let change = movable.twist(&change.unwrap_or_default());
                let end = movable.body.free.plus(&change);
                (movable.number, movable.body.undamped(&end))
            })
            .collect()
    }

    /// How a contact's velocity changes with the coordinates of its objects: their places, and the Jacobians.
    fn jacobians(&self, touch: &Touch) -> impl Iterator<Item = (usize, Matrix3x6<f64>)> + use<> {
        let on = match touch.on {
            Side::Object(object) => Some((object, self.all[object].jacobian(&touch.arm))),
            Side::Disc(_) => None,
        };
        let against = (touch.against.as_ref())
            .map(|other| (other.object, -self.all[other.object].jacobian(&other.arm)));
        on.into_iter().chain(against)
    }

    /// Solves for the objects' coordinates, and adds to the robot's `rates` what they change of these. `rates` and what was kept of the
    /// robot's matrix are those of the contacts without the objects; `laws` are each contact's impulse at the velocity without contacts
    /// and inertance.
    pub fn couple(
        &mut self,
        (touches, laws): (&[Touch], &[Response]),
        centres: &[Vector3<f64>],
        rates: &mut [Vector3<f64>],
        robot: &mut impl Responds,
    ) {
        let size = 6 * self.all.len();
        let mut matrix = DMatrix::zeros(size, size);
        let mut right = DVector::zeros(size);
        for (place, movable) in self.all.iter().enumerate() {
            matrix
                .fixed_view_mut::<6, 6>(6 * place, 6 * place)
                .copy_from(&movable.mass);
        }
        let mut spatial = DiscVelocities::default();
        spatial.set(centres, rates);
        // The objects' own terms, and what the contacts do to them as far as the robot moves without them.
        for (touch, Response { impulse, inertance }) in touches.iter().zip(laws) {
            let moved = match touch.on {
                Side::Disc(disc) => spatial.of(disc, &touch.arm),
                Side::Object(_) => Vector3::zeros(),
            };
            let impulse = impulse - inertance * moved;
            for (row, left) in self.jacobians(touch) {
                let mut rows = right.fixed_rows_mut::<6>(6 * row);
                rows += left.tr_mul(&impulse);
                for (column, other) in self.jacobians(touch) {
                    let mut block = matrix.fixed_view_mut::<6, 6>(6 * row, 6 * column);
                    block += left.tr_mul(&(inertance * other));
                }
            }
        }
        // What the robot does to them as they move: a column for each coordinate of an object that it touches.
        let touched: Vec<bool> = (0..self.all.len())
            .map(|place| touches.iter().any(|touch| touch.is_of_robot(place)))
            .collect();
        self.columns.resize(size, Vec::new());
        self.reactions.resize(centres.len(), Reaction::default());
        self.response.resize(centres.len(), Vector3::zeros());
        for (place, _) in touched.iter().enumerate().filter(|(_, touched)| **touched) {
            for axis in 0..self.all[place].body.freedoms {
                self.reactions.fill(Reaction::default());
                for (touch, Response { inertance, .. }) in touches.iter().zip(laws) {
                    if let (Side::Disc(disc), true) = (touch.on, touch.is_of_robot(place))
                        && let Some((_, jacobian)) = self.jacobians(touch).next()
                    {
                        let impulse = -(inertance * jacobian.column(axis));
                        self.reactions[disc].push(&touch.arm, &impulse, &Matrix3::zeros());
                    }
                }
                robot.respond_again(&self.reactions, &mut self.response);
                spatial.set(centres, &self.response);
                for (touch, Response { inertance, .. }) in touches.iter().zip(laws) {
                    let Side::Disc(disc) = touch.on else { continue };
                    let change = inertance * spatial.of(disc, &touch.arm);
                    for (row, left) in self.jacobians(touch) {
                        let mut rows = matrix.fixed_view_mut::<6, 1>(6 * row, 6 * place + axis);
                        rows += left.tr_mul(&change);
                    }
                }
                self.columns[6 * place + axis].clone_from(&self.response);
            }
        }
        let Some(solved) = matrix.cholesky().map(|matrix| matrix.solve(&right)) else {
            rates.fill(Vector3::repeat(f64::NAN));
            return;
        };
        for (place, movable) in self.all.iter_mut().enumerate() {
            movable.trial = solved.fixed_rows::<6>(6 * place).into();
            for axis in (0..movable.body.freedoms).filter(|_| touched[place]) {
                let column = &self.columns[6 * place + axis];
                for (rate, change) in rates.iter_mut().zip(column) {
                    *rate += change * movable.trial[axis];
                }
            }
        }
    }
}
