//! Linearly implicit Euler steps: one Newton step on the implicit Euler equations (as of Baraff and Witkin, Large Steps in
//! Cloth Simulation, SIGGRAPH 1998); the matrix of implicit steps.

use faer::Mat;
use nalgebra::{Matrix3, Vector3};

use super::State;
use super::acceleration::{EquationsOfMotion, to_coordinates};
use super::blocks::{StepBlocks, Weights};
use super::composite::Composite;
use super::reaction::{Reaction, torques_of};
use crate::chain::{Chain, Configuration};
use crate::factor::{ChainLu, ChainMatrix, Curvature, Side};
use crate::robot::{Loads, Robot};

/// `M + d D + k K` in the posture that equations of motion are in, factorised in O(n).
#[derive(Clone, Debug)]
pub(super) struct ImplicitMatrix {
    blocks: StepBlocks,
    lu: ChainLu,
    /// No terms of discs.
    none: Vec<Vector3<f64>>,
}

impl ImplicitMatrix {
    pub fn new(robot: &Robot) -> Self {
        let blocks = StepBlocks::new(robot);
        Self {
            lu: ChainLu::new(&blocks.expansion),
            none: vec![Vector3::zeros(); robot.discs().len()],
            blocks,
        }
    }

    /// Factorises it with the `damping` `d` and the `stiffness` `k` at `q`, where `equations` are; `None` if it cannot be.
    pub fn factorise(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        q: &Configuration,
        command: &[f64],
        [damping, stiffness]: [f64; 2],
    ) -> Option<Curvature> {
        self.expand(equations, loads, q, command);
        self.combine(equations, loads, Weights::of_step(damping, stiffness))
    }

    /// Expands `K`: [`StepBlocks::expand`].
    pub fn expand(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        q: &Configuration,
        command: &[f64],
    ) {
        self.blocks.expand(equations, loads, q, command);
    }

    /// Factorises a sum of mass, damping and stiffness matrix, as the last was expanded; `None` if it cannot be.
    pub fn combine(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        weights: Weights,
    ) -> Option<Curvature> {
        self.combine_with(equations, loads, weights, &[])
    }

    /// The same with the forms of what the surroundings do to each disc; an empty list is nothing.
    pub fn combine_with(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        weights: Weights,
        reactions: &[Reaction],
    ) -> Option<Curvature> {
        let blocks = &mut self.blocks;
        blocks.set(equations, loads, weights, reactions);
        self.lu.factorise(&ChainMatrix {
            expansion: &blocks.expansion,
            scale: weights.stiffness,
            centres: &equations.posture.chain.centres,
            joints: &blocks.joints,
            bodies: &blocks.bodies,
        })
    }

    /// Writes its inverse times `torques` (N m) to `out`.
    pub fn solve(&self, torques: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        self.lu.solve(torques, &self.none, Side::Matrix, out);
    }

    /// Writes `K turns`, as it was last expanded.
    pub fn stiffness_product(
        &self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        turns: &[Vector3<f64>],
        out: &mut [Vector3<f64>],
    ) {
        (self.blocks).stiffness_product(equations, loads, turns, out);
    }
}

/// Workspace of the method.
#[derive(Clone, Debug)]
pub(super) struct ImplicitEuler {
    matrix: ImplicitMatrix,
    rates: Vec<Vector3<f64>>,
    forces: Vec<Vector3<f64>>,
    solution: Vec<Vector3<f64>>,
}

impl ImplicitEuler {
    pub fn new(robot: &Robot) -> Box<Self> {
        let zeros = vec![Vector3::zeros(); robot.discs().len()];
        Box::new(Self {
            matrix: ImplicitMatrix::new(robot),
            rates: zeros.clone(),
            forces: zeros.clone(),
            solution: zeros,
        })
    }

