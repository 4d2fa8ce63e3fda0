//! The balance to first order: its Jacobian with the assumed contacts, and solving with it.
//!
//! In O(n) by [`ContactLu`] where the robot's tendons and loads allow it and the solution is accurate; dense elsewhere.

use faer::Mat;
use nalgebra::Vector3;

use super::Balance;
use crate::energy::{Expansion, following};
use crate::factor::{ContactLu, DenseLu, Inflow, RubbedMatrix, Side, project};
use crate::robot::Robot;

/// Error of a solution in O(n), as a share of the right-hand side, from which on the dense factors are taken.
const INACCURATE: f64 = 1e-8;

/// Factors of a balance's Jacobian, and a solution with them.
#[derive(Clone, Debug)]
pub(in crate::tendon_friction) struct Linear {
    /// In O(n); none for robots whose tendons it is not made for.
    pub chain: Option<Box<ContactLu>>,
    /// The dense ones where those are not of the present Jacobian.
    dense: Option<Box<DenseLu>>,
    /// Moment on each joint (N m).
    pub rhs: Vec<Vector3<f64>>,
    /// Turn of each joint, world axes (rad).
    pub solution: Vec<Vector3<f64>>,
    product: Vec<Vector3<f64>>,
}

impl Linear {
    pub fn new(robot: &Robot) -> Self {
        let none = vec![Vector3::zeros(); robot.discs().len()];
        Self {
            chain: ContactLu::new(robot, &Expansion::new(robot)).map(Box::new),
            dense: None,
            rhs: none.clone(),
            solution: none.clone(),
            product: none,
        }
    }

    /// Whether the present factors are those in O(n).
    #[cfg(test)]
    pub fn is_in_chain(&self) -> bool {
        self.dense.is_none()
    }

    /// Takes the factors of a dense matrix.
    pub fn take_dense(&mut self, lu: DenseLu) {
        self.dense = Some(Box::new(lu));
    }

    /// Solves for the `rhs`.
    pub fn solve(&mut self) {
        match (&self.dense, &mut self.chain) {
            (None, Some(chain)) => chain.solve(&self.rhs, &mut self.solution),
            (None, None) => self.solution.fill(Vector3::zeros()),
            (Some(lu), _) => lu.solve(&self.rhs, Side::Matrix, &mut self.solution),
        }
    }

    /// Factorises in O(n); whether a solution with the factors, multiplied by the matrix, gives its right-hand side.
    fn factorise(&mut self, expansion: &Expansion) -> bool {
        let Some(chain) = &mut self.chain else {
            return false;
        };
        if !chain.factorise(&RubbedMatrix::at_rest(expansion)) {
            return false;
        }
        for (joint, rhs) in self.rhs.iter_mut().enumerate() {
            // A right-hand side without symmetries.
            *rhs = Vector3::new(1.0, -0.6, 0.3) * (1.0 + (joint as f64).sin());
        }
        project(&expansion.hinges, &mut self.rhs);
        chain.solve(&self.rhs, &mut self.solution);
        chain.product(expansion, &self.solution, &mut self.product);
        project(&expansion.hinges, &mut self.product);
        // Not a number is not below.
        (self.product.iter().zip(&self.rhs)).all(|(found, rhs)| (found - rhs).norm() < INACCURATE)
    }
}

impl Balance {
    /// Prepares to solve with the Jacobian of the balance with the assumed contacts, where it was last evaluated with them.
    pub(super) fn linearise(&mut self) {
        self.linearise_with(|_, _, inflow, _| inflow);
    }

    /// The same with `changed` inflows, by tendon and place of the segment.
    pub(in crate::tendon_friction) fn linearise_with(
        &mut self,
        changed: impl Fn(&Self, usize, Inflow, usize) -> Inflow,
    ) {
        self.linear.dense = None;
        let follows = self.loads.wrenches().iter().any(following::follows);
        if !follows {
            self.set_inflows(changed);
            if self.linear.factorise(&self.expansion) {
                return;
            }
        }
        let lu = DenseLu::new(&self.jacobian(), &self.expansion.hinges);
        self.linear.take_dense(lu);
    }

    /// Newton's step from the present residual, with the Jacobian of the last [`Balance::linearise`].
    pub(super) fn newton_step(&mut self) {
        self.load_rhs();
        self.linear.solve();
    }

    /// Takes what is unbalanced for the right-hand side.
    pub(super) fn load_rhs(&mut self) {
        self.expansion.gradient(&mut self.linear.rhs);
        let moments = self.linear.rhs.iter_mut();
        moments.for_each(|moment| *moment = -*moment);
    }

