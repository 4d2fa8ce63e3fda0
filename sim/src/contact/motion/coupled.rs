//! Objects in the velocity problem: each is six more unknowns, or one where a joint leaves it one.
//!
//! With `q` the changes of the objects' motions and `u = u* + J w + G q`, the objective gains `q' M q / 2`, and Newton's next iterate
//! solves `(A + J'HJ) w + J'HG q = J' r`, `(M + G'HG) q + G'HJ w = G' r`, where `r = p + H (u - u*)`. Eliminating `w` leaves a dense
//! matrix of the objects alone. `J'HG` of an object has the rank of the `H` of its contacts with the robot, if that is less than the
//! number of its coordinates: so many solves with the robot's factorised matrix it takes ([`Column`]).

use nalgebra::{Cholesky, Const, DMatrix, DVector, Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};

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
    factor: Option<Cholesky<f64, Const<6>>>,
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

/// How a contact's velocity changes with the coordinates of an object.
#[derive(Clone, Copy, Debug)]
struct Lever {
    /// The object's place in the problem.
    place: usize,
    /// Columns of the Jacobian.
    columns: [Vector3<f64>; 6],
}

impl Lever {
    /// The contact's velocity by the object's coordinates.
    fn velocity(&self, coordinates: &Vector6<f64>) -> Vector3<f64> {
        let columns = self.columns.iter().zip(coordinates.iter());
        columns
            .map(|(column, coordinate)| column * *coordinate)
            .sum()
    }

    /// Adds what an impulse on the contact does to the object's coordinates to the first of `out`.
    fn push(&self, impulse: &Vector3<f64>, out: &mut [f64]) {
        for (out, column) in out.iter_mut().zip(&self.columns) {
            *out += column.dot(impulse);
        }
    }
}

/// What the robot's rates change by as an object moves: these `rates`, times the scalar product of its coordinates and `weights`.
#[derive(Clone, Debug, Default)]
struct Column {
    /// The object's place in the problem.
    place: usize,
    weights: Vector6<f64>,
    rates: Vec<Vector3<f64>>,
}

/// The objects of a problem.
#[derive(Clone, Debug, Default)]
pub(super) struct Movables {
    pub all: Vec<Movable>,
    /// Of each contact, those of the objects that it acts on and against.
    levers: Vec<[Option<Lever>; 2]>,
    /// Those of discs with objects that do anything in an iterate: the numbers of disc and contact.
    acting: Vec<(usize, usize)>,
    reactions: Vec<Reaction>,
    spatial: DiscVelocities,
    /// Those of an iterate, and the memory of more.
    columns: Vec<Column>,
}

impl Movable {
    pub fn new(number: usize, body: &Body) -> Self {
        let mass = body.mass_matrix();
        Self {
            number,
            body: *body,
            mass,
            factor: mass.cholesky(),
            change: Vector6::zeros(),
            trial: Vector6::zeros(),
        }
    }

    /// How the point at `arm` from the centre of mass moves by the object's coordinates.
    fn jacobian(&self, arm: &Vector3<f64>) -> Matrix3x6<f64> {
        let mut spatial = Matrix3x6::zeros();
        (spatial.fixed_view_mut::<3, 3>(0, 0)).copy_from(&Matrix3::identity());
        (spatial.fixed_view_mut::<3, 3>(0, 3)).copy_from(&-arm.cross_matrix());
        match self.body.freedoms {
            // The basis is the identity.
            6 => spatial,
            _ => spatial * self.body.basis,
        }
    }

