//! The potential energy of a robot under command, with its gradient and Hessian on SO(3)^n.
//!
//! `V(q) = sum_t 1/2 kp_t (L_t(q) - c_t)^2 - sum_i m_i g . p_i(q)`, the payload being part of the
//! distal disc's mass. Derivatives are taken along `q_i exp(xi_i)`: rotation vectors of each joint
//! in its disc's own frame, the coordinates of MuJoCo's ball joints. At an equilibrium the gradient
//! vanishes, and the Hessian's eigenvalues tell how stable it is.

use faer::Mat;
use nalgebra::{Matrix3, Vector3};

use crate::chain::Chain;
use crate::robot::{Command, Loads, Robot};
use crate::tendon::tendon_lengths;

/// The potential of one robot under one command and load.
pub(crate) struct Potential<'a> {
    robot: &'a Robot,
    command: &'a [f64],
    loads: &'a Loads,
}

/// Gradient and Hessian of the potential, and what is needed to compute them without allocating.
pub(crate) struct Derivatives {
    /// Gradient, length `3 n` (N m).
    pub gradient: Vec<f64>,
    /// Hessian, `3 n x 3 n`, symmetric (N m/rad).
    pub hessian: Mat<f64>,
    /// Tendon lengths (m).
    lengths: Vec<f64>,
    /// Gradient of each tendon's length, `3 n` per tendon (m/rad).
    length_gradients: Vec<f64>,
    /// Hessian of `sum_t tension_t L_t`: one block per joint.
    tension_blocks: Vec<Matrix3<f64>>,
}

impl Derivatives {
    /// Room for the derivatives of a robot's potential.
    pub fn new(robot: &Robot) -> Self {
        let (dof, tendons) = (robot.dof(), robot.tendons.len());
        Self {
            gradient: vec![0.0; dof],
            hessian: Mat::zeros(dof, dof),
            lengths: vec![0.0; tendons],
            length_gradients: vec![0.0; dof * tendons],
            tension_blocks: vec![Matrix3::zeros(); robot.discs.len()],
        }
    }

    /// Largest absolute component of the gradient (N m).
    pub fn residual(&self) -> f64 {
        self.gradient
            .iter()
            .fold(0.0, |largest: f64, g| largest.max(g.abs()))
    }
}

impl<'a> Potential<'a> {
    /// The potential of `robot` under `command` and `loads`.
    pub fn new(robot: &'a Robot, command: &'a Command, loads: &'a Loads) -> Self {
        Self::along(robot, command.as_slice(), loads)
    }

    /// The same for rest lengths that need not be within the tendons' ranges.
    pub fn along(robot: &'a Robot, command: &'a [f64], loads: &'a Loads) -> Self {
        Self {
            robot,
            command,
            loads,
        }
    }

    /// Mass carried by disc `index`, the payload included (kg).
    fn mass(&self, index: usize) -> f64 {
        let own = self.robot.discs[index].mass;
        if index + 1 == self.robot.discs.len() {
            own + self.loads.tip_payload().mass
        } else {
            own
        }
    }

    /// Energy (J) at the poses in `chain`; `lengths` is scratch, one entry per tendon.
    pub fn energy(&self, chain: &Chain, lengths: &mut [f64]) -> f64 {
        tendon_lengths(self.robot, chain, lengths);
        let stretched: f64 = (self.robot.tendons.iter())
            .zip(lengths.iter().zip(self.command))
            .map(|(tendon, (length, rest))| 0.5 * tendon.stiffness * (length - rest).powi(2))
            .sum();
        let lifted: f64 = (chain.positions.iter().enumerate())
            .map(|(i, position)| self.mass(i) * self.robot.gravity.dot(position))
            .sum();
        stretched - lifted
    }

    /// Gradient and Hessian at the poses in `chain`.
    pub fn differentiate(&self, chain: &Chain, out: &mut Derivatives) {
        tendon_lengths(self.robot, chain, &mut out.lengths);
        self.differentiate_lengths(chain, out);
        out.gradient.fill(0.0);
        out.hessian.fill(0.0);
        self.add_tendons(out);
        self.add_gravity(chain, out);
        mirror_lower(&mut out.hessian);
    }

