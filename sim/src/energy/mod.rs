//! The potential energy of a robot under command, with its gradient and Hessian on SO(3)^n.
//!
//! `V(q) = sum_t U_t(L_t(q)) + sum_i W_i(q_i) - sum_k f_k . p_k(q)`: tendons with their drives,
//! backbones and limits of the joints, forces that keep their direction. Derivatives are taken along
//! turns `w_i` of each joint, and of everything above it, in world axes: rotated into its disc's
//! frame, `w_i` is the `xi_i` of `q_i exp(xi_i)`, the coordinate of MuJoCo's ball joints. Second
//! derivatives are those along `q exp(s xi)`, the geodesics of SO(3)^n, and so symmetric: the Riemannian
//! Hessian (Absil, Mahony and Sepulchre, Optimization Algorithms on Matrix Manifolds, 2008, ch. 5.5).
//!
//! With `Omega_k = sum_(i <= k) w_i`, to first order the turn of disc `k` in the world, the Hessian is
//! `sum_i w_i' B_i w_i + sum_k (Omega_k' S_k Omega_k + G_k . (Omega_(k-1) x w_k)) +
//! sum_c weight_c (a_c . w)^2`: tendon segments and backbones depend on one joint, dead forces on the
//! disc that carries them up (with the moment `G_k` on joint `k`, for turns do not commute:
//! [`noncommuting`]), and a tendon's stiffness acts along one column. That takes O(n) to build, to store
//! and ([`crate::factor`]) to solve.
//!
//! The gradient is what the principle of virtual work gives: at an equilibrium it is zero, elsewhere it is
//! the residual.

mod columns;
mod dead;
pub(crate) mod following;
mod gradient;
mod pressing;
mod product;
#[cfg(test)]
mod tests;

pub(crate) use columns::Columns;
pub(crate) use dead::DeadForces;
pub(crate) use pressing::{Coupling, DiscPoint, Pair, Pressing};

use faer::Mat;
use nalgebra::{Matrix3, Vector3};

use crate::chain::{Chain, Configuration};
use crate::robot::{HingeAxes, Robot, Span};
use crate::tendon::Posture;

/// The potential of one robot under one command and load.
#[derive(Clone, Copy)]
pub(crate) struct Potential<'a> {
    pub robot: &'a Robot,
    /// One value per tendon; need not be within the tendons' ranges.
    pub command: &'a [f64],
    pub dead: &'a DeadForces,
}

/// Gradient and Hessian of the potential in one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Expansion {
    pub columns: Columns,
    /// Tension of each tendon (N).
    pub tensions: Vec<f64>,
    /// Gradient by the turn of each joint, its own terms only (N m).
    pub joint_gradient: Vec<Vector3<f64>>,
    /// The same of each disc's turn in the world (N m).
    pub disc_gradient: Vec<Vector3<f64>>,
    /// The `B_i` (N m/rad).
    pub joint_blocks: Vec<Matrix3<f64>>,
    /// The `S_k` (N m/rad).
    pub disc_blocks: Vec<Matrix3<f64>>,
    /// The columns: entry `joint * slots + slot`.
    pub slopes: Vec<Vector3<f64>>,
    /// Weight of each column (N/m).
    pub weights: Vec<f64>,
    /// The axes of joints that consist of hinges, as in [`Chain::hinges`].
    pub hinges: Vec<Option<HingeAxes>>,
}

impl Expansion {
    /// Storage for the derivatives of a robot's potential.
    pub fn new(robot: &Robot) -> Self {
        let n = robot.discs().len();
        let columns = Columns::new(robot);
        Self {
            tensions: vec![0.0; robot.tendons().len()],
            joint_gradient: vec![Vector3::zeros(); n],
            disc_gradient: vec![Vector3::zeros(); n],
            joint_blocks: vec![Matrix3::zeros(); n],
            disc_blocks: vec![Matrix3::zeros(); n],
            slopes: vec![Vector3::zeros(); n * columns.slots],
            weights: vec![0.0; columns.slot.len()],
            hinges: Chain::new(robot).hinges,
            columns,
        }
    }