    /// Inverse of the mass with which the point at `arm` resists along a unit vector (1/kg).
    pub fn mobility(&self, arm: &Vector3<f64>, along: &Vector3<f64>) -> f64 {
        let row = self.jacobian(arm).tr_mul(along);
        let solved = self.factor.map(|mass| mass.solve(&row));
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

    /// Takes the contacts of a problem that is to be solved, and forgets the objects' changes.
    pub fn prepare(&mut self, touches: &[Touch]) {
        for movable in &mut self.all {
            (movable.change, movable.trial) = (Vector6::zeros(), Vector6::zeros());
        }
        let lever = |place: usize, arm: &Vector3<f64>, sign: f64| {
            let jacobian = self.all[place].jacobian(arm) * sign;
            let columns = std::array::from_fn(|axis| jacobian.column(axis).into());
            Lever { place, columns }
        };
        self.levers.clear();
        self.levers.extend(touches.iter().map(|touch| {
            let on = match touch.on {
                Side::Object(object) => Some(lever(object, &touch.arm, 1.0)),
                Side::Disc(_) => None,
            };
            let against = touch.against.as_ref();
            [
                on,
                against.map(|other| lever(other.object, &other.arm, -1.0)),
            ]
        }));
    }

    /// Takes a share of the step to the next iterate.
    pub fn take(&mut self, share: f64) {
        for movable in &mut self.all {
            movable.change += (movable.trial - movable.change) * share;
        }
    }

    /// What the next iterate changes the velocity of a contact by through its objects (m/s).
    pub fn trial(&self, contact: usize) -> Vector3<f64> {
        let levers = self.levers[contact].iter().flatten();
        let moved = levers.map(|lever| lever.velocity(&self.all[lever.place].trial));
        moved.sum()
    }

    /// The motions of the objects, by their numbers, at the end of the step under the impulses of the contacts, but for the dampers of
    /// their joints. They follow from the impulses themselves, so that what a contact puts on one side it takes from the other.
    pub fn motions(&self, touches: &[Touch]) -> Vec<(usize, Twist)> {
        let mut pushed = vec![Vector6::zeros(); self.all.len()];
        for (touch, levers) in touches.iter().zip(&self.levers) {
            for lever in levers.iter().flatten().filter(|_| touch.acts()) {
                lever.push(&touch.impulse, pushed[lever.place].as_mut_slice());
            }
        }
        let moved = self.all.iter().zip(&pushed);
        moved
            .map(|(movable, pushed)| {
                let change = movable.factor.map(|mass| mass.solve(pushed));
                let change = movable.twist(&change.unwrap_or_default());
                let end = movable.body.free.plus(&change);
                (movable.number, movable.body.undamped(&end))
            })
            .collect()
    }

    /// Solves for the objects' coordinates, and adds to the robot's `rates` what they change of these. `rates` and what was kept of the
    /// robot's matrix are those of the contacts without the objects; `laws` are what each contact does at its velocity.
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
        self.spatial.set(centres, rates);
        // The objects' own terms, and what the contacts do to them as far as the robot moves without them.
        let contacts = || touches.iter().zip(laws).zip(&self.levers);
        for ((touch, law), levers) in contacts().filter(|((_, law), _)| law.acts()) {
            let mut moved = touch.free - touch.velocity;
            if let Side::Disc(disc) = touch.on {
                moved += self.spatial.of(disc, &touch.arm);
            }
            let impulse = law.impulse - law.inertance * moved;
            for left in levers.iter().flatten() {
                left.push(&impulse, &mut right.as_mut_slice()[6 * left.place..]);
            }
            for other in levers.iter().flatten() {
                for (axis, column) in other.columns.iter().enumerate() {
                    let pushed = law.inertance * column;
                    let start = size * (6 * other.place + axis);
                    let entries = &mut matrix.as_mut_slice()[start..start + size];
                    for left in levers.iter().flatten() {
                        left.push(&pushed, &mut entries[6 * left.place..]);
                    }
                }
            }
        }
        // What the robot does to them as they move.
        self.acting.clear();
        for (number, (touch, law)) in touches.iter().zip(laws).enumerate() {
            if let (Side::Disc(disc), [_, Some(_)]) = (touch.on, &self.levers[number])
                && law.acts()
            {
                self.acting.push((disc, number));
            }
        }
        let used = self.find_columns(touches, laws, centres.len(), robot);
        for column in &self.columns[..used] {
            self.spatial.set(centres, &column.rates);
            let mut pushed = DVector::zeros(size);
            for (disc, touch, law, lever) in self.of_robot(touches, laws) {
                let change = law.inertance * self.spatial.of(disc, &touch.arm);
                lever.push(&change, &mut pushed.as_mut_slice()[6 * lever.place..]);
            }
            let mut entries = matrix.columns_mut(6 * column.place, 6);
            entries.ger(1.0, &pushed, &column.weights, 1.0);
        }
        let Some(solved) = matrix.cholesky().map(|matrix| matrix.solve(&right)) else {
            rates.fill(Vector3::repeat(f64::NAN));
            return;
        };
        for (place, movable) in self.all.iter_mut().enumerate() {
            movable.trial = solved.fixed_rows::<6>(6 * place).into();
        }
        for column in &self.columns[..used] {
            let share = column.weights.dot(&self.all[column.place].trial);
            for (rate, change) in rates.iter_mut().zip(&column.rates) {
                *rate += change * share;
            }
        }
    }