    /// Gradients of the tendons' lengths, and the tension-weighted sum of their Hessians.
    fn differentiate_lengths(&self, chain: &Chain, out: &mut Derivatives) {
        let dof = self.robot.dof();
        out.length_gradients.fill(0.0);
        out.tension_blocks.fill(Matrix3::zeros());
        for segment in &self.robot.segments {
            let (tendon, joint) = (segment.tendon, segment.joint);
            let tension =
                self.robot.tendons[tendon].stiffness * (out.lengths[tendon] - self.command[tendon]);
            let derivatives = segment.derivatives(&chain.joints[joint]);
            out.length_gradients[tendon * dof + 3 * joint..][..3]
                .copy_from_slice(derivatives.gradient.as_slice());
            out.tension_blocks[joint] += derivatives.hessian * tension;
        }
    }

    /// `kp (L - c) dL` to the gradient; `kp dL dL' + kp (L - c) d²L` to the Hessian's lower half.
    fn add_tendons(&self, out: &mut Derivatives) {
        let dof = self.robot.dof();
        for (t, tendon) in self.robot.tendons.iter().enumerate() {
            let slope = &out.length_gradients[t * dof..][..dof];
            let tension = tendon.stiffness * (out.lengths[t] - self.command[t]);
            // A module's tendon moves its own joints only: the rest of its slope is zero.
            let first = slope.iter().position(|s| *s != 0.0).unwrap_or(dof);
            let end = slope
                .iter()
                .rposition(|s| *s != 0.0)
                .map_or(first, |last| last + 1);
            for column in first..end {
                out.gradient[column] += tension * slope[column];
                let pull = tendon.stiffness * slope[column];
                let target = &mut out.hessian.col_as_slice_mut(column)[column..end];
                for (h, s) in target.iter_mut().zip(&slope[column..end]) {
                    *h += pull * s;
                }
            }
        }
        for (joint, block) in out.tension_blocks.iter().enumerate() {
            add_block(&mut out.hessian, joint, joint, block);
        }
    }

    /// Weight and payload. With `w = -g` and `D_k = sum_(j > k) m_j (p_j - p_k)`, a turn `w_i` of
    /// joint `i` in the world frame changes the energy by `(D_i x w) . w_i`, and turns of joints
    /// `i <= k` together by `w_i' (D_k w' - (D_k . w) I) w_k`, symmetrised for `i = k`.
    fn add_gravity(&self, chain: &Chain, out: &mut Derivatives) {
        let n = chain.positions.len();
        let up = -self.robot.gravity;
        let mut mass_above = 0.0;
        let mut moment = Vector3::zeros();
        for k in (0..n).rev() {
            if k + 1 < n {
                mass_above += self.mass(k + 1);
                moment += (chain.positions[k + 1] - chain.positions[k]) * mass_above;
            }
            let to_disc = chain.orientations[k].transpose();
            let gradient = to_disc * moment.cross(&up);
            for (g, add) in out.gradient[3 * k..].iter_mut().zip(gradient.iter()) {
                *g += add;
            }
            let world = moment * up.transpose() - Matrix3::identity() * moment.dot(&up);
            let diagonal = to_disc * ((world + world.transpose()) * 0.5) * chain.orientations[k];
            add_block(&mut out.hessian, k, k, &diagonal);
            // Block (k, i) of the lower half is the transpose of the formula's (i, k).
            let row = to_disc * world.transpose();
            for i in 0..k {
                add_block(&mut out.hessian, k, i, &(row * chain.orientations[i]));
            }
        }
    }
}

fn add_block(hessian: &mut Mat<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    for c in 0..3 {
        let target = &mut hessian.col_as_slice_mut(3 * column + c)[3 * row..3 * row + 3];
        for (h, add) in target.iter_mut().zip(block.column(c).iter()) {
            *h += add;
        }
    }
}