    /// The axes of the hinges of a joint; `None` for a ball joint.
    #[inline]
    pub fn hinges(&self, joint: usize) -> Option<&HingeAxes> {
        self.hinges.get(joint)?.as_ref()
    }

    /// What adds to the block of a joint of hinges, whose second derivatives are those along steps of their angles, where the gradient
    /// by the turn of its disc is `above`.
    #[inline]
    pub fn curving(&self, joint: usize, above: &Vector3<f64>) -> Option<Matrix3<f64>> {
        let hinges = self.hinges(joint)?;
        Some(hinges.curving(&(self.joint_gradient[joint] + above)))
    }

    /// Leaves of a matrix `3 n x 3 n` by the joints' turns, world axes, what is along turns that hinges allow; the others are held by
    /// the size of the Hessian, apart from these.
    pub fn confine(&self, matrix: &mut Mat<f64>) {
        if self.hinges.is_empty() {
            return;
        }
        let held = self.scale();
        let n = self.joint_blocks.len();
        for (joint, hinges) in self.hinges.iter().enumerate() {
            let Some(hinges) = hinges else { continue };
            let free = hinges.projector();
            for other in 0..n {
                let block = take_block(matrix, joint, other);
                set_block(matrix, joint, other, &(free * block));
            }
            for other in 0..n {
                let block = take_block(matrix, other, joint);
                set_block(matrix, other, joint, &(block * free));
            }
            add_block(matrix, joint, joint, &((Matrix3::identity() - free) * held));
        }
    }

    /// The residual (N m): largest Euclidean norm of the gradient by a joint's turn, of hinges along turns that they allow.
    pub fn residual(&self) -> f64 {
        let mut above = Vector3::zeros();
        let mut largest: f64 = 0.0;
        let terms = self.joint_gradient.iter().zip(&self.disc_gradient);
        for (joint, (own, disc)) in terms.enumerate().rev() {
            above += disc;
            let mut moment = own + above;
            if let Some(hinges) = self.hinges(joint) {
                moment = hinges.project(&moment);
            }
            let squared = moment.norm_squared();
            // Not `max`: a NaN must not get lost.
            if squared > largest || squared.is_nan() {
                largest = squared;
            }
        }
        largest.sqrt()
    }

    /// Writes the gradient by each joint's turn, all terms, world axes (N m); of hinges along turns that they allow.
    pub fn gradient(&self, out: &mut [Vector3<f64>]) {
        let mut above = Vector3::zeros();
        let terms = self.joint_gradient.iter().zip(&self.disc_gradient);
        for (gradient, (own, disc)) in out.iter_mut().zip(terms).rev() {
            above += disc;
            *gradient = own + above;
        }
        for (gradient, hinges) in out.iter_mut().zip(&self.hinges) {
            if let Some(hinges) = hinges {
                *gradient = hinges.project(gradient);
            }
        }
    }

    /// Size of the Hessian's diagonal blocks (N m/rad), from above and without regard to signs.
    pub fn scale(&self) -> f64 {
        let stiffest = self.weights.iter().fold(0.0, |w: f64, x| w.max(x.abs()));
        let mut above = Matrix3::zeros();
        let mut largest: f64 = 0.0;
        for joint in (0..self.joint_blocks.len()).rev() {
            above += self.disc_blocks[joint];
            let slopes = &self.slopes[joint * self.columns.slots..][..self.columns.slots];
            let columns: f64 = slopes.iter().map(Vector3::norm_squared).sum();
            let own = self.joint_blocks[joint].norm() + above.norm() + stiffest * columns;
            largest = largest.max(own);
        }
        largest
    }