    /// Writes the accelerations to `out` (rad/s²): the solution `a` of
    /// `(M + h D + h² K) a = tau - D v - bias - h K v`; `false` if the matrix is not positive
    /// definite.
    pub fn accelerate(
        &mut self,
        equations: &mut EquationsOfMotion,
        loads: &Loads,
        state: &State,
        command: &[f64],
        h: f64,
        out: &mut [f64],
    ) -> bool {
        let q = &state.configuration;
        equations.enter(q, &state.velocity, command);
        let weights = [h, h * h];
        let curvature = (self.matrix).factorise(equations, loads, q, command, weights);
        if curvature != Some(Curvature::Positive) {
            return false;
        }
        // tau - D v - bias - h K v: the residual at rest rates is minus the first three.
        self.solution.fill(Vector3::zeros());
        equations.residual(&self.solution, &mut self.forces);
        for (rate, motion) in self.rates.iter_mut().zip(&equations.motions) {
            *rate = motion.rate;
        }
        (self.matrix).stiffness_product(equations, loads, &self.rates, &mut self.solution);
        for (force, stiff) in self.forces.iter_mut().zip(&self.solution) {
            *force = -*force - stiff * h;
        }
        self.matrix.solve(&self.forces, &mut self.solution);
        to_coordinates(&equations.posture.chain, &self.solution, out);
        true
    }
}

impl ImplicitEuler {
    /// Writes the change of the joints' rates (rad/s, world axes) by `reactions` after [`ImplicitEuler::accelerate`]: the solution `w`
    /// of `(M + h D + h² K + forms) w = impulses`; `false` if there is none.
    pub fn respond(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        h: f64,
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) -> bool {
        let weights = Weights::of_step(h, h * h);
        let matrix = &mut self.matrix;
        let factorised = matrix.combine_with(equations, loads, weights, reactions);
        if factorised.is_none() {
            return false;
        }
        torques_of(
            reactions,
            &equations.posture.chain.centres,
            &mut self.forces,
        );
        self.matrix.solve(&self.forces, out);
        true
    }

    /// Writes the change of the joints' rates by angular `impulses` on the joints (N m s, world axes) after
    /// [`ImplicitEuler::accelerate`].
    pub fn solve(&self, impulses: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        self.matrix.solve(impulses, out);
    }

    /// The same of the impulses of other `reactions`, with the forms of those before.
    pub fn respond_again(
        &mut self,
        equations: &EquationsOfMotion,
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        torques_of(
            reactions,
            &equations.posture.chain.centres,
            &mut self.forces,
        );
        self.matrix.solve(&self.forces, out);
    }
}

/// The mass matrix with `armatures` (kg m²), by the joints' coordinates.
pub(super) fn mass_matrix(composites: &[Composite], armatures: &[Vector3<f64>]) -> Mat<f64> {
    let dof = 3 * armatures.len();
    let mut mass = Mat::zeros(dof, dof);
    for (i, upper) in composites.iter().enumerate() {
        let rows = upper.inertia.times_columns(&upper.axes).transpose();
        for (j, lower) in composites[..=i].iter().enumerate() {
            let block: Matrix3<f64> = rows * lower.axes;
            for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
                let (row, column) = (3 * upper.joint + r, 3 * lower.joint + c);
                mass[(row, column)] += block[(r, c)];
                if i != j {
                    mass[(column, row)] += block[(r, c)];
                }
            }
        }
    }
    for (axis, armature) in armatures.iter().flat_map(|joint| joint.iter()).enumerate() {
        mass[(axis, axis)] += armature;
    }
    mass
}

/// A form of turns in world axes, as one of the joints' coordinates.
pub(super) fn in_coordinates(world: &Mat<f64>, chain: &Chain) -> Mat<f64> {
    let mut out = Mat::zeros(world.nrows(), world.ncols());
    let joints = chain.centres.len();
    for i in 0..joints {
        for j in 0..joints {
            let block = Matrix3::from_fn(|r, c| world[(3 * i + r, 3 * j + c)]);
            let turned = chain.axes(i).tr_mul(&block) * chain.axes(j);
            for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
                out[(3 * i + r, 3 * j + c)] = turned[(r, c)];
            }
        }
    }
    out
}