    /// Finds what the rates of a robot of so many joints change by as the objects move. The number of columns.
    fn find_columns(
        &mut self,
        touches: &[Touch],
        laws: &[Response],
        joints: usize,
        robot: &mut impl Responds,
    ) -> usize {
        self.reactions.clear();
        self.reactions.resize(joints, Reaction::default());
        let mut used = 0;
        let mut columns = std::mem::take(&mut self.columns);
        let mut reactions = std::mem::take(&mut self.reactions);
        for (place, movable) in self.all.iter().enumerate() {
            let own = || {
                let all = self.of_robot(touches, laws);
                all.filter(move |(_, _, _, lever)| lever.place == place)
            };
            let mut add = |weights: Vector6<f64>, reactions: &[Reaction]| {
                if used == columns.len() {
                    columns.push(Column::default());
                }
                let column = &mut columns[used];
                (column.place, column.weights) = (place, weights);
                column.rates.resize(joints, Vector3::zeros());
                robot.respond_again(reactions, &mut column.rates);
                used += 1;
            };
            let rank: usize = own().map(|(_, touch, ..)| directions(touch).count()).sum();
            if rank < movable.body.freedoms {
                // By the contacts: an impulse along each direction in which they push.
                for (disc, touch, law, lever) in own() {
                    for direction in directions(touch) {
                        let along = law.inertance * direction;
                        let weights = lever.columns.map(|column| -along.dot(&column)).into();
                        reactions[disc].push(&touch.arm, &direction, &Matrix3::zeros());
                        add(weights, &reactions);
                        reactions[disc] = Reaction::default();
                    }
                }
                continue;
            }
            for axis in 0..movable.body.freedoms {
                for (disc, touch, law, lever) in own() {
                    let impulse = -(law.inertance * lever.columns[axis]);
                    reactions[disc].push(&touch.arm, &impulse, &Matrix3::zeros());
                }
                add(Vector6::ith(axis, 1.0), &reactions);
                own().for_each(|(disc, ..)| reactions[disc] = Reaction::default());
            }
        }
        (self.columns, self.reactions) = (columns, reactions);
        used
    }

    /// The contacts of discs with objects that do anything: disc, contact, what it does, and the object's lever.
    fn of_robot<'a>(
        &'a self,
        touches: &'a [Touch],
        laws: &'a [Response],
    ) -> impl Iterator<Item = (usize, &'a Touch, &'a Response, &'a Lever)> {
        self.acting.iter().filter_map(|&(disc, number)| {
            let lever = self.levers[number][1].as_ref()?;
            Some((disc, &touches[number], &laws[number], lever))
        })
    }
}

/// Unit vectors in whose span a contact's impulse is.
fn directions(touch: &Touch) -> impl Iterator<Item = Vector3<f64>> + use<> {
    let axes = match touch.bound > 0.0 {
        true => [0, 1, 2].map(|axis| Some(Vector3::ith(axis, 1.0))),
        false => [Some(touch.normal), None, None],
    };
    axes.into_iter().flatten()
}