    /// The Hessian by the joints' turns as a dense matrix `3 n x 3 n`, world axes (N m/rad).
    pub fn dense(&self) -> Mat<f64> {
        let n = self.joint_blocks.len();
        let mut hessian = Mat::zeros(3 * n, 3 * n);
        // Lower triangle. The discs from `k` on turn with both joints `i <= k`, whose turns do not commute.
        let (mut above, mut moment) = (Matrix3::zeros(), Vector3::zeros());
        for k in (0..n).rev() {
            above += self.disc_blocks[k];
            moment += self.disc_gradient[k];
            add_block(&mut hessian, k, k, &(above + self.joint_blocks[k]));
            if let Some(curving) = self.curving(k, &moment) {
                add_block(&mut hessian, k, k, &curving);
            }
            let twisted = above + noncommuting(&moment).transpose();
            for i in 0..k {
                add_block(&mut hessian, k, i, &twisted);
            }
        }
        // The columns' rank-one terms.
        for column in self.dense_columns() {
            for k in 0..n {
                for i in 0..=k {
                    let block = column.1[k] * column.1[i].transpose() * column.0;
                    add_block(&mut hessian, k, i, &block);
                }
            }
        }
        // Upper triangle.
        for column in 0..3 * n {
            for row in column + 1..3 * n {
                hessian[(column, row)] = hessian[(row, column)];
            }
        }
        hessian
    }

    /// Weight and entries by joint of every column.
    pub fn dense_columns(&self) -> Vec<(f64, Vec<Vector3<f64>>)> {
        let n = self.joint_blocks.len();
        let mut dense: Vec<_> = (self.weights.iter())
            .map(|weight| (*weight, vec![Vector3::zeros(); n]))
            .collect();
        for top in 0..n {
            for &column in &self.columns.top[top] {
                let slot = self.columns.slot[column];
                for joint in (0..=top).rev() {
                    dense[column].1[joint] = self.slopes[joint * self.columns.slots + slot];
                    if self.columns.bottom[joint].contains(&column) {
                        break;
                    }
                }
            }
        }
        dense
    }
}

/// The matrix `C` of `Omega' C w = 1/2 G . (Omega x w)`: what a moment `G` (N m) on a joint adds to the
/// Hessian because the joint's turn `w` comes after the turn `Omega` of the disc below (to second order, turns
/// compose by the formula of Baker, Campbell and Hausdorff).
pub(crate) fn noncommuting(moment: &Vector3<f64>) -> Matrix3<f64> {
    let g = moment * 0.5;
    Matrix3::new(0.0, g.z, -g.y, -g.z, 0.0, g.x, g.y, -g.x, 0.0)
}