fn mirror_lower(matrix: &mut Mat<f64>) {
    for column in 0..matrix.ncols() {
        for row in column + 1..matrix.nrows() {
            matrix[(column, row)] = matrix[(row, column)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::Configuration;
    use crate::robot::{RobotSpec, Routing};
    use nalgebra::UnitQuaternion;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// The standard robots, and one routed as the real robot is.
    fn robots() -> Vec<Robot> {
        let mut specs: Vec<_> = RobotSpec::STANDARD
            .iter()
            .filter_map(|name| RobotSpec::standard(name))
            .collect();
        let mut through_guides = specs[1].clone();
        through_guides.routing = Routing::Base;
        specs.push(through_guides);
        let compile = |spec| Robot::new(spec).expect("standard robots are valid");
        specs.into_iter().map(compile).collect()
    }

    fn random_step(robot: &Robot, size: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
        (0..robot.dof())
            .map(|_| size * (2.0 * rng.random::<f64>() - 1.0))
            .collect()
    }

    /// The energy as a function of joint turns away from a random bent configuration.
    struct Landscape<'a> {
        robot: &'a Robot,
        command: Command,
        loads: Loads,
        bent: Configuration,
    }

    impl<'a> Landscape<'a> {
        fn random(robot: &'a Robot, rng: &mut ChaCha8Rng) -> Self {
            let straight = Configuration::straight(robot);
            let mut bent = straight.clone();
            straight.retract(&random_step(robot, 0.4, rng), &mut bent);
            Self {
                robot,
                command: robot.random_command(rng),
                loads: Loads::payload(0.03).expect("a mass"),
                bent,
            }
        }

        fn energy(&self, step: &[f64]) -> f64 {
            let mut moved = self.bent.clone();
            self.bent.retract(step, &mut moved);
            let mut chain = Chain::new(self.robot);
            chain.place(self.robot, &moved);
            let mut lengths = vec![0.0; self.robot.tendons.len()];
            Potential::new(self.robot, &self.command, &self.loads).energy(&chain, &mut lengths)
        }

        fn derivatives(&self) -> Derivatives {
            let mut chain = Chain::new(self.robot);
            chain.place(self.robot, &self.bent);
            let mut derivatives = Derivatives::new(self.robot);
            Potential::new(self.robot, &self.command, &self.loads)
                .differentiate(&chain, &mut derivatives);
            derivatives
        }
    }

    fn along(dof: usize, moves: &[(usize, f64)]) -> Vec<f64> {
        let mut step = vec![0.0; dof];
        for (index, size) in moves {
            step[*index] += size;
        }
        step
    }

    #[test]
    fn gradient_is_the_central_difference_of_the_energy() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        for robot in robots() {
            let landscape = Landscape::random(&robot, &mut rng);
            let gradient = landscape.derivatives().gradient;
            let h = 1e-5;
            for (i, analytic) in gradient.iter().enumerate() {
                let up = landscape.energy(&along(robot.dof(), &[(i, h)]));
                let down = landscape.energy(&along(robot.dof(), &[(i, -h)]));
                let numeric = (up - down) / (2.0 * h);
                assert!(
                    (analytic - numeric).abs() < 1e-8,
                    "{i}: {analytic} and {numeric}"
                );
            }
        }
    }

    #[test]
    fn hessian_is_the_second_difference_of_the_energy() {
        let mut rng = ChaCha8Rng::seed_from_u64(12);
        for robot in robots() {
            let landscape = Landscape::random(&robot, &mut rng);
            let hessian = landscape.derivatives().hessian;
            let h = 1e-4;
            for i in 0..robot.dof() {
                for j in 0..=i {
                    let corner = |a, b| landscape.energy(&along(robot.dof(), &[(i, a), (j, b)]));
                    let numeric = (corner(h, h) - corner(h, -h) - corner(-h, h) + corner(-h, -h))
                        / (4.0 * h * h);
                    let analytic = hessian[(i, j)];
                    assert!(
                        (analytic - numeric).abs() < 3e-6,
                        "({i}, {j}): {analytic} and {numeric}"
                    );
                    assert_eq!(analytic, hessian[(j, i)]);
                }
            }
        }
    }

    #[test]
    fn tendon_lengths_do_not_change_when_the_robot_turns_about_its_axis() {
        let robot = &robots()[0];
        let mut chain = Chain::new(robot);
        let mut lengths = [vec![0.0; 6], vec![0.0; 6]];
        let third =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::TAU / 3.0);
        let mut rng = ChaCha8Rng::seed_from_u64(13);
        let bent = Landscape::random(robot, &mut rng).bent;
        let turned = Configuration(bent.0.iter().map(|q| third * q * third.inverse()).collect());
        for (q, out) in [bent, turned].iter().zip(&mut lengths) {
            chain.place(robot, q);
            tendon_lengths(robot, &chain, out);
        }
        for (t, length) in lengths[0].iter().enumerate() {
            // Hole k moves to where hole k + 1 was; the holes are rounded to 1e-6 m.
            let next = 3 * (t / 3) + (t + 1) % 3;
            assert!((length - lengths[1][next]).abs() < 1e-5);
        }
    }
}