    /// Sets how the tension of each segment follows from what is before it.
    fn set_inflows(&mut self, changed: impl Fn(&Self, usize, Inflow, usize) -> Inflow) {
        let Some(mut chain) = self.linear.chain.take() else {
            return;
        };
        for segment in self.robot.segments() {
            let inflow = self.inflow(segment.tendon, segment.place);
            let at = chain.place(segment.joint, segment.tendon);
            chain.inflows[at] = changed(self, segment.tendon, inflow, segment.place);
        }
        self.linear.chain = Some(chain);
    }

    /// How the tension of a segment follows from what is before it.
    fn inflow(&self, tendon: usize, place: usize) -> Inflow {
        let line = &self.lines[tendon];
        let Some(hole) = place.checked_sub(1) else {
            // The drive: the longer the tendon, the larger.
            let state = self.robot.tendons()[tendon].state(line.length(), self.rest[tendon]);
            return Inflow {
                beyond: -state.stiffness,
                ..Inflow::NONE
            };
        };
        // The capstan law.
        let contact = self.assumed[tendon][hole];
        let [by_tension, by_angle, beyond] = self.profiles[tendon].slopes(line, hole, contact);
        let posture = &self.iterate.posture.chain;
        let [below, own] = match by_angle {
            0.0 => [Vector3::zeros(); 2],
            slope => line.wrap_slopes(posture, hole).map(|turn| turn * slope),
        };
        Inflow {
            before: 1.0 - by_tension,
            below,
            own,
            beyond,
        }
    }

    /// The Jacobian of the balance with the assumed contacts, where it was last evaluated with them.
    pub(super) fn jacobian(&self) -> Mat<f64> {
        // The expansion's weights of the tendons are zero: it holds the second derivatives alone.
        let mut jacobian =
            following::jacobian(&self.loads, 1.0, &self.iterate.posture, &self.expansion);
        for tendon in 0..self.lines.len() {
            self.add_tension_slopes(tendon, &mut jacobian);
        }
        self.expansion.confine(&mut jacobian);
        jacobian
    }

    /// Adds `sum_j dl_j dT_j'` of one tendon.
    fn add_tension_slopes(&self, tendon: usize, jacobian: &mut Mat<f64>) {
        let (line, profile) = (&self.lines[tendon], &self.profiles[tendon]);
        let chain = &self.iterate.posture.chain;
        let n = chain.centres.len();
        let segments = line.lengths.len();
        // `dl_j` of each segment.
        let by_length: Vec<Vec<Vector3<f64>>> = (0..segments)
            .map(|segment| {
                let mut slope = vec![Vector3::zeros(); n];
                line.add_length_slope(chain, segment, &mut slope);
                slope
            })
            .collect();
        // The same of the tendon beyond each segment's first hole.
        let mut beyond = by_length.clone();
        for segment in (0..segments - 1).rev() {
            let (here, above) = beyond.split_at_mut(segment + 1);
            add_scaled(&mut here[segment], 1.0, &above[0]);
        }
        // `dT_0`, by the drive; then from hole to hole, by the capstan law, `dT_j`.
        let state = self.robot.tendons()[tendon].state(line.length(), self.rest[tendon]);
        let mut tension: Vec<_> = beyond[0].iter().map(|b| b * state.stiffness).collect();
        for segment in 0..segments {
            if let Some(hole) = segment.checked_sub(1) {
                let contact = self.assumed[tendon][hole];
                let [by_tension, by_angle, by_beyond] = profile.slopes(line, hole, contact);
                tension.iter_mut().for_each(|t| *t *= 1.0 - by_tension);
                let mut angle = vec![Vector3::zeros(); n];
                line.add_wrap_slope(chain, hole, &mut angle);
                add_scaled(&mut tension, -by_angle, &angle);
                add_scaled(&mut tension, -by_beyond, &beyond[segment]);
            }
            for joint in line.joints(segment) {
                let row = &by_length[segment][joint];
                for (other, slope) in tension.iter().enumerate() {
                    for c in 0..3 {
                        for r in 0..3 {
                            jacobian[(3 * joint + r, 3 * other + c)] += row[r] * slope[c];
                        }
                    }
                }
            }
        }
    }
}

pub(super) fn add_scaled(to: &mut [Vector3<f64>], factor: f64, from: &[Vector3<f64>]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from * factor;
    }
}