impl Potential<'_> {
    /// Energy (J) at `q`, whose posture is `posture`.
    pub fn energy(&self, q: &Configuration, posture: &Posture) -> f64 {
        let tendons: f64 = (self.robot.tendons().iter())
            .zip(posture.lengths.iter().zip(self.command))
            .map(|(tendon, (length, command))| tendon.state(*length, *command).energy)
            .sum();
        let joints: f64 = (self.robot.discs().iter().zip(&q.0))
            .filter_map(|(disc, q)| disc.elasticity(q).map(|joint| joint.energy))
            .sum();
        tendons + joints + self.dead.energy(&posture.chain)
    }

    /// Gradient and Hessian at `q`, whose posture is `posture`.
    pub fn expand(&self, q: &Configuration, posture: &Posture, out: &mut Expansion) {
        let mut tensions = std::mem::take(&mut out.tensions);
        for (t, tendon) in self.robot.tendons().iter().enumerate() {
            let state = tendon.state(posture.lengths[t], self.command[t]);
            tensions[t] = state.tension;
            out.weights[t] = state.stiffness;
        }
        self.expand_pulled(q, posture, |tendon, _| tensions[tendon], out);
        out.tensions = tensions;
    }

    /// The same where the tension (N) of each piece of each tendon is given, by the tendon's number
    /// and the piece's place on its route. Leaves the tensions and the tendons' weights of `out` as
    /// they are.
    pub fn expand_pulled(
        &self,
        q: &Configuration,
        posture: &Posture,
        tension: impl Fn(usize, usize) -> f64,
        out: &mut Expansion,
    ) {
        self.expand_joints(q, &posture.chain, out);
        self.expand_dead(&posture.chain, out);
        self.expand_segments(posture, &tension, out);
        self.expand_spans(&posture.chain, &tension, out);
    }

    fn expand_joints(&self, q: &Configuration, chain: &Chain, out: &mut Expansion) {
        out.hinges.copy_from_slice(&chain.hinges);
        for (i, (disc, q)) in self.robot.discs().iter().zip(&q.0).enumerate() {
            (out.joint_gradient[i], out.joint_blocks[i]) = match disc.elasticity(q) {
                None => (Vector3::zeros(), Matrix3::zeros()),
                Some(joint) => {
                    let r = chain.disc(i);
                    (r * joint.gradient, r * joint.hessian * r.transpose())
                }
            };
        }
    }

    /// A dead force `f` on a point at `d` from a joint's centre: gradient `-d x f`, second derivative
    /// `(d . f) I - sym(d f')` of each disc that carries the point up. They are the terms of `-f . exp(w) d` by
    /// Rodrigues' formula, `exp(w) = I + [w]x + [w]x² / 2 + ...`.
    fn expand_dead(&self, chain: &Chain, out: &mut Expansion) {
        let n = chain.positions.len();
        let mut above = Vector3::zeros();
        for k in (0..n).rev() {
            let force = self.dead.at_origin[k];
            let arm = chain.positions[k] - chain.centres[k];
            let mut lever = Lever::of(&arm, &force);
            if let Some(couple) = self.dead.couple(k, chain.disc(k)) {
                lever.add_couple(&couple);
            }
            if k + 1 == n {
                let hung = chain.disc(k) * self.dead.payload_arm;
                lever.add(&hung, &self.dead.payload);
                above += self.dead.payload;
            } else {
                lever.add(&(chain.centres[k + 1] - chain.centres[k]), &above);
            }
            above += force;
            (out.disc_gradient[k], out.disc_blocks[k]) = (lever.gradient, lever.hessian);
        }
    }

    fn expand_segments(
        &self,
        posture: &Posture,
        tension: &impl Fn(usize, usize) -> f64,
        out: &mut Expansion,
    ) {
        let slots = out.columns.slots;
        // A tendon may pass a joint more than once.
        out.slopes.fill(Vector3::zeros());
        for (segment, stretch) in self.robot.segments().iter().zip(&posture.stretches) {
            let tension = tension(segment.tendon, segment.place);
            let gradient = stretch.gradient();
            out.joint_gradient[segment.joint] += gradient * tension;
            out.joint_blocks[segment.joint] += stretch.hessian(&gradient) * tension;
            out.slopes[segment.joint * slots + out.columns.slot[segment.tendon]] += gradient;
        }
    }

    fn expand_spans(
        &self,
        chain: &Chain,
        tension: &impl Fn(usize, usize) -> f64,
        out: &mut Expansion,
    ) {
        for (index, span) in self.robot.spans().iter().enumerate() {
            let columns = self.robot.tendons().len() + 2 * index;
            let tension = tension(span.tendon, span.place);
            expand_span(self.robot, chain, span, tension, columns, out);
        }
    }
}

/// A piece of tension `T` and length `l` between holes `P` and `Q` of discs that are not neighbours:
/// its length's gradient is `(Q - c_j) x u` at every joint between; its Hessian is that of dead
/// forces `T u` on `P` and `-T u` on `Q`, and of `T / l` across it.
fn expand_span(
    robot: &Robot,
    chain: &Chain,
    span: &Span,
    tension: f64,
    columns: usize,
    out: &mut Expansion,
) {
    let (lower, upper, stretch) = span.stretch(robot, chain);
    let slots = out.columns.slots;
    let u = stretch.direction;
    // The length's gradient, at the joints between the holes.
    let first = span.lower.map_or(0, |disc| disc + 1);
    let own = out.columns.slot[span.tendon];
    for joint in first..=span.upper {
        out.slopes[joint * slots + own] += (upper - chain.centres[joint]).cross(&u);
    }
    // The pull on the two holes, carried by the discs from one to the other.
    for disc in span.lower.unwrap_or(0)..=span.upper {
        let from = if span.lower == Some(disc) {
            lower
        } else {
            chain.centres[disc]
        };
        let to = if disc == span.upper {
            upper
        } else {
            chain.centres[disc + 1]
        };
        let lever = Lever::of(&(to - from), &(u * -tension));
        out.disc_gradient[disc] += lever.gradient;
        out.disc_blocks[disc] += lever.hessian;
    }
    // The change of the pull's direction: columns across the piece.
    let weight = if stretch.length > 0.0 {
        tension / stretch.length
    } else {
        0.0
    };
    for (column, across) in [columns, columns + 1].into_iter().zip(across(&u)) {
        out.weights[column] = weight;
        let slot = out.columns.slot[column];
        for joint in 0..=span.upper {
            let start = if joint < first {
                lower
            } else {
                chain.centres[joint]
            };
            out.slopes[joint * slots + slot] = (upper - start).cross(&across);
        }
    }
}

/// Two unit vectors at right angles to `u` and to each other.
fn across(u: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = Vector3::ith_axis(u.iamin());
    let first = u.cross(&axis).normalize();
    [first, u.cross(&first)]
}

/// Gradient and Hessian of a dead force's potential by a disc's turn.
struct Lever {
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
}

impl Lever {
    fn of(arm: &Vector3<f64>, force: &Vector3<f64>) -> Self {
        let half = arm * 0.5;
        let dot = arm.dot(force);
        let entry = |i: usize, j: usize| -(half[i] * force[j] + half[j] * force[i]);
        let (xy, xz, yz) = (entry(0, 1), entry(0, 2), entry(1, 2));
        Self {
            gradient: force.cross(arm),
            hessian: Matrix3::new(
                entry(0, 0) + dot,
                xy,
                xz,
                xy,
                entry(1, 1) + dot,
                yz,
                xz,
                yz,
                entry(2, 2) + dot,
            ),
        }
    }

    fn add(&mut self, arm: &Vector3<f64>, force: &Vector3<f64>) {
        let other = Self::of(arm, force);
        self.gradient += other.gradient;
        self.hessian += other.hessian;
    }

    /// Adds those of several forces on arms of their own, given the sum of `force arm'`.
    fn add_couple(&mut self, couple: &Matrix3<f64>) {
        self.gradient += twist(couple);
        self.hessian += Matrix3::identity() * couple.trace() - (couple + couple.transpose()) * 0.5;
    }
}

/// The sum of `force x arm`, given that of `force arm'`.
pub(crate) fn twist(couple: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(
        couple[(1, 2)] - couple[(2, 1)],
        couple[(2, 0)] - couple[(0, 2)],
        couple[(0, 1)] - couple[(1, 0)],
    )
}

/// Adds a block to that of joints `row` and `column`.
pub(crate) fn add_block(hessian: &mut Mat<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    for c in 0..3 {
        for r in 0..3 {
            hessian[(3 * row + r, 3 * column + c)] += block[(r, c)];
        }
    }
}

fn take_block(matrix: &Mat<f64>, row: usize, column: usize) -> Matrix3<f64> {
    Matrix3::from_fn(|r, c| matrix[(3 * row + r, 3 * column + c)])
}

fn set_block(matrix: &mut Mat<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
        matrix[(3 * row + r, 3 * column + c)] = block[(r, c)];
    }
}
